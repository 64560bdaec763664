//! The crate's error type.

use std::path::PathBuf;

/// Why a network could not be built, read, written or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RpnnError {
    /// A value or a buffer's length is not what the network takes.
    #[error("invalid {field}: {reason}")]
    Invalid {
        /// The argument or field.
        field: String,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// A weights file is well formed but made for something else.
    #[error("{path}: unsupported {field}: {reason}")]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The header field that does not fit.
        field: String,
        /// What it holds and what is needed.
        reason: String,
    },
    /// The weights were trained for something else.
    #[error("unsupported {field}: {reason}")]
    NotTrainedFor {
        /// What differs.
        field: String,
        /// What is asked and what the weights were trained for.
        reason: String,
    },
    /// The source of training samples failed.
    #[error("batch {batch} of the training samples: {reason}")]
    Source {
        /// Which batch.
        batch: u64,
        /// The source's own reason.
        reason: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The reference engine failed.
    #[cfg(feature = "candle")]
    #[error("candle: {0}")]
    Candle(#[from] candle_core::Error),
    /// A file could not be read or written.
    #[error("{path}: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's or decoder's reason.
        reason: String,
    },
}

impl RpnnError {
    pub(crate) fn invalid(field: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid { field: field.into(), reason: reason.into() }
    }
}
