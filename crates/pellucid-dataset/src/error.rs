//! The crate's error type.

use std::path::PathBuf;

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
    /// A file could not be read or written.
    #[error("{path}: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's or decoder's reason.
        reason: String,
    },
    /// A volume could not be built, or the caller asked to stop.
    #[error(transparent)]
    Voxel(#[from] VoxelError),
}
