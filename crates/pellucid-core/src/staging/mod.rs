//! Output folders that appear complete or not at all.
//!
//! Beside an output folder `NAME` lie, while a run writes it, `.NAME.partial-*` and, while it is replaced,
//! `.NAME.old-*`. What a killed run left of them is told by [`remains`] and stays until [`remove_remains`]; only an
//! output that was moved aside by a run that died before it could place the new one is put back at once. A killed
//! program leaves one whole output or the other; a power cut may lose what the system had not yet written.

mod own_files;
mod place;
mod remains;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

pub use own_files::OwnFiles;
pub use remains::{remains, remove_remains};

use place::{MadeParents, Place};
use remains::RunLock;

use crate::{Fault, FileError};

/// Tells this process's folders from each other.
static COUNTER: AtomicU32 = AtomicU32::new(0);

/// Why an output folder cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StagingError {
    /// The path cannot be an output folder.
    #[error("invalid {0}")]
    Invalid(Fault),
    /// Something is there and may not be replaced.
    #[error("{} already exists: {reason}", folder.display())]
    Exists {
        /// The output folder.
        folder: PathBuf,
        /// Why it was left alone, and what to do.
        reason: String,
    },
    /// The folder holds files that this program did not write; none was touched.
    #[error(
        "{} holds files that this program did not write ({}); move them away or choose another folder",
        folder.display(),
        files.iter().map(|f| f.display().to_string()).collect::<Vec<_>>().join(", ")
    )]
    Foreign {
        /// The output folder.
        folder: PathBuf,
        /// The first few of them, by path below the folder.
        files: Vec<PathBuf>,
    },
    /// A file or folder could not be read, made or moved.
    #[error(transparent)]
    File(#[from] FileError),
}

/// Looks, and only looks, whether [`StagedDir::begin`] would accept an output folder: nothing is written.
///
/// # Errors
/// As there, as far as looking can tell.
pub fn check(target: impl AsRef<Path>, force: bool, own: &OwnFiles) -> Result<(), StagingError> {
    let place = Place::of(target.as_ref())?;
    let torn = remains::torn(&place)?;
    check_replaceable(torn.as_deref().unwrap_or(&place.target), &place.target, force, own)?;
    place.check_parent()
}

/// A temporary folder beside the output folder, renamed to it by [`StagedDir::commit`] and removed when dropped before
/// that, with the parents that were made for it.
///
/// A folder that exists is replaced only when it is empty, or with `force` when all in it is the program's own
/// ([`OwnFiles`]): a mistyped name cannot cost anybody a file. A link to a folder stays and the folder it leads to is
/// replaced. Nothing is ever removed but empty folders and files that match the patterns.
///
/// ```
/// use pellucid_core::staging::{OwnFiles, StagedDir};
/// let own = OwnFiles::new(["report.json"]);
/// let parent = tempfile::tempdir()?;
/// let out = parent.path().join("print");
/// let staged = StagedDir::begin(&out, false, &own)?;
/// std::fs::write(staged.path().join("report.json"), "{}")?;
/// assert!(!out.exists());
/// staged.commit()?;
/// assert!(out.join("report.json").exists());
/// assert!(StagedDir::begin(&out, false, &own).is_err());
/// assert!(StagedDir::begin(&out, true, &own).is_ok());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct StagedDir {
    temp: PathBuf,
    aside: PathBuf,
    place: Place,
    parents: MadeParents,
    lock: Option<RunLock>,
    own: OwnFiles,
    force: bool,
    committed: bool,
    remains: Vec<PathBuf>,
}

