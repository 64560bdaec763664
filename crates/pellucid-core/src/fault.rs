//! Texts of errors: what is wrong with which input, and what would be right.
//!
//! Every crate has an error enum of its own that tells invalid input, unsupported input and files apart. What
//! they say is one of these, so that it reads alike everywhere. The text of an error never repeats its cause: the
//! cause is its `source`, and [`chain`] joins them.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// What is wrong with an input.
///
/// ```
/// use pellucid_core::Fault;
/// let fault = Fault::new("spp", "0 paths").remedy("1 to 1048576 are possible");
/// assert_eq!(fault.to_string(), "spp: 0 paths; 1 to 1048576 are possible");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Fault {
    /// The argument, field, object or setting concerned.
    pub subject: String,
    /// What is wrong with it.
    pub reason: String,
    /// What would be right, or what to do; empty where the reason says it.
    pub remedy: String,
}

impl Fault {
    /// A fault of `subject`.
    pub fn new(subject: impl Into<String>, reason: impl Into<String>) -> Self {
        Self { subject: subject.into(), reason: reason.into(), remedy: String::new() }
    }

    /// The same with what to do about it.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = remedy.into();
        self
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.subject, self.reason)?;
        if self.remedy.is_empty() { Ok(()) } else { write!(f, "; {}", self.remedy) }
    }
}

/// A file or folder that could not be read or written; the system's reason is the source.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}", path.display())]
pub struct FileError {
    /// What was tried: `read`, `write`, `create`.
    pub action: &'static str,
    /// The file or folder.
    pub path: PathBuf,
    /// The system's reason.
    pub source: io::Error,
}

/// Equal where action, path and kind of the system's reason are.
impl PartialEq for FileError {
    fn eq(&self, other: &Self) -> bool {
        let key = |e: &Self| (e.action, e.source.kind());
        key(self) == key(other) && self.path == other.path
    }
}

impl FileError {
    /// For `map_err`: turns an `io::Error` into one that names action and path.
    ///
    /// ```
    /// use pellucid_core::{FileError, chain};
    /// let error = std::fs::read("no such file").map_err(FileError::at("read", "no such file")).unwrap_err();
    /// assert!(chain(&error).starts_with("cannot read no such file: "));
    /// ```
    pub fn at(action: &'static str, path: impl AsRef<Path>) -> impl FnOnce(io::Error) -> Self {
        let path = path.as_ref().to_owned();
        move |source| Self { action, path, source }
    }
}

/// An error's text and those of its causes, joined by `: `. A cause that only repeats the text above it, as a
/// transparent wrapper's does, is left out.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut last = text.clone();
    let mut cause = error.source();
    while let Some(error) = cause {
        let own = error.to_string();
        if own != last {
            text.push_str(": ");
            text.push_str(&own);
        }
        last = own;
        cause = error.source();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("outer")]
    struct Outer(#[source] Inner);

    #[derive(Debug, thiserror::Error)]
    #[error("inner")]
    struct Inner(#[source] FileError);

    #[test]
    fn a_chain_names_every_cause_once() {
        let file = FileError::at("read", "a.json")(io::Error::other("disk gone"));
        assert_eq!(chain(&Outer(Inner(file))), "outer: inner: cannot read a.json: disk gone");
    }
}
