//! Checkpoints of long work in a folder of their own: a record of what the work is, and what its steps have done.
//!
//! Each file is written whole or not at all, so work that was killed goes on from the last step that it finished. The
//! record says whose checkpoints they are: another job's are refused, with the difference named. A lock says that a process
//! is at work, so that two never write the same checkpoints.

use std::fs::{self, File, TryLockError};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use serde_json::Value;

use crate::FileError;
use crate::files::{WholeFile, read_bounded, write_whole, write_whole_bytes};

/// Name of the record.
const RECORD: &str = "record.json";
/// Name of the file that a process at work holds locked.
const LOCK: &str = "lock";
/// Most bytes of a record.
const RECORD_LIMIT: u64 = 16 << 20;
/// Most bytes of a checkpoint.
const LIMIT: u64 = 64 << 30;

/// Why checkpoints cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CheckpointError {
    /// They are of other work.
    #[error("the checkpoints in {} are of another job: {difference}", folder.display())]
    Other {
        /// The folder.
        folder: PathBuf,
        /// What differs.
        difference: String,
    },
    /// Another process is at work on them.
    #[error("another process is at work on {}; wait for it to end, or write elsewhere", folder.display())]
    Busy {
        /// The folder.
        folder: PathBuf,
    },
    /// A file could not be read or written.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A folder of checkpoints; or none, for work that keeps nothing.
///
/// ```
/// use pellucid_core::Checkpoints;
/// let folder = tempfile::tempdir()?;
/// let job = serde_json::json!({ "seed": 7 });
/// let work = Checkpoints::create(folder.path().join("job"));
/// work.begin(&job)?;
/// work.save("step.bin", &[1, 2, 3])?;
/// // Later, in another process:
/// let again = Checkpoints::resume(folder.path().join("job"));
/// # drop(work);
/// again.begin(&job)?;
/// assert_eq!(again.load("step.bin")?, Some(vec![1, 2, 3]));
/// let other = again.begin(&serde_json::json!({ "seed": 8 })).unwrap_err();
/// assert!(other.to_string().ends_with("seed was 7 and is 8"));
/// again.remove(&["step.bin"])?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct Checkpoints {
    folder: Option<PathBuf>,
    resume: bool,
    record: OnceLock<Value>,
    /// Held while this process is at work.
    claim: OnceLock<Claim>,
}

/// A folder that is this process's.
#[derive(Debug)]
struct Claim {
    /// Locked until it is closed.
    _lock: File,
    /// Folders that were made for it, the innermost first.
    made: Vec<PathBuf>,
}

impl Checkpoints {
    /// Keeps nothing.
    pub fn none() -> Self {
        Self::default()
    }

    /// Of new work. Work that ends before its first checkpoint leaves nothing.
    pub fn create(folder: impl Into<PathBuf>) -> Self {
        Self::of(folder.into(), false)
    }

    /// Goes on with what a folder holds; as new work where there is none.
    pub fn resume(folder: impl Into<PathBuf>) -> Self {
        Self::of(folder.into(), true)
    }

    fn of(folder: PathBuf, resume: bool) -> Self {
        Self { folder: Some(folder), resume, record: OnceLock::new(), claim: OnceLock::new() }
    }

    /// The folder, where there is one.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Whether there is something to go on with.
    pub fn has_any(&self) -> bool {
        self.resume && self.folder.as_ref().is_some_and(|folder| folder.join(RECORD).exists())
    }

    /// Whether the folder holds checkpoints, whatever becomes of them.
    pub fn left(&self) -> bool {
        self.folder.as_ref().is_some_and(|folder| folder.join(RECORD).exists())
    }