impl StagedDir {
    /// Makes the temporary folder for an output folder `target`, and the parents that are missing.
    ///
    /// # Errors
    /// [`StagingError::Exists`] when something is there and `force` is not given or it is no folder,
    /// [`StagingError::Foreign`] when a folder holds files that are not `own`, [`StagingError::Invalid`] when the path
    /// has no name of its own or is where another file system is mounted, [`StagingError::File`]. Nothing is left
    /// behind then.
    pub fn begin(target: impl AsRef<Path>, force: bool, own: &OwnFiles) -> Result<Self, StagingError> {
        let place = Place::of(target.as_ref())?;
        let parents = MadeParents::make(&place.parent)?;
        if let Some(torn) = remains::torn(&place)? {
            fs::rename(&torn, &place.target).map_err(FileError::at("put back", &place.target))?;
        }
        check_replaceable(&place.target, &place.target, force, own)?;
        let remains = remains::of(&place)?;
        let (temp, aside) = create_temp(&place)?;
        let mut staged = Self {
            aside,
            temp,
            place,
            parents,
            lock: None,
            own: own.clone(),
            force,
            committed: false,
            remains,
        };
        staged.lock = Some(RunLock::hold(&staged.temp)?);
        Ok(staged)
    }

    /// The temporary folder to write into.
    pub fn path(&self) -> &Path {
        &self.temp
    }

    /// What killed runs left for the same output folder, as [`remains`] found it at the begin.
    pub fn remains(&self) -> &[PathBuf] {
        &self.remains
    }

    /// Puts the temporary folder in the output folder's place.
    ///
    /// # Errors
    /// As [`StagedDir::begin`], when something came into the way meanwhile; the old folder, if any, is where it was
    /// and the temporary one is gone then.
    pub fn commit(mut self) -> Result<(), StagingError> {
        let target = &self.place.target;
        let replaces = check_replaceable(target, target, self.force, &self.own)?;
        // Where a folder with an open file cannot be renamed, the lock has to go first.
        if let Some(lock) = self.lock.take() {
            lock.release()?;
        }
        if replaces {
            fs::rename(target, &self.aside).map_err(FileError::at("move aside", target))?;
        }
        if let Err(source) = fs::rename(&self.temp, target) {
            if replaces {
                fs::rename(&self.aside, target).map_err(FileError::at("put back", target))?;
            }
            return Err(FileError::at("create", target)(source).into());
        }
        self.committed = true;
        self.parents.keep();
        if replaces {
            // The new output is in place: what cannot be removed now is told by a later run.
            let _ = remains::remove_old(&self.aside, &self.own);
        }
        Ok(())
    }
}

impl Drop for StagedDir {
    fn drop(&mut self) {
        if !self.committed {
            self.lock = None;
            let _ = fs::remove_dir_all(&self.temp);
            self.parents.remove();
        }
    }
}

/// Makes a partial folder, and finds the name its run may move the old output to. A process number comes again, in
/// containers always, so the remains of a killed run may have the first names.
fn create_temp(place: &Place) -> Result<(PathBuf, PathBuf), FileError> {
    loop {
        let tag = format!("{}-{}", std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed));
        let [temp, aside] = [remains::PARTIAL, remains::OLD].map(|kind| place.sibling(kind, &tag));
        if fs::symlink_metadata(&aside).is_ok() {
            continue;
        }
        match fs::create_dir(&temp) {
            Ok(()) => return Ok((temp, aside)),
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(FileError::at("create", &temp)(e)),
        }
    }
}

/// `Ok(true)` when a folder is there and may be replaced, `Ok(false)` when nothing is there. `folder` is what is looked
/// at, `target` what it is called.
fn check_replaceable(
    folder: &Path,
    target: &Path,
    force: bool,
    own: &OwnFiles,
) -> Result<bool, StagingError> {
    let exists = |reason: &str| StagingError::Exists { folder: target.to_owned(), reason: reason.to_owned() };
    let kind = match fs::symlink_metadata(folder) {
        Ok(meta) => meta.file_type(),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(e) => return Err(FileError::at("look at", target)(e).into()),
    };
    if kind.is_symlink() {
        return Err(exists("it is a link that leads nowhere; choose another folder"));
    }
    if !kind.is_dir() {
        return Err(exists("it is not a folder; choose another name"));
    }
    let mut entries = fs::read_dir(folder).map_err(FileError::at("read", target))?;
    if entries.next().is_none() {
        return Ok(true);
    }
    let files = own.foreign(folder)?;
    if !files.is_empty() {
        return Err(StagingError::Foreign { folder: target.to_owned(), files });
    }
    if !force {
        return Err(exists("choose another folder, or allow its replacement (--force)"));
    }
    Ok(true)
}
