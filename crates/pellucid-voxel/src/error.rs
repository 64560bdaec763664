//! The crate's error type.

use std::path::Path;

use pellucid_core::{Cancelled, Fault, FileError};

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
    /// A file could not be read.
    #[error(transparent)]
    Io(#[from] FileError),
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

    /// The same of a file's contents, with its name first.
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

impl From<Cancelled> for VoxelError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
