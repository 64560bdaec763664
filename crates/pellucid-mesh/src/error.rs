//! The crate's error type.

use pellucid_core::Cancelled;
use pellucid_voxel::VoxelError;

/// What can go wrong when a model is imported or voxelised.
///
/// `file` is the name of the model as it was given, `object` the part of it that is at fault
/// (`mesh 2 "Body", primitive 0, POSITION (accessor 7)`), `remedy` what the user can do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file or an argument breaks a rule.
    #[error("{file}: {object}: {reason} ({remedy})")]
    Invalid {
        /// Name of the model.
        file: String,
        /// The part or argument at fault.
        object: String,
        /// What is wrong.
        reason: String,
        /// What to do about it.
        remedy: String,
    },
    /// The file may be well formed but asks for more than this crate handles.
    #[error("{file}: {object}: unsupported: {reason} ({remedy})")]
    Unsupported {
        /// Name of the model.
        file: String,
        /// The part or argument at fault.
        object: String,
        /// What is not handled, or which limit is passed.
        reason: String,
        /// What to do about it.
        remedy: String,
    },
    /// A file could not be read.
    #[error("{file}: {object}: cannot be read ({remedy})")]
    Io {
        /// Name of the model.
        file: String,
        /// The part that refers to the unreadable file.
        object: String,
        /// The operating system's error; not repeated in the text.
        #[source]
        source: std::io::Error,
        /// What to do about it.
        remedy: String,
    },
    /// The voxel grid refused the request.
    #[error(transparent)]
    Voxel(VoxelError),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl MeshError {
    /// A [`MeshError::Invalid`] from its parts.
    pub fn invalid(
        file: impl Into<String>,
        object: impl Into<String>,
        reason: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Invalid {
            file: file.into(),
            object: object.into(),
            reason: reason.into(),
            remedy: remedy.into(),
        }
    }

    /// A [`MeshError::Unsupported`] from its parts.
    pub fn unsupported(
        file: impl Into<String>,
        object: impl Into<String>,
        reason: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Unsupported {
            file: file.into(),
            object: object.into(),
            reason: reason.into(),
            remedy: remedy.into(),
        }
    }
}

impl From<VoxelError> for MeshError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            other => Self::Voxel(other),
        }
    }
}

impl From<Cancelled> for MeshError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
