//! One predictor's values with another's gradient.

use std::sync::Arc;

use pellucid_core::team::Alone;
use pellucid_core::{Control, Team};
use pellucid_voxel::LabelGrid;

use crate::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Identity, Learned, MaterialGradient, Object,
    PredictError, Predictor,
};

/// Predicts by one predictor and takes the gradient of another: values without bias by paths, say, and a gradient
/// without noise by the network.
///
/// ```
/// use pellucid_predict::{MonteCarlo, Predictor, WithGradient};
/// let both = WithGradient::new(MonteCarlo::new(8)?, MonteCarlo::new(2)?);
/// assert_eq!(both.identity().name, "mc");
/// # Ok::<(), pellucid_predict::PredictError>(())
/// ```
#[derive(Clone, Debug)]
pub struct WithGradient<V, G> {
    values: V,
    gradient: G,
}

impl<V: Predictor, G: Predictor> WithGradient<V, G> {
    /// The values of one with the gradient of the other.
    pub fn new(values: V, gradient: G) -> Self {
        Self { values, gradient }
    }
}

impl<V: Predictor, G: Predictor> Predictor for WithGradient<V, G> {
    fn identity(&self) -> Identity {
        let (values, gradient) = (self.values.identity(), self.gradient.identity());
        let mut both = Identity { exact: values.exact && gradient.exact, ..values };
        both = both.with("gradient", &gradient.name);
        for (name, value) in &gradient.settings {
            both = both.with(format!("gradient {name}"), value);
        }
        both.weights = both.weights.or(gradient.weights);
        both
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        let values = self.values.supports(object)?;
        Ok(Capabilities { gradient: self.gradient.supports(object)?.gradient, ..values })
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        let values = self.values.bind(Arc::clone(&object))?;
        Ok(Box::new(BoundBoth { values, gradient: self.gradient.bind(object)? }))
    }
}

struct BoundBoth {
    values: Box<dyn BoundPredictor>,
    gradient: Box<dyn BoundPredictor>,
}

impl BoundPredictor for BoundBoth {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        self.values.update(labels, changed, control)?;
        self.gradient.update(labels, changed, control)
    }

    fn predict(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        self.values.predict(points, draw, out, control)
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
        self.gradient.pullback_in(team, points, draw, d_radiance, out, control)
    }

    fn absorb(&mut self, learned: &Learned) -> Result<(), PredictError> {
        self.values.absorb(learned)
    }

    fn memory(&self) -> Learned {
        self.values.memory()
    }
}
