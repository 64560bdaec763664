//! The crate's error type.

use pellucid_core::{Cancelled, Fault};
use pellucid_predict::PredictError;

/// What can go wrong in a refinement.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// A value is outside its documented range, or two inputs do not fit together.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The request is well formed but beyond what this crate handles.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// The appearance predictor failed.
    #[error("prediction in iteration {iteration}")]
    Predict {
        /// The iteration, 0 for the unrefined halftone.
        iteration: u32,
        /// The predictor's error.
        #[source]
        source: PredictError,
    },
    /// The appearance predictor failed while labels were judged.
    #[error("prediction of the judged labels")]
    Judge(#[source] PredictError),
    /// The caller asked for the work to stop. What labels hold then is said where they are handed over.
    #[error("cancelled")]
    Cancelled,
}

impl RefineError {
    /// An [`RefineError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// An [`RefineError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }

    /// A predictor's error in `iteration`; cancellation stays cancellation.
    pub fn predict(iteration: u32, source: PredictError) -> Self {
        match source {
            PredictError::Cancelled => Self::Cancelled,
            source => Self::Predict { iteration, source },
        }
    }

    /// A predictor's error while labels are judged; cancellation stays cancellation.
    pub fn judge(source: PredictError) -> Self {
        match source {
            PredictError::Cancelled => Self::Cancelled,
            source => Self::Judge(source),
        }
    }
}

impl From<Cancelled> for RefineError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
