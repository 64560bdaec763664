//! The crate's error type.

use std::path::Path;

use pellucid_core::{Cancelled, Fault, FileError};
use pellucid_stencil::StencilError;
use pellucid_trace::TraceError;
use pellucid_voxel::VoxelError;

/// Why a data set could not be made, read or judged by.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A recipe or an argument is out of range, or a file's content is damaged.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// A file is whole but made by or for something else, or the request is beyond what this crate handles.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
    /// The thread that makes samples could not be started, or ended early.
    #[error("the thread that makes samples failed")]
    Worker(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// The predictor that is judged failed.
    #[error("the predictor under judgement failed")]
    Predictor(#[source] Box<dyn std::error::Error + Send + Sync>),
}

impl DatasetError {
    /// A [`DatasetError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// A [`DatasetError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }

    /// A file that is damaged: the part concerned, what is wrong, what to do.
    pub(crate) fn damaged(path: &Path, part: &str, reason: impl Into<String>, remedy: &str) -> Self {
        Self::Invalid(in_file(path, part, reason, remedy))
    }

    /// A file that belongs to something else: the part concerned, what is wrong, what to do.
    pub(crate) fn foreign(path: &Path, part: &str, reason: impl Into<String>, remedy: &str) -> Self {
        Self::Unsupported(in_file(path, part, reason, remedy))
    }
}

fn in_file(path: &Path, part: &str, reason: impl Into<String>, remedy: &str) -> Fault {
    Fault::new(format!("{}, {part}", path.display()), reason).remedy(remedy)
}

impl From<Cancelled> for DatasetError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<VoxelError> for DatasetError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Unsupported(fault) => Self::Unsupported(fault),
            VoxelError::Invalid(fault) => Self::Invalid(fault),
            other => Self::invalid("voxel data", other.to_string()),
        }
    }
}

impl From<StencilError> for DatasetError {
    fn from(error: StencilError) -> Self {
        match error {
            StencilError::Cancelled => Self::Cancelled,
            StencilError::Unsupported(fault) => Self::Unsupported(fault),
            StencilError::Invalid(fault) => Self::Invalid(fault),
            other => Self::invalid("stencil", other.to_string()),
        }
    }
}

impl From<TraceError> for DatasetError {
    fn from(error: TraceError) -> Self {
        match error {
            TraceError::Cancelled => Self::Cancelled,
            TraceError::Unsupported(fault) => Self::Unsupported(fault),
            TraceError::Invalid(fault) => Self::Invalid(fault),
            TraceError::Io(error) => Self::Io(error),
            other => Self::invalid("tracing", other.to_string()),
        }
    }
}
