//! The crate's error type.

use pellucid_core::{Cancelled, Fault};
use pellucid_voxel::VoxelError;

/// Why an appearance predictor gave no prediction.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictError {
    /// The object, the labels, the points or the predictor's own data contradict each other.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The object is well formed but outside what the predictor handles.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// The predictor behind the interface failed for a reason of its own.
    #[error("predictor {predictor} failed")]
    Failed {
        /// [`Identity::name`](crate::Identity::name).
        predictor: String,
        /// The cause.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl PredictError {
    /// A [`PredictError::Invalid`] from what is concerned and what is wrong with it.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// What [`BoundPredictor::predict`](crate::BoundPredictor::predict) says where no update went before, or the last
    /// one failed.
    pub fn before_update() -> Self {
        Self::Invalid(Fault::new("labels", "there are none yet").remedy("call update first"))
    }

    /// A [`PredictError::Unsupported`] from what is concerned and the limit.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }

    /// A [`PredictError::Failed`] from the predictor's name and its own error.
    pub fn failed(
        predictor: impl Into<String>,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Self {
        Self::Failed { predictor: predictor.into(), source: source.into() }
    }
}

impl From<Cancelled> for PredictError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<VoxelError> for PredictError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Invalid(fault) => Self::Invalid(fault),
            VoxelError::Unsupported(fault) => Self::Unsupported(fault),
            other => Self::invalid("voxel data", other.to_string()),
        }
    }
}
