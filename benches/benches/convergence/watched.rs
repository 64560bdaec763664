//! What a refinement's labels were on the way.

use std::sync::{Arc, Mutex, PoisonError};

use pellucid::core::Team;
use pellucid::predict::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Identity, Learned, MaterialGradient, Object,
    PredictError, Predictor,
};
use pellucid::voxel::{Control, LabelGrid};

/// Labels of iterates, by iteration.
type Kept = Arc<Mutex<Vec<(u32, LabelGrid)>>>;

/// Predicts as another predictor does, and keeps the labels of some iterates: a refinement brings in those of each.
pub struct Watched {
    predictor: Arc<dyn Predictor>,
    wanted: &'static [u32],
    kept: Kept,
}

impl Watched {
    /// Keeps those of the iterations `wanted`.
    pub fn new(predictor: Arc<dyn Predictor>, wanted: &'static [u32]) -> Self {
        Self { predictor, wanted, kept: Kept::default() }
    }

    /// What was kept.
    pub fn iterates(&self) -> Vec<(u32, LabelGrid)> {
        std::mem::take(&mut *self.kept.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Predictor for Watched {
    fn identity(&self) -> Identity {
        self.predictor.identity()
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        self.predictor.supports(object)
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        let bound = self.predictor.bind(object)?;
        Ok(Box::new(Bound { bound, wanted: self.wanted, next: 0, kept: Arc::clone(&self.kept) }))
    }
}

struct Bound {
    bound: Box<dyn BoundPredictor>,
    wanted: &'static [u32],
    /// The iteration whose labels come next.
    next: u32,
    kept: Kept,
}

impl BoundPredictor for Bound {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.bound.update(labels, changed, control)?;
        if self.wanted.contains(&self.next) {
            let iterate = (self.next, labels.clone());
            self.kept.lock().unwrap_or_else(PoisonError::into_inner).push(iterate);
        }
        self.next += 1;
        Ok(())
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        self.bound.predict(points, draw, out, control)
    }

    fn pullback(
        &self,
        points: &[u32],
        draw: Draw,
        d_radiance: &[f32],
        out: &mut dyn MaterialGradient,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.bound.pullback(points, draw, d_radiance, out, control)
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
        self.bound.pullback_in(team, points, draw, d_radiance, out, control)
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        self.bound.absorb(learned)
    }

    fn memory(&self) -> Learned {
        self.bound.memory()
    }
}
