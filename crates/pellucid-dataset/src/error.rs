//! The crate's error type.

use std::path::PathBuf;

use pellucid_core::Cancelled;
use pellucid_stencil::StencilError;
use pellucid_trace::TraceError;
use pellucid_voxel::VoxelError;

/// Why a data set could not be made or read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// A recipe or an argument is out of range.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The field or argument.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// A file is damaged, or made by or for something else.
    #[error("{path}: unsupported {field}: {reason}")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The part of it that does not fit.
        field: String,
        /// What it holds and what is needed.
        reason: String,
    },
    /// A file could not be read or written.
    #[error("{path}: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's or decoder's reason.
        reason: String,
    },
    /// A volume could not be built.
    #[error(transparent)]
    Voxel(VoxelError),
    /// A descriptor could not be extracted.
    #[error(transparent)]
    Stencil(StencilError),
    /// A label could not be traced.
    #[error(transparent)]
    Trace(TraceError),
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// The thread that makes samples could not be started, or ended early.
    #[error("the thread that makes samples failed: {0}")]
    Worker(String),
}

impl DatasetError {
    pub(crate) fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }
}

impl From<VoxelError> for DatasetError {
    fn from(error: VoxelError) -> Self {
        if matches!(error, VoxelError::Cancelled) { Self::Cancelled } else { Self::Voxel(error) }
    }
}

impl From<StencilError> for DatasetError {
    fn from(error: StencilError) -> Self {
        if matches!(error, StencilError::Cancelled) { Self::Cancelled } else { Self::Stencil(error) }
    }
}

impl From<TraceError> for DatasetError {
    fn from(error: TraceError) -> Self {
        if matches!(error, TraceError::Cancelled) { Self::Cancelled } else { Self::Trace(error) }
    }
}

impl From<Cancelled> for DatasetError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
