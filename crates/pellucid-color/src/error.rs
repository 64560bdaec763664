//! What can go wrong in this crate.

use pellucid_voxel::VoxelError;

/// Errors of colour and reflectance computations.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ColorError {
    /// A value breaks a stated rule; `what` names it.
    #[error("{what}: {why}")]
    Invalid {
        /// The argument or field.
        what: String,
        /// The rule it breaks and the remedy.
        why: String,
    },
    /// A well-formed request beyond what is implemented.
    #[error("{what} is not supported: {why}")]
    Unsupported {
        /// The argument or field.
        what: String,
        /// The limit and the remedy.
        why: String,
    },
    /// The caller's flag asked to stop.
    #[error("cancelled")]
    Cancelled,
}

impl ColorError {
    pub(crate) fn invalid(what: impl Into<String>, why: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), why: why.into() }
    }

    pub(crate) fn unsupported(what: impl Into<String>, why: impl Into<String>) -> Self {
        Self::Unsupported { what: what.into(), why: why.into() }
    }
}

impl From<VoxelError> for ColorError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            other => Self::invalid("materials", other.to_string()),
        }
    }
}
