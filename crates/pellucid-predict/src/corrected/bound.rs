//! One object under a corrected predictor.

use pellucid_core::team::Alone;
use pellucid_core::{Control, Domain, Team, random};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;

use super::Correction;
use super::field::Smoothed;
use super::moments::{Moments, Owner};
use super::quadratic::{Quadratic, TERMS, evaluate};
use crate::pair::{Last, Pair, are_new, reporting};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, Learned, MaterialGradient, Object, PredictError};

/// Points that one task corrects.
const CHUNK: usize = 4096;
const ANCHOR: Domain = Domain::new("anchor");

pub(super) struct BoundCorrected {
    pair: Pair,
    settings: Correction,
    owner: Owner,
    memory: Moments,
    /// What `memory` holds, ascending.
    passes: Vec<u32>,
    /// Corrections.
    found: Last<Found>,
}

/// A draw's anchors and what they tell.
struct Found {
    /// Ascending.
    anchors: Vec<u32>,
    /// The fast predictor's values there, `[anchor][channel]`.
    fast: Vec<f32>,
    fast_outside: u64,
    /// Quadratics by channel.
    common: Vec<[f64; TERMS]>,
    local: Smoothed,
    learned: Learned,
}

impl BoundCorrected {
    pub(super) fn new(pair: Pair, settings: Correction, name: String) -> Self {
        let object = &pair.object;
        let channels = object.channels();
        let owner = Owner { predictor: name, object: object.id(), channels, radius_mm: settings.radius_mm };
        let memory = Moments::new(channels);
        Self { pair, settings, owner, memory, passes: Vec::new(), found: Last::none() }
    }

    /// The correction of a draw, and how many paths finding it took.
    fn measure(&self, draw: Draw, control: &Control<'_>) -> Result<(Found, u64), PredictError> {
        let channels = self.pair.object.channels();
        let pass = draw.pass.number();
        let domain = ANCHOR.pass(pass);
        let most = u64::MAX / u64::from(self.settings.one_in);
        let anchors: Vec<u32> = (0..self.pair.object.surface().len() as u32)
            .filter(|&p| random::hash(draw.seed, domain, u64::from(p), 0) <= most)
            .collect();
        let mut fast = vec![0.0; anchors.len() * channels];
        let fast_seen = self.pair.fast.predict(&anchors, draw, &mut fast, &control.silent())?;
        let mut truth = vec![0.0; fast.len()];
        let paths = self.pair.unbiased.predict(&anchors, draw, &mut truth, control)?.paths + fast_seen.paths;

        let mut new = Moments::new(channels);
        for (fast, truth) in fast.chunks_exact(channels).zip(truth.chunks_exact(channels)) {
            for (quadratic, (fast, truth)) in new.quadratics.iter_mut().zip(fast.iter().zip(truth)) {
                quadratic.add(*fast, truth - fast);
            }
        }
        let mut all = self.memory.clone();
        all.quadratics
            .iter_mut()
            .zip(&new.quadratics)
            .for_each(|(own, new)| own.absorb(self.settings.memory, new));
        let common: Vec<[f64; TERMS]> = all.quadratics.iter().map(Quadratic::solve).collect();
        let values = fast.chunks_exact(channels).zip(truth.chunks_exact(channels));
        for (&p, (fast, truth)) in anchors.iter().zip(values) {
            let rest = fast
                .iter()
                .zip(truth)
                .zip(&common)
                .map(|((fast, truth), common)| f64::from(truth - fast) - evaluate(common, *fast));
            new.field.add(position(&self.pair.object, p), self.settings.radius_mm, rest);
        }
        all.field.absorb(self.settings.memory, &new.field);
        let local = all.field.smoothed(channels, control)?;
        let learned = self.owner.write(vec![pass], &new);
        let fast_outside = fast_seen.outside_training;
        Ok((Found { anchors, fast, fast_outside, common, local, learned }, paths))
    }

    /// The fast predictor's values; those at the anchors are at hand where every point is asked for.
    fn fast_values(
        &self,
        points: &[u32],
        draw: Draw,
        found: &Found,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        let all = points.len() == self.pair.object.surface().len()
            && points.iter().enumerate().all(|(i, &p)| i == p as usize);
        if !all {
            return self.pair.fast.predict(points, draw, out, control);
        }
        let channels = self.pair.object.channels();
        let mut anchors = found.anchors.iter().peekable();
        let others: Vec<u32> =
            points.iter().copied().filter(|p| anchors.next_if(|a| *a == p).is_none()).collect();
        let mut values = vec![0.0; others.len() * channels];
        let mut seen = self.pair.fast.predict(&others, draw, &mut values, control)?;
        seen.outside_training += found.fast_outside;
        for (points, values) in [(&found.anchors, &found.fast), (&others, &values)] {
            for (&p, values) in points.iter().zip(values.chunks_exact(channels)) {
                out[p as usize * channels..][..channels].copy_from_slice(values);
            }
        }
        Ok(seen)
    }
}

/// Where a point's voxel lies in the grid, mm.
fn position(object: &Object, point: u32) -> [f64; 3] {
    let (voxel, pitch) = (object.surface().voxels()[point as usize], object.frame().pitch().mm());
    std::array::from_fn(|a| f64::from(voxel[a]) * pitch[a])
}

impl BoundPredictor for BoundCorrected {
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
        let first = |d, t| control.report(d, 2 * t);
        let (found, paths) = self.found.of(draw, || self.measure(draw, &reporting(control, &first)))?;
        let seen = self.fast_values(
            points,
            draw,
            &found,
            out,
            &reporting(control, &|d, t| control.report(t + d, 2 * t)),
        )?;
        let (object, radius) = (&*self.pair.object, self.settings.radius_mm);
        let channels = object.channels();
        let chunks = out.par_chunks_mut(CHUNK * channels).zip(points.par_chunks(CHUNK));
        chunks.try_for_each(|(out, points)| {
            control.check()?;
            let mut local = vec![0.0; channels];
            for (values, &p) in out.chunks_exact_mut(channels).zip(points) {
                found.local.at(position(object, p), radius, &mut local);
                for (value, (common, local)) in values.iter_mut().zip(found.common.iter().zip(&local)) {
                    *value = (f64::from(*value) + evaluate(common, *value) + local).max(0.0) as f32;
                }
            }
            Ok::<(), PredictError>(())
        })?;
        Ok(Diagnostics {
            outside_training: seen.outside_training,
            paths: paths + seen.paths,
            learned: found.learned.clone(),
        })
    }

    /// By the fast predictor alone: how the correction depends on the labels is left out.
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
        let moments = self.owner.read(learned)?;
        if !are_new(&learned.passes, &self.passes)? {
            return Ok(());
        }
        // Every pass that is new fades what was there.
        let passes = i32::try_from(learned.passes.len()).unwrap_or(i32::MAX);
        self.memory.absorb(self.settings.memory.powi(passes), &moments);
        self.passes.extend(&learned.passes);
        self.passes.sort_unstable();
        self.found.forget();
        Ok(())
    }

    fn memory(&self) -> Learned {
        if self.passes.is_empty() {
            return Learned::default();
        }
        self.owner.write(self.passes.clone(), &self.memory)
    }
}
