//! One object under an averaged predictor.

use pellucid_core::team::Alone;
use pellucid_core::{Control, Team};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;

use super::errors::{Errors, Owner};
use crate::pair::{Last, Pair, are_new, reporting};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, Learned, MaterialGradient, PredictError};

pub(super) struct BoundAveraged {
    pair: Pair,
    newest: f64,
    owner: Owner,
    memory: Errors,
    found: Last<Found>,
}

/// What a draw found.
struct Found {
    /// Of every point of the surface, `[point][channel]`.
    radiance: Vec<f32>,
    /// Of all points.
    outside_training: u64,
    learned: Learned,
}

impl BoundAveraged {
    pub(super) fn new(pair: Pair, newest: f64, name: String) -> Self {
        let object = &pair.object;
        let values = object.surface().len() * object.channels();
        let owner = Owner { predictor: name, object: object.id(), values };
        Self { pair, newest, owner, memory: Errors::default(), found: Last::none() }
    }

    /// What a draw finds, and how many paths that took.
    fn measure(&self, draw: Draw, control: &Control<'_>) -> Result<(Found, u64), PredictError> {
        let Pair { object, fast, unbiased, .. } = &self.pair;
        let points = object.points();
        let mut radiance = vec![0.0f32; self.owner.values];
        let mut errors = vec![0.0f32; self.owner.values];
        let first = |done, total| control.report(done, 2 * total);
        let seen = fast.predict(&points, draw, &mut radiance, &reporting(control, &first))?;
        let second = |done, total| control.report(total + done, 2 * total);
        let measured = unbiased.predict(&points, draw, &mut errors, &reporting(control, &second))?;
        errors.par_iter_mut().zip(&radiance).for_each(|(error, fast)| *error -= fast);
        let (memory, share) = (&self.memory.values, self.memory.share_of(1, self.newest));
        // Not cut off at 0, which would lift the mean of dark points.
        radiance.par_iter_mut().zip(&errors).enumerate().for_each(|(i, (value, new))| {
            // The first pass has no others beside it, and its share is 1.
            let old = memory.get(i).copied().unwrap_or_default();
            *value += old + share * (new - old);
        });
        let learned = self.owner.write(Errors { passes: vec![draw.pass.number()], values: errors });
        let found = Found { radiance, outside_training: seen.outside_training, learned };
        Ok((found, seen.paths + measured.paths))
    }
}

impl BoundPredictor for BoundAveraged {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.found.forget();
        self.pair.update(labels, changed, control)
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        self.pair.check(points, out.len(), control)?;
        let (found, paths) = self.found.of(draw, || self.measure(draw, control))?;
        let channels = self.pair.object.channels();
        for (values, &p) in out.chunks_exact_mut(channels).zip(points) {
            values.copy_from_slice(&found.radiance[p as usize * channels..][..channels]);
        }
        let outside_training = found.outside_training;
        Ok(Diagnostics { outside_training, paths, learned: found.learned.clone() })
    }

    fn pullback(
        &self,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.pullback_in(&Alone, points, draw, d_radiance, out, control)
    }

    fn pullback_in(
        &self,
        team: &dyn Team,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.pair.pullback_in(team, points, draw, d_radiance, out, control)
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        if learned.is_empty() {
            return Ok(());
        }
        let errors = self.owner.read(learned)?;
        if are_new(&errors.passes, &self.memory.passes)? {
            self.memory.absorb(errors, self.newest);
            self.found.forget();
        }
        Ok(())
    }

    fn memory(&self) -> Learned {
        if self.memory.passes.is_empty() {
            return Learned::default();
        }
        self.owner.write(self.memory.clone())
    }
}
