//! Where a job keeps what it has done: `OUT.job` beside its output.
//!
//! It holds the record, `choice.json` where a predictor was chosen, `refinement.bin` (of a print in sections
//! `refinement-0.bin` and so on) after iterations (all of them where
//! keeping the state takes no time to speak of), and `judged.bin` after the judge. Each file is written whole or not at
//! all, so a job that was killed goes on near where it was, and ends with the same bytes.

use std::fs::File;
use std::io::{self, BufWriter, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pellucid_core::files::WholeFile;
use pellucid_core::team::Alone;
use pellucid_core::{Checkpoints, FileError, Team};

use crate::PrintError;
use crate::record::Record;

/// The refinement's state after a whole iteration.
pub(crate) const REFINEMENT: &str = "refinement.bin";
/// The same of a section of the print.
pub(crate) fn section_of_refinement(section: usize) -> String {
    format!("refinement-{section}.bin")
}

/// Which predictor was chosen.
pub(crate) const CHOICE: &str = "choice.json";
/// What the judge found.
pub(crate) const JUDGED: &str = "judged.bin";

/// Where a job keeps what it has done; or nowhere.
#[derive(Debug)]
pub struct Workspace {
    own: Checkpoints,
    team: Arc<dyn Team>,
}

impl Workspace {
    /// A job that keeps nothing and cannot be resumed.
    pub fn none() -> Self {
        Self::of(Checkpoints::none())
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
        if checkpoints.left() { Err(PrintError::Interrupted { folder }) } else { Ok(Self::of(checkpoints)) }
    }

    /// Goes on with the interrupted job of an output folder; a new one where there is none. The job is refused when
    /// another process is at work on the same output.
    pub fn resume(out: &Path) -> Self {
        Self::of(Checkpoints::resume(Self::folder_of(out)))
    }

    /// The same for a job of a team ([`PrintJob::with_team`](crate::PrintJob::with_team)): what member 0's workspace holds is
    /// gone on with by all, on whatever number of members. The others' should be [`Workspace::none`].
    pub fn of_team(self, team: Arc<dyn Team>) -> Self {
        Self { team, ..self }
    }

    fn of(own: Checkpoints) -> Self {
        Self { own, team: Arc::new(Alone) }
    }

    /// Whether there is something to go on with.
    pub fn has_checkpoint(&self) -> bool {
        self.own.has_any()
    }

    /// Whether this job or an earlier one left something to go on with.
    pub fn holds_checkpoint(&self) -> bool {
        self.own.left()
    }

    pub(crate) fn begin(&self, record: &Record) -> Result<(), PrintError> {
        Ok(self.own.begin(&record.comparable())?)
    }

    /// A checkpoint that cannot be gone on with.
    pub(crate) fn unusable(&self, name: &str, reason: &dyn std::fmt::Display) -> PrintError {
        let folder = self.own.folder().unwrap_or(Path::new(""));
        let remedy = format!("remove {} to start anew", folder.display());
        let fault = pellucid_core::Fault::new(folder.join(name).display().to_string(), reason.to_string());
        PrintError::Invalid(fault.remedy(remedy))
    }

    pub(crate) fn load(&self, name: &str) -> Result<Option<Vec<u8>>, PrintError> {
        let own = if self.team.rank() == 0 { self.own.load(name)? } else { None };
        // Empty where there is none, else a byte more.
        let mut message = own.map_or(Vec::new(), |mut bytes| {
            bytes.push(0);
            bytes
        });
        self.team.copy_first(&mut message);
        Ok(message.pop().map(|_| message))
    }

    /// [`Workspace::load`] by a reader that is given the bytes one after the other, and how many there are.
    pub(crate) fn load_with<T>(
        &self,
        name: &str,
        read: impl FnOnce(&mut dyn Read, u64) -> Result<T, PrintError>,
    ) -> Result<Option<T>, PrintError> {
        if self.team.size() > 1 {
            // A message is whole.
            let read = |bytes: Vec<u8>| read(&mut &bytes[..], bytes.len() as u64);
            return self.load(name)?.map(read).transpose();
        }
        let Some(file) = self.own.open(name)? else { return Ok(None) };
        let failed = FileError::at("read", self.own.folder().unwrap_or(Path::new("")).join(name));
        let length = match file.metadata() {
            Ok(metadata) => metadata.len(),
            Err(e) => return Err(failed(e).into()),
        };
        let mut noted = Noted { file, error: None };
        let found = read(&mut noted, length);
        match noted.error {
            Some(e) => Err(failed(e).into()),
            None => found.map(Some),
        }
    }

    /// `bytes` are made only where they are kept.
    pub(crate) fn save(
        &self,
        name: &str,
        bytes: impl FnOnce() -> Result<Vec<u8>, PrintError>,
    ) -> Result<(), PrintError> {
        if self.own.keeps() { Ok(self.own.save(name, &bytes()?)?) } else { Ok(()) }
    }

    /// [`Workspace::save`] of what `write` writes.
    pub(crate) fn save_with(
        &self,
        name: &str,
        write: impl FnOnce(&mut BufWriter<WholeFile>) -> io::Result<()>,
    ) -> Result<(), PrintError> {
        Ok(self.own.save_with(name, write)?)
    }

    /// Removes the checkpoints of a job that is complete.
    ///
    /// # Errors
    /// [`PrintError::Io`].
    pub fn finish(self) -> Result<(), PrintError> {
        let sections = (0..).map(section_of_refinement);
        let there = |name: &String| self.own.folder().is_some_and(|folder| folder.join(name).exists());
        let sections: Vec<String> = sections.take_while(there).collect();
        let names: Vec<&str> =
            [CHOICE, REFINEMENT, JUDGED].into_iter().chain(sections.iter().map(String::as_str)).collect();
        Ok(self.own.remove(&names)?)
    }
}

/// A file that keeps the error that ended its reading: what reads it may say only that the contents are wrong.
struct Noted {
    file: File,
    error: Option<io::Error>,
}

impl Read for Noted {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.file.read(bytes).map_err(|e| {
            let kind = e.kind();
            if kind != io::ErrorKind::Interrupted {
                self.error = Some(e);
            }
            kind.into()
        })
    }
}
