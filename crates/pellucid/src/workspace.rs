//! Where a job keeps what it has done: `OUT.job` beside its output.
//!
//! It holds the record, `choice.json` where a predictor was chosen, `refinement.bin` after iterations (all of them where
//! keeping the state takes no time to speak of), and `judged.bin` after the judge. Each file is written whole or not at
//! all, so a job that was killed goes on near where it was, and ends with the same bytes.

use std::path::{Path, PathBuf};

use pellucid_core::Checkpoints;

use crate::PrintError;
use crate::record::Record;

/// The refinement's state after a whole iteration.
pub(crate) const REFINEMENT: &str = "refinement.bin";
/// Which predictor was chosen.
pub(crate) const CHOICE: &str = "choice.json";
/// What the judge found.
pub(crate) const JUDGED: &str = "judged.bin";

/// Where a job keeps what it has done; or nowhere.
#[derive(Debug)]
pub struct Workspace(Checkpoints);

impl Workspace {
    /// A job that keeps nothing and cannot be resumed.
    pub fn none() -> Self {
        Self(Checkpoints::none())
    }

    /// The folder of checkpoints that belongs to an output folder: `OUT.job` beside it.
    pub fn folder_of(out: &Path) -> PathBuf {
        let mut name = out.file_name().unwrap_or_default().to_owned();
        name.push(".job");
        out.with_file_name(name)
    }

    /// A new job for an output folder, which no other process works on meanwhile. A job that ends before its first
    /// checkpoint leaves nothing.
    ///
    /// # Errors
    /// [`PrintError::Interrupted`] when an interrupted job left checkpoints, [`PrintError::Checkpoint`] when another
    /// process is at work on the same output.
    pub fn create(out: &Path) -> Result<Self, PrintError> {
        let folder = Self::folder_of(out);
        let checkpoints = Checkpoints::create(&folder);
        checkpoints.claim()?;
        if checkpoints.left() { Err(PrintError::Interrupted { folder }) } else { Ok(Self(checkpoints)) }
    }

    /// Goes on with the interrupted job of an output folder; a new one where there is none. The job is refused when
    /// another process is at work on the same output.
    pub fn resume(out: &Path) -> Self {
        Self(Checkpoints::resume(Self::folder_of(out)))
    }

    /// Whether there is something to go on with.
    pub fn has_checkpoint(&self) -> bool {
        self.0.has_any()
    }

    /// Whether this job or an earlier one left something to go on with.
    pub fn holds_checkpoint(&self) -> bool {
        self.0.left()
    }

    pub(crate) fn begin(&self, record: &Record) -> Result<(), PrintError> {
        Ok(self.0.begin(&record.comparable())?)
    }

    /// A checkpoint that cannot be gone on with.
    pub(crate) fn unusable(&self, name: &str, reason: &dyn std::fmt::Display) -> PrintError {
        let folder = self.0.folder().unwrap_or(Path::new(""));
        let remedy = format!("remove {} to start anew", folder.display());
        let fault = pellucid_core::Fault::new(folder.join(name).display().to_string(), reason.to_string());
        PrintError::Invalid(fault.remedy(remedy))
    }

    pub(crate) fn load(&self, name: &str) -> Result<Option<Vec<u8>>, PrintError> {
        Ok(self.0.load(name)?)
    }

    /// `bytes` are made only where they are kept.
    pub(crate) fn save(
        &self,
        name: &str,
        bytes: impl FnOnce() -> Result<Vec<u8>, PrintError>,
    ) -> Result<(), PrintError> {
        if self.0.keeps() { Ok(self.0.save(name, &bytes()?)?) } else { Ok(()) }
    }

    /// Removes the checkpoints of a job that is complete.
    ///
    /// # Errors
    /// [`PrintError::Io`].
    pub fn finish(self) -> Result<(), PrintError> {
        Ok(self.0.remove(&[CHOICE, REFINEMENT, JUDGED])?)
    }
}