    /// Makes the folder this process's until the value is dropped; [`Checkpoints::begin`] does so too. On file systems
    /// that have no locks nothing is claimed.
    ///
    /// # Errors
    /// [`CheckpointError::Busy`] while another process is at work, [`CheckpointError::File`].
    pub fn claim(&self) -> Result<(), CheckpointError> {
        let Some(folder) = self.folder.as_ref().filter(|_| self.claim.get().is_none()) else { return Ok(()) };
        let path = folder.join(LOCK);
        let made = folder.ancestors().take_while(|f| !f.as_os_str().is_empty() && !f.exists());
        let made = made.map(Path::to_owned).collect();
        let lock = loop {
            fs::create_dir_all(folder).map_err(FileError::at("create", folder))?;
            let file = File::options().create(true).truncate(false).write(true).open(&path);
            let file = file.map_err(FileError::at("create", &path))?;
            if let Err(TryLockError::WouldBlock) = file.try_lock() {
                return Err(CheckpointError::Busy { folder: folder.clone() });
            }
            // A process that ended just now may have removed what was opened.
            if path.exists() {
                break file;
            }
        };
        let _ = self.claim.set(Claim { _lock: lock, made });
        Ok(())
    }

    /// Says what the work is: new work is recorded, interrupted work compared.
    ///
    /// # Errors
    /// [`CheckpointError::Other`] naming the difference; as [`Checkpoints::claim`].
    pub fn begin(&self, record: &Value) -> Result<(), CheckpointError> {
        self.claim()?;
        let Some(folder) = self.folder.as_ref().filter(|_| self.has_any()) else {
            let _ = self.record.set(record.clone());
            return Ok(());
        };
        let other = |difference: String| CheckpointError::Other { folder: folder.clone(), difference };
        let bytes = read_bounded(folder.join(RECORD), RECORD_LIMIT)?;
        let earlier: Value = serde_json::from_slice(&bytes)
            .map_err(|e| other(format!("{RECORD}: {}", crate::json::plain(&e))))?;
        difference("", &earlier, record).map_or(Ok(()), |difference| Err(other(difference)))
    }

    /// What a step left, where the work goes on.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn load(&self, name: &str) -> Result<Option<Vec<u8>>, FileError> {
        self.kept(name).map(|path| read_bounded(path, LIMIT)).transpose()
    }

    /// The file that a step left, where the work goes on.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn open(&self, name: &str) -> Result<Option<File>, FileError> {
        self.kept(name).map(|path| File::open(&path).map_err(FileError::at("read", path))).transpose()
    }

    /// Where a step's file is, where the work goes on.
    fn kept(&self, name: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref().filter(|_| self.resume)?;
        Some(folder.join(name)).filter(|path| path.exists())
    }

    /// Whether [`Checkpoints::save`] keeps anything, so that its bytes are worth making.
    pub fn keeps(&self) -> bool {
        self.folder.is_some()
    }

    /// Keeps what a step has done.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn save(&self, name: &str, bytes: &[u8]) -> Result<(), FileError> {
        self.save_with(name, |out| out.write_all(bytes))
    }

    /// [`Checkpoints::save`] of what `write` writes, whose error is one of the file.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn save_with(
        &self,
        name: &str,
        write: impl FnOnce(&mut BufWriter<WholeFile>) -> io::Result<()>,
    ) -> Result<(), FileError> {
        let Some(folder) = &self.folder else { return Ok(()) };
        let path = folder.join(RECORD);
        if let Some(record) = self.record.get().filter(|_| !path.exists()) {
            fs::create_dir_all(folder).map_err(FileError::at("create", folder))?;
            write_whole_bytes(&path, format!("{record:#}\n").as_bytes())?;
        }
        write_whole(folder.join(name), write)
    }

    /// Removes the checkpoints `names` of work that is complete, the record and the folder. What others put there
    /// stays, and so does the folder then.
    ///
    /// # Errors
    /// [`FileError`].
    pub fn remove(&self, names: &[&str]) -> Result<(), FileError> {
        let Some(folder) = self.folder.as_ref().filter(|folder| folder.exists()) else { return Ok(()) };
        for path in names.iter().chain([&RECORD, &LOCK]).map(|name| folder.join(name)) {
            gone(&path, fs::remove_file(&path), std::io::ErrorKind::NotFound)?;
        }
        gone(folder, fs::remove_dir(folder), std::io::ErrorKind::DirectoryNotEmpty)
    }
}

