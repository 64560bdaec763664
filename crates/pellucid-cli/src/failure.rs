//! How a command ends early.

use std::process::ExitCode;

use pellucid::core::{Cancelled, chain};

use crate::terminal::note;

/// How a command ended early.
pub enum Failure {
    /// Ctrl-C or another signal to end; what there is to know beyond that.
    Cancelled(String),
    /// Everything else, as a message for the user.
    Error(String),
}

impl Failure {
    /// An error with all its causes, each once.
    pub fn of(error: &dyn std::error::Error) -> Self {
        Self::Error(chain(error))
    }

    /// A message of the program's own.
    pub fn message(text: impl Into<String>) -> Self {
        Self::Error(text.into())
    }

    /// Tells the user, and gives the exit status: 130 after a signal to end, 1 for errors.
    pub fn tell(&self) -> ExitCode {
        match self {
            Self::Cancelled(rest) => {
                note(if rest.is_empty() { "cancelled".to_owned() } else { format!("cancelled; {rest}") });
                ExitCode::from(130)
            }
            Self::Error(message) => {
                note(format!("error: {message}"));
                ExitCode::FAILURE
            }
        }
    }
}

impl From<Cancelled> for Failure {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled(String::new())
    }
}

/// Errors whose cancellation is the command's.
macro_rules! from_errors {
    ($($error:path),* $(,)?) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                type Error = $error;
                match error {
                    Error::Cancelled => Self::Cancelled(String::new()),
                    other => Self::of(&other),
                }
            }
        }
    )*};
}

from_errors! {
    pellucid::PrintError,
    pellucid::color::ColorError,
    pellucid::mesh::MeshError,
    pellucid::slice::SliceError,
    pellucid::trace::TraceError,
    pellucid::dataset::DatasetError,
    pellucid::rpnn::RpnnError,
    pellucid::training::TrainingError,
    pellucid::voxel::VoxelError,
}

/// Errors that are never a cancellation.
macro_rules! from_plain_errors {
    ($($error:path),* $(,)?) => {$(
        impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::of(&error)
            }
        }
    )*};
}

from_plain_errors!(pellucid::core::FileError, pellucid::core::staging::StagingError);

/// Standard output could not be written.
impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        Self::Error(format!("cannot write to standard output: {error}"))
    }
}
