//! The appearance network as a predictor.

mod backward;
mod bound;
#[cfg(feature = "candle")]
mod candle;
mod evaluate;
mod nodes;
mod spread;
mod trained_range;

#[cfg(feature = "candle")]
pub use candle::CandleNetwork;

use std::sync::Arc;

use pellucid_core::InstructionSet;
use pellucid_rpnn::transform::LevelOrder;
use pellucid_rpnn::variant::Head;
use pellucid_rpnn::{Inference, Precision, RpnnError, TrainedNetwork};
use pellucid_stencil::{Coefficients, Features, StencilError};

use bound::BoundNetwork;
use evaluate::Engine;
use trained_range::TrainedRange;

use crate::{
    BoundPredictor, Capabilities, Identity, Object, PredictError, Predictor, Sharing, WeightsIdentity,
};

/// Predicts by the radiance-predicting neural network (Rittig et al. 2021): without noise, in a time that does not
/// depend on how long light travels in the material.
///
/// The same labels give the same values for any number of threads and whatever else is predicted with them. Values on
/// different instruction sets differ by rounding.
///
/// [`BoundPredictor::pullback`] is the derivative of what is predicted, with all that points share; in bf16 to about a
/// hundredth. With an exact first flight it is sharp on the ray of each point and smooth about it. Where a radiance is
/// cut off to zero it is zero.
#[derive(Clone, Debug)]
pub struct Network {
    trained: Arc<TrainedNetwork>,
    digest: String,
    precision: Precision,
    sharing: Option<Sharing>,
    instruction_set: InstructionSet,
}

impl Network {
    /// A predictor with weights and what they were trained for. Points share coarse levels where the weights read them
    /// first.
    pub fn new(trained: impl Into<Arc<TrainedNetwork>>, precision: Precision) -> Self {
        let trained = trained.into();
        let sharing = Some(Sharing::default()).map(|s| possible(&trained, s));
        let instruction_set = InstructionSet::chosen();
        Self { digest: trained.weights.digest(), trained, precision, sharing, instruction_set }
    }

    /// The same with another way of sharing, or with all of every point its own.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] as [`Sharing::check`] says; [`PredictError::Unsupported`] when levels are to be shared
    /// that the weights read from fine to coarse.
    pub fn with_sharing(mut self, sharing: Option<Sharing>) -> Result<Self, PredictError> {
        if let Some(sharing) = sharing {
            sharing.check()?;
            if sharing.shares_levels() && self.trained.provenance.form.order != LevelOrder::CoarseToFine {
                return Err(PredictError::unsupported(
                    "sharing",
                    "the weights read their levels from fine to coarse; give every point all 9 levels of its own",
                ));
            }
        }
        self.sharing = sharing;
        Ok(self)
    }

    /// The same with `sharing` as far as the weights allow it: levels are shared where they read coarse ones first.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] as [`Sharing::check`] says.
    pub fn with_sharing_where_possible(self, sharing: Option<Sharing>) -> Result<Self, PredictError> {
        sharing.map_or(Ok(()), Sharing::check)?;
        let sharing = sharing.map(|s| possible(&self.trained, s));
        self.with_sharing(sharing)
    }

    /// The same on other instructions than [`InstructionSet::chosen`]; values differ by rounding. The identity records
    /// the least set that gives the same values.
    ///
    /// # Errors
    /// [`PredictError::Unsupported`] where the processor lacks them.
    pub fn with_instruction_set(mut self, set: InstructionSet) -> Result<Self, PredictError> {
        self.instruction_set = set.require().map_err(PredictError::Unsupported)?;
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

    /// What points share.
    pub fn sharing(&self) -> Option<Sharing> {
        self.sharing
    }

    fn inference(&self) -> Result<Inference, PredictError> {
        let inference = Inference::new(&self.trained.weights, self.trained.provenance.form, self.precision)?;
        Ok(inference.with_instruction_set(self.instruction_set)?)
    }

    fn coefficients(object: &Object) -> Result<Coefficients, PredictError> {
        Ok(Coefficients::all(object.materials(), Features::ScatterAbsorb)?)
    }
}

/// `sharing` without what the weights' order of levels does not allow.
fn possible(trained: &TrainedNetwork, sharing: Sharing) -> Sharing {
    match trained.provenance.form.order {
        LevelOrder::CoarseToFine => sharing,
        LevelOrder::FineToCoarse => Sharing { fine_levels: 9, ..sharing },
    }
}

/// A way of sharing in words.
fn described(sharing: Option<Sharing>, head: Head) -> String {
    let Some(sharing) = sharing else { return "none".to_owned() };
    let place = match sharing.spacing_mm > 0.0 && head == Head::FirstFlight {
        true => format!("run every {} mm", sharing.spacing_mm),
        false => "run for every point".to_owned(),
    };
    match sharing.shares_levels() {
        true => format!(
            "{place}, {} levels of its own, the others every {} mm",
            sharing.fine_levels, sharing.coarse_mm
        ),
        false => format!("{place}, all levels of its own"),
    }
}

/// What a report records of a network.
fn identity(
    trained: &TrainedNetwork,
    digest: &str,
    precision: Precision,
    sharing: String,
    set: InstructionSet,
) -> Identity {
    let TrainedNetwork { weights, provenance } = trained;
    let history = provenance.history.lines().map(str::to_owned).collect();
    let variant = weights.variant().name().to_owned();
    Identity::new("rpnn", set, false)
        .with("head", weights.head().name())
        .with("precision", format!("{precision:?}").to_lowercase())
        .with("sharing", sharing)
        .with_weights(WeightsIdentity { digest: digest.to_owned(), variant, history })
}

/// What a network can do for an object.
fn supports(trained: &TrainedNetwork, object: &Object) -> Result<Capabilities, PredictError> {
    let fits = trained.provenance.check(object.frame().pitch().mm(), object.refractive_index());
    fits.map_err(|error| match error.into() {
        PredictError::Unsupported(fault) => PredictError::Unsupported(fault.remedy("use the path tracer")),
        other => other,
    })?;
    Network::coefficients(object)?;
    Ok(Capabilities::new(false))
}

impl Predictor for Network {
    fn identity(&self) -> Identity {
        // The least set with these values, so that equal values are recorded alike.
        let set = self.inference().map_or(self.instruction_set, |i| i.instruction_set());
        let sharing = described(self.sharing, self.trained.weights.head());
        identity(&self.trained, &self.digest, self.precision, sharing, set)
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        Ok(supports(&self.trained, object)?.with_gradient())
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        self.supports(&object)?;
        let coefficients = Self::coefficients(&object)?;
        let trained = TrainedRange::new(&self.trained.provenance);
        let engine = Engine::new(self.inference()?, coefficients, trained, self.instruction_set);
        Ok(Box::new(BoundNetwork::new(Box::new(engine), self.sharing, object)?))
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
            RpnnError::Invalid(fault) => Self::Invalid(fault),
            RpnnError::Unsupported(fault) => Self::Unsupported(fault),
            RpnnError::Cancelled => Self::Cancelled,
            other => Self::failed("rpnn", other),
        }
    }
}
