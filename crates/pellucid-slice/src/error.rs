//! The crate's error type.

use std::path::{Path, PathBuf};

use pellucid_voxel::VoxelError;

/// What can go wrong when slices are written or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SliceError {
    /// A value, file or field is wrong.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The argument, file or field that holds the value.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The request is well formed but the printer or this crate cannot do it.
    #[error("unsupported {field}: {reason}")]
    Unsupported {
        /// The argument, file or field concerned.
        field: String,
        /// The limit, and how to stay within it.
        reason: String,
    },
    /// The output folder exists and may not be replaced.
    #[error("{} already exists: {reason}", dir.display())]
    Exists {
        /// The folder.
        dir: PathBuf,
        /// Why it was left alone, and what to do.
        reason: String,
    },
    /// A file or folder could not be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// What was being done, as an infinitive.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl SliceError {
    pub(crate) fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }

    pub(crate) fn unsupported(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported { field: field.into(), reason: reason.into() }
    }

    /// Wraps a system error with what was being done to which path.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::Io { action, path: path.to_owned(), source }
    }

    /// A file whose contents are wrong.
    pub(crate) fn file(path: &Path, reason: impl Into<String>) -> Self {
        Self::invalid(path.display().to_string(), reason)
    }
}

impl From<VoxelError> for SliceError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Invalid { field, reason } => Self::Invalid { field, reason },
            VoxelError::Unsupported { field, reason } => Self::Unsupported { field, reason },
            VoxelError::Cancelled => Self::Cancelled,
            other => Self::invalid("grid", other.to_string()),
        }
    }
}
