//! The crate's error type.

use pellucid_core::{Cancelled, Fault};

/// What can go wrong when voxel data is built or read.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum VoxelError {
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

impl VoxelError {
    /// An [`VoxelError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// An [`VoxelError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }
}

impl From<Cancelled> for VoxelError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
