//! What predictors made of a fast one and an unbiased one have in common.

use std::sync::{Arc, Mutex, PoisonError};

use pellucid_core::{Control, Team};
use pellucid_voxel::LabelGrid;

use crate::{
    BoundPredictor, Changed, Draw, Identity, Learned, MaterialGradient, Object, ObjectId, PredictError,
    Predictor,
};

/// The names of both with `between` them; their settings follow their names, as in `mc.spp`.
pub(crate) fn identity(fast: &dyn Predictor, between: char, unbiased: &dyn Predictor) -> Identity {
    let (fast, unbiased) = (fast.identity(), unbiased.identity());
    // Where one of them depends on its instructions, so do the values.
    let set = if fast.exact { unbiased.instruction_set } else { fast.instruction_set };
    let name = format!("{}{between}{}", fast.name, unbiased.name);
    let mut identity = Identity::new(name, set, fast.exact && unbiased.exact);
    for part in [&fast, &unbiased] {
        for (setting, value) in &part.settings {
            identity = identity.with(format!("{}.{setting}", part.name), value);
        }
    }
    identity.weights = fast.weights.or(unbiased.weights);
    identity
}

/// Both, bound to one object.
pub(crate) struct Pair {
    pub(crate) object: Arc<Object>,
    pub(crate) fast: Box<dyn BoundPredictor>,
    pub(crate) unbiased: Box<dyn BoundPredictor>,
    /// Both hold the labels of the last update.
    current: bool,
}

impl Pair {
    pub(crate) fn new(
        object: Arc<Object>,
        fast: &dyn Predictor,
        unbiased: &dyn Predictor,
    ) -> Result<Self, PredictError> {
        let (fast, unbiased) = (fast.bind(Arc::clone(&object))?, unbiased.bind(Arc::clone(&object))?);
        Ok(Self { object, fast, unbiased, current: false })
    }

    pub(crate) fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        // After a failure neither may trust what is said to have changed.
        let changed = if std::mem::take(&mut self.current) { changed } else { Changed::Unknown };
        self.object.check_labels(labels)?;
        self.fast.update(labels, changed, control)?;
        self.unbiased.update(labels, changed, control)?;
        self.current = true;
        Ok(())
    }

    /// Refuses what cannot be predicted.
    pub(crate) fn check(
        &self,
        points: &[u32],
        values: usize,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.check_current()?;
        self.object.check_points(points, values)?;
        Ok(control.check()?)
    }

    fn check_current(&self) -> Result<(), PredictError> {
        if self.current { Ok(()) } else { Err(PredictError::before_update()) }
    }

    /// By the fast predictor alone.
    pub(crate) fn pullback_in(
        &self,
        team: &dyn Team,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.check_current()?;
        self.fast.pullback_in(team, points, draw, d_radiance, out, control)
    }
}

/// What the last draw found, for the same labels and memory; a pure function of them.
pub(crate) struct Last<T>(Mutex<Option<(Draw, Arc<T>)>>);

impl<T> Last<T> {
    pub(crate) fn none() -> Self {
        Self(Mutex::new(None))
    }

    pub(crate) fn forget(&mut self) {
        *self.0.get_mut().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// What a draw found, and how many paths finding it took now.
    pub(crate) fn of(
        &self,
        draw: Draw,
        find: impl FnOnce() -> Result<(T, u64), PredictError>,
    ) -> Result<(Arc<T>, u64), PredictError> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some((_, found)) = kept.filter(|(of, _)| *of == draw) {
            return Ok((found, 0));
        }
        let (found, paths) = find()?;
        let found = Arc::new(found);
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some((draw, Arc::clone(&found)));
        Ok((found, paths))
    }
}

/// The halves of an object's identity, as numbers that f64 holds.
pub(crate) fn halves(ObjectId(id): ObjectId) -> [f64; 2] {
    [(id >> 32) as f64, (id & 0xffff_ffff) as f64]
}

pub(crate) fn not_learned(reason: impl Into<String>) -> PredictError {
    PredictError::invalid("learned values", reason.into())
}

/// Refuses what another predictor learned, or what is of no passes or passes out of order.
pub(crate) fn check_learned(learned: &Learned, predictor: &str) -> Result<(), PredictError> {
    if learned.predictor != predictor {
        return Err(not_learned(format!("of {}; this predictor is {predictor}", learned.predictor)));
    }
    if learned.passes.is_empty() || !learned.passes.is_sorted_by(|a, b| a < b) {
        return Err(not_learned("without passes, or passes that do not ascend"));
    }
    Ok(())
}

/// Whether passes are still to be taken in, beside those that are `known`, ascending.
pub(crate) fn are_new(passes: &[u32], known: &[u32]) -> Result<bool, PredictError> {
    match passes.iter().filter(|p| known.binary_search(p).is_ok()).count() {
        0 => Ok(true),
        count if count == passes.len() => Ok(false),
        _ => Err(not_learned("some of their passes were absorbed already and some were not")),
    }
}

/// A control that stops with `control` and reports elsewhere.
pub(crate) fn reporting<'a>(
    control: &Control<'a>,
    report: &'a (dyn Fn(u64, u64) + Sync + 'a),
) -> Control<'a> {
    control.silent().with_progress(report)
}
