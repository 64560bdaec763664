//! The crate's error type.

use pellucid_voxel::VoxelError;

/// What can go wrong when stencils are extracted.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum StencilError {
    /// A value is outside its documented range.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The argument that holds the value.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The request is well formed but larger than this crate handles.
    #[error("unsupported {field}: {reason}")]
    Unsupported {
        /// The argument concerned.
        field: String,
        /// The limit, and how to stay within it.
        reason: String,
    },
    /// The volume could not be read, or the caller asked for the work to stop.
    #[error(transparent)]
    Voxel(#[from] VoxelError),
}

impl StencilError {
    pub(crate) fn invalid(field: &str, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.to_owned(), reason: reason.into() }
    }

    pub(crate) fn unsupported(field: &str, reason: impl Into<String>) -> Self {
        Self::Unsupported { field: field.to_owned(), reason: reason.into() }
    }
}
