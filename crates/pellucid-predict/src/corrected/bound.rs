//! One object under a corrected predictor.

use std::sync::{Arc, Mutex, PoisonError};

use pellucid_core::team::Alone;
use pellucid_core::{Control, Domain, Team, random};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;

use super::Correction;
use super::field::Smoothed;
use super::moments::{Moments, Owner};
use super::quadratic::{Quadratic, TERMS, evaluate};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, Learned, MaterialGradient, Object, PredictError};

/// Points that one task corrects.
const CHUNK: usize = 4096;
const ANCHOR: Domain = Domain::new("anchor");

pub(super) struct BoundCorrected {
    object: Arc<Object>,
    fast: Box<dyn BoundPredictor>,
    unbiased: Box<dyn BoundPredictor>,
    settings: Correction,
    owner: Owner,
    memory: Moments,
    /// What `memory` holds, ascending.
    passes: Vec<u32>,
    /// Both predictors hold the labels of the last update.
    current: bool,
    /// The last draw's correction for these labels and this memory; a pure function of them.
    found: Mutex<Option<Arc<Found>>>,
}

/// A draw's anchors and what they tell.
struct Found {
    draw: Draw,
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
    pub(super) fn new(
        fast: Box<dyn BoundPredictor>,
        unbiased: Box<dyn BoundPredictor>,
        settings: Correction,
        name: String,
        object: Arc<Object>,
    ) -> Self {
        let channels = object.channels();
        let owner = Owner { predictor: name, object: object.id(), channels, radius_mm: settings.radius_mm };
        let memory = Moments::new(channels);
        let found = Mutex::new(None);
        Self { object, fast, unbiased, settings, owner, memory, passes: Vec::new(), current: false, found }
    }

    fn forget_found(&mut self) {
        *self.found.get_mut().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// The correction of a draw, and how many paths finding it took.
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
        let channels = self.object.channels();
        let pass = draw.pass.number();
        let domain = ANCHOR.pass(pass);
        let most = u64::MAX / u64::from(self.settings.one_in);
        let anchors: Vec<u32> = (0..self.object.surface().len() as u32)
            .filter(|&p| random::hash(draw.seed, domain, u64::from(p), 0) <= most)
            .collect();
        let mut fast = vec![0.0; anchors.len() * channels];
        let fast_seen = self.fast.predict(&anchors, draw, &mut fast, &control.silent())?;
        let mut truth = vec![0.0; fast.len()];
        let paths = self.unbiased.predict(&anchors, draw, &mut truth, control)?.paths + fast_seen.paths;

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
            new.field.add(position(&self.object, p), self.settings.radius_mm, rest);
        }
        all.field.absorb(self.settings.memory, &new.field);
        let local = all.field.smoothed(channels, control)?;
        let learned = self.owner.write(vec![pass], &new);
        let fast_outside = fast_seen.outside_training;
        Ok((Found { draw, anchors, fast, fast_outside, common, local, learned }, paths))
    }

    /// The fast predictor's values; those at the anchors are at hand where every point is asked for.
    fn fast_values(
        &self,
        points: &[u32],
        found: &Found,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        let all = points.len() == self.object.surface().len()
            && points.iter().enumerate().all(|(i, &p)| i == p as usize);
        if !all {
            return self.fast.predict(points, found.draw, out, control);
        }
        let channels = self.object.channels();
        let mut anchors = found.anchors.iter().peekable();
        let others: Vec<u32> =
            points.iter().copied().filter(|p| anchors.next_if(|a| *a == p).is_none()).collect();
        let mut values = vec![0.0; others.len() * channels];
        let mut seen = self.fast.predict(&others, found.draw, &mut values, control)?;
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
        let (found, paths) = self.find(draw, &reporting(control, &|d, t| control.report(d, 2 * t)))?;
        let seen =
            self.fast_values(points, &found, out, &reporting(control, &|d, t| control.report(t + d, 2 * t)))?;
        let (object, radius) = (&*self.object, self.settings.radius_mm);
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
        if !self.current {
            return Err(PredictError::before_update());
        }
        self.fast.pullback_in(team, points, draw, d_radiance, out, control)
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        if learned.is_empty() {
            return Ok(());
        }
        let moments = self.owner.read(learned)?;
        let known = learned.passes.iter().filter(|p| self.passes.binary_search(p).is_ok()).count();
        if known == learned.passes.len() {
            return Ok(());
        }
        if known > 0 {
            return Err(PredictError::invalid(
                "learned values",
                "some of their passes were absorbed already and some were not",
            ));
        }
        // Every pass that is new fades what was there.
        let passes = i32::try_from(learned.passes.len()).unwrap_or(i32::MAX);
        self.memory.absorb(self.settings.memory.powi(passes), &moments);
        self.passes.extend(&learned.passes);
        self.passes.sort_unstable();
        self.forget_found();
        Ok(())
    }

    fn memory(&self) -> Learned {
        if self.passes.is_empty() {
            return Learned::default();
        }
        self.owner.write(self.passes.clone(), &self.memory)
    }
}

/// A control that stops with `control` and reports elsewhere.
fn reporting<'a>(control: &Control<'a>, report: &'a (dyn Fn(u64, u64) + Sync + 'a)) -> Control<'a> {
    control.silent().with_progress(report)
}
