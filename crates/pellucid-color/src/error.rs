//! The crate's error type.

use pellucid_core::{Cancelled, Fault};
use pellucid_voxel::VoxelError;

/// What can go wrong in colour and reflectance computations.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum ColorError {
    /// A value is outside its documented range, or two inputs do not fit together.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The request is well formed but beyond what this crate handles.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl ColorError {
    /// An [`ColorError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// An [`ColorError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }
}

impl From<Cancelled> for ColorError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<VoxelError> for ColorError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Unsupported(fault) => Self::Unsupported(fault),
            VoxelError::Invalid(fault) => Self::Invalid(fault),
            other => Self::invalid("voxel data", other.to_string()),
        }
    }
}
