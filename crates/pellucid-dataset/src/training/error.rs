//! The module's error type.

use crate::DatasetError;
use pellucid_core::{Cancelled, Fault, FileError};
use pellucid_rpnn::RpnnError;
use pellucid_trace::TraceError;

/// Why a network could not be trained or judged.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// A setting is out of range, or two inputs do not fit together.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// The network is made for something else.
    #[error("unsupported {0}")]
    Unsupported(Fault),
    /// Samples could not be made or read.
    #[error(transparent)]
    Dataset(DatasetError),
    /// The network could not be trained, read or written.
    #[error(transparent)]
    Rpnn(RpnnError),
    /// A file or folder could not be written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The caller asked for the work to stop.
    #[error("cancelled")]
    Cancelled,
}

impl From<DatasetError> for TrainingError {
    fn from(error: DatasetError) -> Self {
        if matches!(error, DatasetError::Cancelled) { Self::Cancelled } else { Self::Dataset(error) }
    }
}

impl From<RpnnError> for TrainingError {
    fn from(error: RpnnError) -> Self {
        if matches!(error, RpnnError::Cancelled) { Self::Cancelled } else { Self::Rpnn(error) }
    }
}

impl From<TraceError> for TrainingError {
    fn from(error: TraceError) -> Self {
        DatasetError::from(error).into()
    }
}

impl From<Cancelled> for TrainingError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}
