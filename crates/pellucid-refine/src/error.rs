//! The crate's error types.

use pellucid_voxel::VoxelError;

/// Why an appearance predictor gave no prediction.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PredictError {
    /// The scene, the points or the predictor's own data contradict each other.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The argument or field concerned.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The scene is well formed but outside what the predictor handles.
    #[error("unsupported {field}: {reason}")]
    Unsupported {
        /// The argument or field concerned.
        field: String,
        /// The limit, and how to stay within it.
        reason: String,
    },
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
    /// The predictor behind the adapter failed for a reason of its own.
    #[error("predictor {predictor} failed")]
    Failed {
        /// [`AppearancePredictor::name`](crate::AppearancePredictor::name).
        predictor: String,
        /// The cause.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

impl PredictError {
    /// A [`PredictError::Invalid`] from its two parts.
    pub fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }

    /// A [`PredictError::Unsupported`] from its two parts.
    pub fn unsupported(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported { field: field.into(), reason: reason.into() }
    }

    /// A [`PredictError::Failed`] from the predictor's name and its own error.
    pub fn failed(
        predictor: impl Into<String>,
        source: impl Into<Box<dyn std::error::Error + Send + Sync>>,
    ) -> Self {
        Self::Failed { predictor: predictor.into(), source: source.into() }
    }
}

impl From<VoxelError> for PredictError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Invalid { field, reason } => Self::Invalid { field, reason },
            VoxelError::Unsupported { field, reason } => Self::Unsupported { field, reason },
            other => Self::invalid("voxel data", other.to_string()),
        }
    }
}

/// What can go wrong in a refinement.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RefineError {
    /// A setting or an input is outside its documented range, or two inputs do not fit together.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The argument or field concerned.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The request is well formed but outside what this crate handles.
    #[error("unsupported {field}: {reason}")]
    Unsupported {
        /// The argument or field concerned.
        field: String,
        /// The limit, and how to stay within it.
        reason: String,
    },
    /// The caller asked for the work to stop. The grid holds the best iterate so far.
    #[error("cancelled")]
    Cancelled,
    /// The appearance predictor failed.
    #[error("prediction in iteration {iteration}")]
    Predict {
        /// The iteration, 0 for the unrefined halftone.
        iteration: u32,
        /// The predictor's error.
        #[source]
        source: PredictError,
    },
}

impl RefineError {
    /// A [`RefineError::Invalid`] from its two parts.
    pub fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }

    /// A [`RefineError::Unsupported`] from its two parts.
    pub fn unsupported(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported { field: field.into(), reason: reason.into() }
    }

    /// A predictor's error in `iteration`; cancellation stays cancellation.
    pub fn predict(iteration: u32, source: PredictError) -> Self {
        match source {
            PredictError::Cancelled => Self::Cancelled,
            source => Self::Predict { iteration, source },
        }
    }
}

impl From<VoxelError> for RefineError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Invalid { field, reason } => Self::Invalid { field, reason },
            VoxelError::Unsupported { field, reason } => Self::Unsupported { field, reason },
            other => Self::invalid("voxel data", other.to_string()),
        }
    }
}
