//! The appearance network as a predictor.

mod bound;
mod sharing;
mod trained_range;

use std::sync::Arc;

use pellucid_core::{Fault, InstructionSet};
use pellucid_rpnn::transform::LevelOrder;
use pellucid_rpnn::{Inference, Precision, RpnnError, TrainedNetwork};
use pellucid_stencil::{Coefficients, Features, StencilError};

use crate::{BoundPredictor, Capabilities, Identity, Object, PredictError, Predictor, WeightsIdentity};

pub use sharing::Sharing;

/// Predicts by the radiance-predicting neural network (Rittig et al. 2021): without noise, in a time that does not
/// depend on how long light travels in the material.
///
/// The same labels give the same values for any number of threads and whatever else is predicted with them. Values on
/// different instruction sets differ by rounding.
#[derive(Clone, Debug)]
pub struct Network {
    trained: Arc<TrainedNetwork>,
    digest: String,
    precision: Precision,
    sharing: Option<Sharing>,
}

impl Network {
    /// A predictor with weights and what they were trained for. Points share coarse levels where the weights read them
    /// first.
    pub fn new(trained: impl Into<Arc<TrainedNetwork>>, precision: Precision) -> Self {
        let trained = trained.into();
        let sharing = (trained.provenance.form.order == LevelOrder::CoarseToFine).then(Sharing::default);
        Self { digest: trained.weights.digest(), trained, precision, sharing }
    }

    /// The same with another way of sharing, or with all levels of every point its own.
    ///
    /// # Errors
    /// [`PredictError`] when the block's edge is even, there are not 1 to 8 fine levels, or the weights read their
    /// levels from fine to coarse.
    pub fn with_sharing(mut self, sharing: Option<Sharing>) -> Result<Self, PredictError> {
        if let Some(sharing) = sharing {
            sharing.check(self.trained.provenance.form.order)?;
        }
        self.sharing = sharing;
        Ok(self)
    }

    /// A predictor with the weights that this library carries, in bf16.
    ///
    /// # Errors
    /// [`PredictError::Failed`] when they are damaged.
    #[cfg(feature = "weights")]
    pub fn shipped() -> Result<Self, PredictError> {
        Ok(Self::new(pellucid_rpnn::shipped()?, Precision::Bf16))
    }

    /// The weights and what they were trained for.
    pub fn trained(&self) -> &Arc<TrainedNetwork> {
        &self.trained
    }

    /// How points share coarse levels.
    pub fn sharing(&self) -> Option<Sharing> {
        self.sharing
    }

    /// The instructions that the network's kernels run on.
    fn used(&self) -> InstructionSet {
        InstructionSet::detect()
    }

    fn inference(&self) -> Result<Inference, PredictError> {
        Ok(Inference::new(&self.trained.weights, self.trained.provenance.form, self.precision)?)
    }

    fn coefficients(object: &Object) -> Result<Coefficients, PredictError> {
        Ok(Coefficients::all(object.materials(), Features::ScatterAbsorb)?)
    }
}

impl Predictor for Network {
    fn identity(&self) -> Identity {
        let TrainedNetwork { weights, provenance } = &*self.trained;
        let history = provenance.history.lines().map(str::to_owned).collect();
        let weights = WeightsIdentity {
            digest: self.digest.clone(),
            variant: weights.variant().name().to_owned(),
            history,
        };
        let sharing = self.sharing.map_or_else(
            || "none".to_owned(),
            |s| format!("{} levels of a point's own, the others of a block of {}", s.fine_levels, s.block),
        );
        Identity::new("rpnn", self.used(), false)
            .with("precision", format!("{:?}", self.precision).to_lowercase())
            .with("sharing", sharing)
            .with_weights(weights)
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        self.trained.provenance.check(object.frame().pitch().mm(), object.refractive_index())?;
        Self::coefficients(object)?;
        Ok(Capabilities::new(false))
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        self.supports(&object)?;
        Ok(Box::new(bound::BoundNetwork::new(self, object)?))
    }
}

impl From<StencilError> for PredictError {
    fn from(error: StencilError) -> Self {
        match error {
            StencilError::Cancelled => Self::Cancelled,
            StencilError::Invalid(fault) => Self::Invalid(fault),
            StencilError::Unsupported(fault) => Self::Unsupported(fault),
            other => Self::failed("rpnn", other),
        }
    }
}

impl From<RpnnError> for PredictError {
    fn from(error: RpnnError) -> Self {
        match error {
            RpnnError::NotTrainedFor { field, reason } => {
                Self::Unsupported(Fault::new(field, reason).remedy("use the path tracer"))
            }
            other => Self::failed("rpnn", other),
        }
    }
}
