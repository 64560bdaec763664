//! The crate's error type.

use std::path::Path;

use pellucid_core::{Cancelled, Fault, FileError};
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
    /// A file could not be read.
    #[error(transparent)]
    Io(#[from] FileError),
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

    /// The same, of a file.
    pub fn in_file(self, path: &Path) -> Self {
        let named = |mut fault: Fault| {
            fault.subject = format!("{}: {}", path.display(), fault.subject);
            fault
        };
        match self {
            Self::Invalid(fault) => Self::Invalid(named(fault)),
            Self::Unsupported(fault) => Self::Unsupported(named(fault)),
            other => other,
        }
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