impl Drop for Checkpoints {
    /// Ends the claim; the folder goes with it if nothing else is in there, and so do those that were made for it.
    fn drop(&mut self) {
        let (Some(folder), Some(claim)) = (&self.folder, self.claim.take()) else { return };
        // Best effort: a lock file that stays is taken over by the next process.
        let _ = fs::remove_file(folder.join(LOCK));
        let _ = fs::remove_dir(folder);
        claim.made.iter().for_each(|made| {
            let _ = fs::remove_dir(made);
        });
    }
}

fn gone(path: &Path, removed: std::io::Result<()>, fine: std::io::ErrorKind) -> Result<(), FileError> {
    match removed {
        Err(e) if e.kind() != fine => Err(FileError::at("remove", path)(e)),
        _ => Ok(()),
    }
}

/// The first place where two values differ, with both, in words; `None` where they are alike.
fn difference(at: &str, was: &Value, is: &Value) -> Option<String> {
    match (was, is) {
        (Value::Object(was), Value::Object(is)) => {
            let keys = was.keys().chain(is.keys().filter(|key| !was.contains_key(*key)));
            keys.into_iter().find_map(|key| {
                let at = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
                let [was, is] = [was, is].map(|map| map.get(key).unwrap_or(&Value::Null));
                difference(&at, was, is)
            })
        }
        _ if was == is => None,
        _ => Some(format!("{at} was {was} and is {is}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_difference_names_the_field_and_both_values() {
        let was = json!({ "settings": { "spp": 16, "refine": { "iterations": 10 } }, "x": [1, 2] });
        assert_eq!(difference("", &was, &was), None);
        let mut is = was.clone();
        is["settings"]["refine"]["iterations"] = json!(8);
        assert_eq!(difference("", &was, &is).unwrap(), "settings.refine.iterations was 10 and is 8");
        is = was.clone();
        is["y"] = json!("new");
        assert_eq!(difference("", &was, &is).unwrap(), "y was null and is \"new\"");
    }

    #[test]
    fn new_work_leaves_nothing_before_its_first_checkpoint_and_foreign_files_stay() {
        let parent = tempfile::tempdir().unwrap();
        let inner = Checkpoints::create(parent.path().join("a/b/job"));
        inner.claim().unwrap();
        drop(inner);
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
        let folder = parent.path().join("job");
        let work = Checkpoints::create(&folder);
        work.begin(&json!({})).unwrap();
        assert!(!work.has_any() && !work.left());
        drop(work);
        assert!(!folder.exists());
        let work = Checkpoints::create(&folder);
        work.begin(&json!({})).unwrap();
        work.save("a.bin", b"a").unwrap();
        assert!(work.left());
        assert_eq!(Checkpoints::create(&folder).load("a.bin").unwrap(), None, "new work takes nothing up");
        fs::write(folder.join("mine.txt"), "").unwrap();
        work.remove(&["a.bin"]).unwrap();
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        fs::remove_file(folder.join("mine.txt")).unwrap();
        work.remove(&["a.bin"]).unwrap();
        assert!(!folder.exists());
    }

    #[test]
    fn two_processes_never_work_on_the_same_checkpoints() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("job");
        let first = Checkpoints::create(&folder);
        first.begin(&json!({})).unwrap();
        let busy = |work: &Checkpoints| matches!(work.begin(&json!({})), Err(CheckpointError::Busy { .. }));
        assert!(busy(&Checkpoints::create(&folder)) && busy(&Checkpoints::resume(&folder)));
        first.save("a.bin", b"a").unwrap();
        assert!(busy(&Checkpoints::resume(&folder)), "dropping the others did not end the first one's claim");
        drop(first);
        let second = Checkpoints::resume(&folder);
        second.begin(&json!({})).unwrap();
        assert_eq!(second.load("a.bin").unwrap().unwrap(), b"a");
        assert!(busy(&Checkpoints::resume(&folder)));
        // What a killed process leaves is no claim.
        drop(second);
        fs::write(folder.join(LOCK), "").unwrap();
        Checkpoints::resume(&folder).begin(&json!({})).unwrap();
    }
}
