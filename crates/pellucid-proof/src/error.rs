//! The crate's error type.

use pellucid_core::{Cancelled, Fault, FileError};

/// What can go wrong when pictures are made or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProofError {
    /// A value is outside its documented range, or two inputs do not fit together.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The request is well formed but beyond what this crate handles.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// A file could not be written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl ProofError {
    /// An [`ProofError::Invalid`] from what is concerned and what is wrong with it, and would be right.
    pub fn invalid(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Invalid(Fault::new(subject, reason))
    }

    /// An [`ProofError::Unsupported`] from what is concerned and the limit, and how to stay within it.
    pub fn unsupported(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Unsupported(Fault::new(subject, reason))
    }
}

impl From<Cancelled> for ProofError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
