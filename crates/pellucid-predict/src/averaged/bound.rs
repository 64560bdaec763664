//! One object under an averaged predictor.

use std::sync::{Arc, Mutex, PoisonError};

use pellucid_core::team::Alone;
use pellucid_core::{Control, Team};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;

use super::errors::{Errors, Owner};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, Learned, MaterialGradient, Object, PredictError};

pub(super) struct BoundAveraged {
    object: Arc<Object>,
    fast: Box<dyn BoundPredictor>,
    unbiased: Box<dyn BoundPredictor>,
    newest: f64,
    owner: Owner,
    memory: Errors,
    /// Both predictors hold the labels of the last update.
    current: bool,
    /// What the last draw found for these labels and this memory; a pure function of them.
    found: Mutex<Option<Arc<Found>>>,
}

/// What a draw found.
struct Found {
    draw: Draw,
    /// Of every point of the surface, `[point][channel]`.
    radiance: Vec<f32>,
    /// Of all points.
    outside_training: u64,
    learned: Learned,
}

impl BoundAveraged {
    pub(super) fn new(
        fast: Box<dyn BoundPredictor>,
        unbiased: Box<dyn BoundPredictor>,
        newest: f64,
        name: String,
        object: Arc<Object>,
    ) -> Self {
        let values = object.surface().len() * object.channels();
        let owner = Owner { predictor: name, object: object.id(), values };
        let (memory, found) = (Errors::default(), Mutex::new(None));
        Self { object, fast, unbiased, newest, owner, memory, current: false, found }
    }

    fn forget_found(&mut self) {
        *self.found.get_mut().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// What a draw finds, and how many paths finding it took.
    fn find(&self, draw: Draw, control: &Control<'_>) -> Result<(Arc<Found>, u64), PredictError> {
        let kept = self.found.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(found) = kept.filter(|f| f.draw == draw) {
            return Ok((found, 0));
        }
        let (found, paths) = self.measure(draw, control)?;
        let found = Arc::new(found);
        *self.found.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&found));
        Ok((found, paths))
    }

    fn measure(&self, draw: Draw, control: &Control<'_>) -> Result<(Found, u64), PredictError> {
        let points = self.object.points();
        let mut radiance = vec![0.0f32; self.owner.values];
        let mut errors = vec![0.0f32; self.owner.values];
        let first = |done, total| control.report(done, 2 * total);
        let seen = self.fast.predict(&points, draw, &mut radiance, &reporting(control, &first))?;
        let second = |done, total| control.report(total + done, 2 * total);
        let measured = self.unbiased.predict(&points, draw, &mut errors, &reporting(control, &second))?;
        errors.par_iter_mut().zip(&radiance).for_each(|(error, fast)| *error -= fast);
        let share = self.memory.share_of(1, self.newest);
        // Not cut off at 0, which would lift the mean of dark points.
        match self.memory.passes.is_empty() {
            true => radiance.par_iter_mut().zip(&errors).for_each(|(value, error)| *value += error),
            false => {
                let both = errors.par_iter().zip(&self.memory.values);
                let values = radiance.par_iter_mut().zip(both);
                values.for_each(|(value, (new, old))| *value += old + share * (new - old));
            }
        }
        let learned = self.owner.write(Errors { passes: vec![draw.pass.number()], values: errors });
        let outside_training = seen.outside_training;
        Ok((Found { draw, radiance, outside_training, learned }, seen.paths + measured.paths))
    }
}

impl BoundPredictor for BoundAveraged {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        // After a failure neither may trust what is said to have changed.
        let changed = if std::mem::take(&mut self.current) { changed } else { Changed::Unknown };
        self.forget_found();
        self.object.check_labels(labels)?;
        self.fast.update(labels, changed, control)?;
        self.unbiased.update(labels, changed, control)?;
        self.current = true;
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        if !self.current {
            return Err(PredictError::before_update());
        }
        self.object.check_points(points, out.len())?;
        control.check()?;
        let (found, paths) = self.find(draw, control)?;
        let channels = self.object.channels();
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

    /// By the fast predictor alone.
    fn pullback_in(
        &self,
        team: &dyn Team,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        if !self.current {
            return Err(PredictError::before_update());
        }
        self.fast.pullback_in(team, points, draw, d_radiance, out, control)
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        if learned.is_empty() {
            return Ok(());
        }
        let errors = self.owner.read(learned)?;
        let known = errors.passes.iter().filter(|p| self.memory.passes.binary_search(p).is_ok()).count();
        if known == errors.passes.len() {
            return Ok(());
        }
        if known > 0 {
            return Err(PredictError::invalid(
                "learned values",
                "some of their passes were absorbed already and some were not",
            ));
        }
        self.memory.absorb(errors, self.newest);
        self.forget_found();
        Ok(())
    }

    fn memory(&self) -> Learned {
        if self.memory.passes.is_empty() {
            return Learned::default();
        }
        self.owner.write(self.memory.clone())
    }
}

/// A control that stops with `control` and reports elsewhere.
fn reporting<'a>(control: &Control<'a>, report: &'a (dyn Fn(u64, u64) + Sync + 'a)) -> Control<'a> {
    control.silent().with_progress(report)
}
