//! The crate's error type.

use std::path::Path;

use pellucid_core::staging::StagingError;
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
    /// The output folder may not be replaced.
    #[error(transparent)]
    Output(StagingError),
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

    /// A file whose contents are wrong.
    pub(crate) fn file(path: &Path, reason: impl Into<String>) -> Self {
        Self::invalid(path.display().to_string(), reason)
    }

    /// An error while a file's data was read, at `place`: damage, or the disk's.
    #[cfg(any(feature = "gcvf", feature = "nrrd", feature = "npy"))]
    pub(crate) fn reading(path: &Path, error: std::io::Error, place: &str) -> Self {
        match (error.raw_os_error(), error.kind()) {
            (Some(_), _) => FileError::at("read", path)(error).into(),
            // A decoder's own.
            (None, std::io::ErrorKind::UnexpectedEof) => Self::file(path, format!("ends within {place}")),
            _ => Self::file(path, format!("is damaged at {place}: {error}")),
        }
    }

    /// The same of a file's contents, with its name first.
    pub(crate) fn in_file(self, path: &Path) -> Self {
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

impl From<Cancelled> for SliceError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<StagingError> for SliceError {
    fn from(error: StagingError) -> Self {
        match error {
            StagingError::File(error) => Self::Io(error),
            StagingError::Invalid(fault) => Self::Invalid(fault),
            other => Self::Output(other),
        }
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
