//! What killed runs left beside an output folder.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::{OwnFiles, StagingError, place::Place};
use crate::FileError;

/// Mark of a folder that a run writes.
pub(super) const PARTIAL: &str = "partial-";
/// Mark of an output that is being replaced.
pub(super) const OLD: &str = "old-";
/// In a partial folder, the file that its run holds locked: the system lets go of it however the run ends.
const LOCK_FILE: &str = ".running";
/// A partial folder without a lock file may be one that a run has made this moment.
const FRESH: Duration = Duration::from_secs(60);
/// Where locks are not supported, a run is taken for dead once its folder did not change for so long.
const STALE: Duration = Duration::from_secs(3600);

/// The lock of the run that writes a partial folder.
#[derive(Debug)]
pub(super) struct RunLock {
    path: PathBuf,
    file: File,
}

impl RunLock {
    pub fn hold(partial: &Path) -> Result<Self, FileError> {
        let path = partial.join(LOCK_FILE);
        let file = File::create_new(&path).map_err(FileError::at("create", &path))?;
        // Where locks are not supported the folder's age decides.
        let _ = file.lock();
        Ok(Self { path, file })
    }

    /// Lets go and removes the lock file.
    pub fn release(self) -> Result<(), FileError> {
        drop(self.file);
        fs::remove_file(&self.path).map_err(FileError::at("remove", &self.path))
    }
}

/// Folders that killed runs left beside an output folder, in order of name: partial outputs whose run is no more, and
/// replaced outputs that could not be removed. Those of runs at work are not among them.
///
/// # Errors
/// [`StagingError`] when the path has no name of its own or its parent cannot be read.
pub fn remains(target: impl AsRef<Path>) -> Result<Vec<PathBuf>, StagingError> {
    of(&Place::of(target.as_ref())?)
}

/// Removes [`remains`] and returns what was removed. A replaced output stays where it holds files that are not `own`.
///
/// # Errors
/// As [`remains`], and when a folder cannot be removed.
pub fn remove_remains(target: impl AsRef<Path>, own: &OwnFiles) -> Result<Vec<PathBuf>, StagingError> {
    let place = Place::of(target.as_ref())?;
    let mut removed = Vec::new();
    for path in of(&place)? {
        let gone = if has_mark(&place, &path, OLD) {
            remove_old(&path, own)?
        } else {
            fs::remove_dir_all(&path).map_err(FileError::at("remove", &path))?;
            true
        };
        if gone {
            removed.push(path);
        }
    }
    Ok(removed)
}

pub(super) fn of(place: &Place) -> Result<Vec<PathBuf>, StagingError> {
    let torn = torn(place)?;
    let left = |path: &PathBuf| has_mark(place, path, OLD) || is_dead(path);
    Ok(siblings(place)?.into_iter().filter(|path| Some(path) != torn.as_ref() && left(path)).collect())
}

/// The output that was moved aside last, when nothing took its place.
pub(super) fn torn(place: &Place) -> Result<Option<PathBuf>, StagingError> {
    if fs::symlink_metadata(&place.target).is_ok() {
        return Ok(None);
    }
    let old = siblings(place)?.into_iter().filter(|path| has_mark(place, path, OLD));
    Ok(old.max_by_key(|path| fs::metadata(path).and_then(|m| m.modified()).ok()))
}

/// Removes a replaced output; false when it holds files that are not the program's, and stays.
pub(super) fn remove_old(folder: &Path, own: &OwnFiles) -> Result<bool, FileError> {
    if !own.foreign_names(folder)?.is_empty() {
        return Ok(false);
    }
    fs::remove_dir_all(folder).map_err(FileError::at("remove", folder))?;
    Ok(true)
}

/// Partial and replaced folders beside the output folder, in order of name.
fn siblings(place: &Place) -> Result<Vec<PathBuf>, StagingError> {
    let entries = match fs::read_dir(&place.parent) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(FileError::at("read", &place.parent)(e).into()),
    };
    let mut found = Vec::new();
    for entry in entries {
        let entry = entry.map_err(FileError::at("read", &place.parent))?;
        let path = place.parent.join(entry.file_name());
        let marked = has_mark(place, &path, PARTIAL) || has_mark(place, &path, OLD);
        if marked && entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Whether a path is the output folder's hidden sibling of a kind, with a tag `PID-N`.
fn has_mark(place: &Place, path: &Path, kind: &str) -> bool {
    let start = place.sibling(kind, "");
    let (Some(name), Some(start)) = (path.file_name(), start.file_name()) else { return false };
    let tag = name.as_encoded_bytes().strip_prefix(OsStr::as_encoded_bytes(start));
    tag.is_some_and(|tag| !tag.is_empty() && tag.iter().all(|b| b.is_ascii_digit() || *b == b'-'))
}

/// Whether the run that wrote a partial folder is no more.
fn is_dead(partial: &Path) -> bool {
    let file = match File::open(partial.join(LOCK_FILE)) {
        Ok(file) => file,
        Err(_) => return age(partial) >= FRESH,
    };
    match file.try_lock_shared() {
        Ok(()) => true,
        Err(TryLockError::WouldBlock) => false,
        Err(TryLockError::Error(_)) => age(partial) >= STALE,
    }
}

/// Time since a folder, or what is directly in it, last changed; zero when that cannot be told.
fn age(folder: &Path) -> Duration {
    let modified = |path: &Path| fs::symlink_metadata(path).and_then(|m| m.modified()).ok();
    let inner = fs::read_dir(folder).into_iter().flatten().flatten().filter_map(|e| modified(&e.path()));
    inner
        .chain(modified(folder))
        .max()
        .and_then(|latest| SystemTime::now().duration_since(latest).ok())
        .unwrap_or_default()
}
