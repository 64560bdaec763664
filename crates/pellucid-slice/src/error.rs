//! The crate's error type.

use std::path::{Path, PathBuf};

use pellucid_core::{Cancelled, Fault, FileError};
use pellucid_voxel::VoxelError;

/// What can go wrong when slices are written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SliceError {
    /// A value is outside its documented range, or two inputs do not fit together.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The request is well formed but beyond what this crate handles.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// The output folder exists and may not be replaced.
    #[error("{} already exists: {reason}", dir.display())]
    Exists {
        /// The folder.
        dir: PathBuf,
        /// Why it was left alone, and what to do.
        reason: String,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl SliceError {
    /// An [`SliceError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// An [`SliceError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }

    /// Wraps a system error with what was being done to which path.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| FileError::at(action, path)(source).into()
    }

    /// A file whose contents are wrong.
    pub(crate) fn file(path: &Path, reason: impl Into<String>) -> Self {
        Self::invalid(path.display().to_string(), reason)
    }
}

impl From<Cancelled> for SliceError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<VoxelError> for SliceError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Unsupported(fault) => Self::Unsupported(fault),
            VoxelError::Invalid(fault) => Self::Invalid(fault),
            other => Self::invalid("voxel data", other.to_string()),
        }
    }
}
