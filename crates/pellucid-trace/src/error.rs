//! The crate's error type.

use pellucid_voxel::VoxelError;

/// What can go wrong when a volume is prepared or traced.
#[derive(Debug, thiserror::Error, PartialEq)]
#[non_exhaustive]
pub enum TraceError {
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
    /// A file could not be read.
    #[error("{}: {reason}", path.display())]
    Io {
        /// The file.
        path: std::path::PathBuf,
        /// What the system said.
        reason: String,
    },
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl TraceError {
    /// A [`TraceError::Invalid`] from its two parts.
    pub fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }

    /// A [`TraceError::Unsupported`] from its two parts.
    pub fn unsupported(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported { field: field.into(), reason: reason.into() }
    }
}

impl From<VoxelError> for TraceError {
    fn from(error: VoxelError) -> Self {
        match error {
            VoxelError::Cancelled => Self::Cancelled,
            VoxelError::Unsupported { field, reason } => Self::Unsupported { field, reason },
            VoxelError::Invalid { field, reason } => Self::Invalid { field, reason },
            other => Self::Invalid { field: "voxel data".into(), reason: other.to_string() },
        }
    }
}
