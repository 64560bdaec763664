//! The facade's error type: which crate failed, or which file could not be written.

use pellucid_core::{Cancelled, Fault, FileError};

/// Why a print job ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PrintError {
    /// A setting is out of range, or two inputs do not fit together.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The request is well formed but beyond what can be done, here or by the printer.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// What an interrupted job left does not belong to this one, or cannot be used.
    #[error(transparent)]
    Checkpoint(#[from] pellucid_core::CheckpointError),
    /// An interrupted job left checkpoints, and nobody said what to do with them.
    #[error(
        "an interrupted job left {}; go on with it by --resume (`Workspace::resume`), or remove that folder to start anew",
        folder.display()
    )]
    Interrupted {
        /// The folder of checkpoints.
        folder: std::path::PathBuf,
    },
    /// A volume is out of range.
    #[error(transparent)]
    Voxel(pellucid_voxel::VoxelError),
    /// The model could not be imported or voxelised.
    #[error(transparent)]
    Mesh(pellucid_mesh::MeshError),
    /// Colour tables could not be built.
    #[error(transparent)]
    Color(pellucid_color::ColorError),
    /// The predictor does not fit the job, or failed.
    #[error(transparent)]
    Predict(pellucid_predict::PredictError),
    /// Refinement failed.
    #[error(transparent)]
    Refine(pellucid_refine::RefineError),
    /// The proof could not be drawn.
    #[error(transparent)]
    Proof(pellucid_proof::ProofError),
    /// Slices could not be written.
    #[error(transparent)]
    Slice(pellucid_slice::SliceError),
    /// The output folder may not be written.
    #[error(transparent)]
    Staging(#[from] pellucid_core::staging::StagingError),
    /// The caller asked for the job to stop.
    #[error("cancelled")]
    Cancelled,
}

/// A crate's cancellation is the job's.
macro_rules! from_crate {
    ($($variant:ident($error:path)),* $(,)?) => {$(
        impl From<$error> for PrintError {
            fn from(error: $error) -> Self {
                type Error = $error;
                match error {
                    Error::Cancelled => Self::Cancelled,
                    other => Self::$variant(other),
                }
            }
        }
    )*};
}

from_crate! {
    Voxel(pellucid_voxel::VoxelError),
    Mesh(pellucid_mesh::MeshError),
    Color(pellucid_color::ColorError),
    Predict(pellucid_predict::PredictError),
    Refine(pellucid_refine::RefineError),
    Proof(pellucid_proof::ProofError),
    Slice(pellucid_slice::SliceError),
}

impl From<Cancelled> for PrintError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl PrintError {
    /// True when the job ended because the caller asked it to.
    pub fn is_cancelled(&self) -> bool {
        matches!(self, Self::Cancelled)
    }

    pub(crate) fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }
}
