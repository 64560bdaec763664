//! The crate's error type.

/// What can go wrong when voxel data is built or read.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum VoxelError {
    /// A value is outside its documented range.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The argument, field or material that holds the value.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The request is well formed but larger than this crate handles.
    #[error("unsupported {field}: {reason}")]
    Unsupported {
        /// The argument or field concerned.
        field: String,
        /// The limit, and how to stay within it.
        reason: String,
    },
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl VoxelError {
    /// An [`VoxelError::Invalid`] from its two parts.
    pub fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }

    /// An [`VoxelError::Unsupported`] from its two parts.
    pub fn unsupported(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported { field: field.into(), reason: reason.into() }
    }
}
