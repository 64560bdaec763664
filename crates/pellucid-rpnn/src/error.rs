//! The crate's error type.

use std::path::Path;

use pellucid_core::{Cancelled, Fault, FileError};

/// Why a network could not be built, read, written, trained or run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RpnnError {
    /// A value, a buffer's length or a file's content is not what the network takes.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// A file is well formed but made for something else, or the processor lacks what is asked for.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// A file could not be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
    /// The source of training samples failed.
    #[error("no batch {batch} of the training samples")]
    Source {
        /// Which batch.
        batch: u64,
        /// The source's own error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// candle or its device failed.
    #[cfg(feature = "candle")]
    #[error("the network on candle failed")]
    Candle(#[from] candle_core::Error),
}

impl RpnnError {
    /// An [`RpnnError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// An [`RpnnError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }

    /// A fault of a file's content.
    pub(crate) fn in_file(path: &Path, reason: impl Into<String>, remedy: &str) -> Self {
        Self::Invalid(Fault::new(path.display().to_string(), reason).remedy(remedy))
    }
}

impl From<Cancelled> for RpnnError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
