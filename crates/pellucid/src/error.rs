//! The facade's error type: which crate failed, or which file could not be written.

use std::path::PathBuf;

use pellucid_voxel::VoxelError;

/// Why a print job ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PrintError {
    /// A setting or a volume is out of range, or the job was cancelled.
    #[error(transparent)]
    Voxel(#[from] VoxelError),
    /// The model could not be imported or voxelised.
    #[error(transparent)]
    Mesh(#[from] pellucid_mesh::MeshError),
    /// Colour tables could not be built.
    #[error(transparent)]
    Color(#[from] pellucid_color::ColorError),
    /// Light transport failed.
    #[error(transparent)]
    Trace(#[from] pellucid_trace::TraceError),
    /// The network's weights could not be read.
    #[cfg(feature = "rpnn")]
    #[error(transparent)]
    Rpnn(#[from] pellucid_rpnn::RpnnError),
    /// The predictor does not fit the job.
    #[error(transparent)]
    Predict(#[from] pellucid_refine::PredictError),
    /// Refinement failed.
    #[error(transparent)]
    Refine(#[from] pellucid_refine::RefineError),
    /// Slices could not be written.
    #[error(transparent)]
    Slice(#[from] pellucid_slice::SliceError),
    /// The proof could not be made or written.
    #[error(transparent)]
    Proof(#[from] pellucid_proof::ProofError),
    /// A file could not be written.
    #[error("{path}: {reason}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's or encoder's reason.
        reason: String,
    },
}

impl From<pellucid_core::Cancelled> for PrintError {
    fn from(_: pellucid_core::Cancelled) -> Self {
        Self::Voxel(VoxelError::Cancelled)
    }
}

impl PrintError {
    /// True when the job ended because the caller asked it to.
    pub fn is_cancelled(&self) -> bool {
        matches!(
            self,
            Self::Voxel(VoxelError::Cancelled)
                | Self::Mesh(pellucid_mesh::MeshError::Cancelled)
                | Self::Color(pellucid_color::ColorError::Cancelled)
                | Self::Trace(pellucid_trace::TraceError::Cancelled)
                | Self::Predict(pellucid_refine::PredictError::Cancelled)
                | Self::Refine(pellucid_refine::RefineError::Cancelled)
                | Self::Slice(pellucid_slice::SliceError::Cancelled)
                | Self::Proof(pellucid_proof::ProofError::Cancelled)
        )
    }

    pub(crate) fn io(path: impl Into<PathBuf>, reason: impl std::fmt::Display) -> Self {
        Self::Io { path: path.into(), reason: reason.to_string() }
    }
}
