//! Checkpoints of a job, beside its output.
//!
//! `OUT.job/` holds `record.json` (settings, model, predictor) and what the stages finished: `refinement.bin` after
//! every iteration, `judged.bin` after the judge. Each file is written whole or not at all, so a job that was killed
//! goes on where it was, and ends with the same bytes.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use pellucid_core::FileError;
use pellucid_core::files::{read_bounded, write_whole_bytes};

use crate::PrintError;
use crate::record::Record;

const RECORD: &str = "record.json";
/// The refinement's state after its last whole iteration.
pub(crate) const REFINEMENT: &str = "refinement.bin";
/// What the judge found.
pub(crate) const JUDGED: &str = "judged.bin";
/// Most bytes of a record.
const RECORD_LIMIT: u64 = 16 << 20;
/// Most bytes of a checkpoint.
const LIMIT: u64 = 64 << 30;

/// Where a job keeps what it has done; or nowhere.
#[derive(Debug)]
pub struct Workspace {
    folder: Option<PathBuf>,
    resume: bool,
    record: OnceLock<Record>,
}

impl Workspace {
    /// A job that keeps nothing and cannot be resumed.
    pub fn none() -> Self {
        Self::at(None, false)
    }

    fn at(folder: Option<PathBuf>, resume: bool) -> Self {
        Self { folder, resume, record: OnceLock::new() }
    }

    /// The folder of checkpoints that belongs to an output folder: `OUT.job` beside it.
    pub fn folder_of(out: &Path) -> PathBuf {
        let mut name = out.file_name().unwrap_or_default().to_owned();
        name.push(".job");
        out.with_file_name(name)
    }

    /// A new job for an output folder. Its folder of checkpoints is made with the first of them: a job that ends before leaves nothing.
    ///
    /// # Errors
    /// [`PrintError::Interrupted`] when an interrupted job left one.
    pub fn create(out: &Path) -> Result<Self, PrintError> {
        let folder = Self::folder_of(out);
        if folder.symlink_metadata().is_ok() {
            return Err(PrintError::Interrupted { folder });
        }
        Ok(Self::at(Some(folder), false))
    }

    /// Goes on with the interrupted job of an output folder; a new one where there is none.
    pub fn resume(out: &Path) -> Self {
        Self::at(Some(Self::folder_of(out)), true)
    }

    /// Whether there is something to go on with.
    pub fn has_checkpoint(&self) -> bool {
        self.resume && self.folder.as_ref().is_some_and(|folder| folder.join(RECORD).exists())
    }

    /// Binds the workspace to a job: an interrupted one is compared with it.
    pub(crate) fn begin(&self, record: &Record) -> Result<(), PrintError> {
        let Some(folder) = self.folder.as_ref().filter(|_| self.has_checkpoint()) else {
            // The folder comes with the first checkpoint: a job that ends before leaves nothing.
            let _ = self.record.set(record.clone());
            return Ok(());
        };
        let other = |difference: String| PrintError::OtherJob { folder: folder.clone(), difference };
        let bytes = read_bounded(folder.join(RECORD), RECORD_LIMIT)?;
        let earlier: Record = serde_json::from_slice(&bytes)
            .map_err(|e| other(format!("{RECORD}: {}", pellucid_core::json::plain(&e))))?;
        record.difference(&earlier).map_or(Ok(()), |difference| Err(other(difference)))
    }

    /// What a stage left, where the job goes on.
    pub(crate) fn load(&self, name: &str) -> Result<Option<Vec<u8>>, PrintError> {
        match &self.folder {
            Some(folder) if self.resume && folder.join(name).exists() => {
                Ok(Some(read_bounded(folder.join(name), LIMIT)?))
            }
            _ => Ok(None),
        }
    }

    /// Keeps what a stage has done. `bytes` are made only where they are kept.
    pub(crate) fn save(
        &self,
        name: &str,
        bytes: impl FnOnce() -> Result<Vec<u8>, PrintError>,
    ) -> Result<(), PrintError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let path = folder.join(RECORD);
        if let Some(record) = self.record.get().filter(|_| !path.exists()) {
            fs::create_dir_all(folder).map_err(FileError::at("create", folder))?;
            let text = serde_json::to_vec_pretty(record)
                .map_err(|e| FileError::at("write", &path)(std::io::Error::other(e)))?;
            write_whole_bytes(&path, &text)?;
        }
        Ok(write_whole_bytes(folder.join(name), &bytes()?)?)
    }

    /// Removes the checkpoints of a job that is complete.
    ///
    /// # Errors
    /// [`PrintError::Io`].
    pub fn finish(self) -> Result<(), PrintError> {
        let Some(folder) = self.folder.filter(|folder| folder.exists()) else { return Ok(()) };
        // What others put there stays, and so does the folder then.
        for name in [REFINEMENT, JUDGED, RECORD] {
            let path = folder.join(name);
            match fs::remove_file(&path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(FileError::at("remove", &path)(e).into());
                }
                _ => {}
            }
        }
        match fs::remove_dir(&folder) {
            Err(e) if e.kind() != std::io::ErrorKind::DirectoryNotEmpty => {
                Err(FileError::at("remove", &folder)(e).into())
            }
            _ => Ok(()),
        }
    }
}
