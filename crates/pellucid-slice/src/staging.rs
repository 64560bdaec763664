//! Output folders that appear complete or not at all.

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, SystemTime};

use serde_json::Value;

use crate::SliceError;
use crate::manifest::{FORMAT, MANIFEST_FILE};

/// Partial folders of interrupted runs are removed once nothing in them changed for so long.
const STALE: Duration = Duration::from_secs(3600);
/// Tells this process's folders from each other.
static COUNTER: AtomicU32 = AtomicU32::new(0);

/// A temporary folder beside the output folder, renamed to it by [`StagedDir::commit`] and removed
/// when dropped before that.
///
/// A folder that exists is replaced only with `force` and only when it is empty or holds a slice
/// manifest, so a mistyped name cannot delete a home folder. While it is replaced it is first
/// renamed aside (`.NAME.old-*`); a run that died between the two renames is mended by the next
/// [`StagedDir::begin`], which puts the old folder back.
///
/// ```
/// use pellucid_slice::StagedDir;
/// let parent = tempfile::tempdir().unwrap();
/// let out = parent.path().join("print");
/// let staged = StagedDir::begin(&out, false).unwrap();
/// std::fs::write(staged.path().join("report.json"), "{}").unwrap();
/// assert!(!out.exists());
/// staged.commit().unwrap();
/// assert!(out.join("report.json").exists());
/// ```
#[derive(Debug)]
pub struct StagedDir {
    temp: PathBuf,
    target: PathBuf,
    aside: PathBuf,
    force: bool,
    committed: bool,
}

impl StagedDir {
    /// Creates the temporary folder for an output folder `target`, making its parents.
    ///
    /// # Errors
    /// [`SliceError::Exists`] when `target` exists and `force` does not allow its replacement,
    /// [`SliceError::Invalid`] when it has no name of its own, [`SliceError::Io`].
    pub fn begin(target: &Path, force: bool) -> Result<Self, SliceError> {
        let Some(name) = target.file_name() else {
            return Err(SliceError::invalid(
                "output folder",
                format!("{:?} has no name of its own; name a new folder", target.display().to_string()),
            ));
        };
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        fs::create_dir_all(parent).map_err(SliceError::io("create", parent))?;
        sweep(parent, name, target, STALE)?;
        check_replaceable(target, force)?;
        let tag = format!("{}-{}", std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed));
        let temp = parent.join(marked(name, "partial-", &tag));
        fs::create_dir(&temp).map_err(SliceError::io("create", &temp))?;
        Ok(Self {
            temp,
            target: target.to_owned(),
            aside: parent.join(marked(name, "old-", &tag)),
            force,
            committed: false,
        })
    }

    /// The temporary folder to write into.
    pub fn path(&self) -> &Path {
        &self.temp
    }

    /// Puts the temporary folder in the output folder's place.
    ///
    /// # Errors
    /// As [`StagedDir::begin`]; the old folder, if any, is then where it was.
    pub fn commit(mut self) -> Result<(), SliceError> {
        let replaces = check_replaceable(&self.target, self.force)?;
        if replaces {
            fs::rename(&self.target, &self.aside).map_err(SliceError::io("move aside", &self.target))?;
        }
        if let Err(source) = fs::rename(&self.temp, &self.target) {
            if replaces {
                fs::rename(&self.aside, &self.target).map_err(SliceError::io("put back", &self.target))?;
            }
            return Err(SliceError::io("create", &self.target)(source));
        }
        self.committed = true;
        if replaces {
            // The new output is in place: what cannot be removed now is swept by a later run.
            let _ = fs::remove_dir_all(&self.aside);
        }
        Ok(())
    }
}

impl Drop for StagedDir {
    fn drop(&mut self) {
        if !self.committed {
            let _ = fs::remove_dir_all(&self.temp);
        }
    }
}

/// `.NAME.` and a mark: the hidden sibling names this module uses.
fn marked(name: &std::ffi::OsStr, kind: &str, tag: &str) -> OsString {
    let mut out = OsString::from(".");
    out.push(name);
    out.push(".");
    out.push(kind);
    out.push(tag);
    out
}

/// `Ok(true)` when a folder is there and may be replaced, `Ok(false)` when nothing is there.
fn check_replaceable(target: &Path, force: bool) -> Result<bool, SliceError> {
    let exists = |reason: &str| SliceError::Exists { dir: target.to_owned(), reason: reason.to_owned() };
    let meta = match fs::symlink_metadata(target) {
        Ok(meta) => meta,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        Err(e) => return Err(SliceError::io("look at", target)(e)),
    };
    if !meta.is_dir() {
        return Err(exists("it is not a folder; choose another name"));
    }
    let mut entries = fs::read_dir(target).map_err(SliceError::io("read", target))?;
    if entries.next().is_none() {
        return Ok(true);
    }
    if !force {
        return Err(exists("choose another folder, or allow replacement (--force)"));
    }
    let ours = fs::metadata(target.join(MANIFEST_FILE)).is_ok_and(|m| m.len() < 16 << 20)
        && fs::read(target.join(MANIFEST_FILE))
            .ok()
            .and_then(|bytes| serde_json::from_slice::<Value>(&bytes).ok())
            .is_some_and(|v| v.get("format").and_then(Value::as_str) == Some(FORMAT));
    if !ours {
        return Err(exists("it holds no slice manifest, so it is not replaced; remove it yourself"));
    }
    Ok(true)
}

/// Removes what interrupted runs left beside `target`, and puts an output back that was moved
/// aside by a run that died before it could place the new one.
fn sweep(parent: &Path, name: &std::ffi::OsStr, target: &Path, stale: Duration) -> Result<(), SliceError> {
    let partial = marked(name, "partial-", "");
    let old = marked(name, "old-", "");
    let starts = |entry: &std::ffi::OsStr, prefix: &OsString| {
        entry.as_encoded_bytes().starts_with(prefix.as_encoded_bytes())
    };
    for entry in fs::read_dir(parent).map_err(SliceError::io("read", parent))? {
        let entry = entry.map_err(SliceError::io("read", parent))?;
        let path = entry.path();
        let file_name = entry.file_name();
        let torn = starts(&file_name, &old);
        if torn && fs::symlink_metadata(target).is_err() {
            fs::rename(&path, target).map_err(SliceError::io("put back", target))?;
        } else if torn || (starts(&file_name, &partial) && age(&path) >= stale) {
            // Another run may be sweeping too; what stays is swept next time.
            let _ = fs::remove_dir_all(&path);
        }
    }
    Ok(())
}

/// Time since a folder, or a folder directly within it, last gained or lost an entry; zero when
/// that cannot be told.
fn age(dir: &Path) -> Duration {
    let modified = |path: &Path| fs::symlink_metadata(path).and_then(|m| m.modified()).ok();
    let inner = fs::read_dir(dir).into_iter().flatten().flatten().filter_map(|e| modified(&e.path()));
    inner
        .chain(modified(dir))
        .max()
        .and_then(|latest| SystemTime::now().duration_since(latest).ok())
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn output(path: &Path, mark: &str) {
        fs::create_dir_all(path).unwrap();
        fs::write(path.join(MANIFEST_FILE), format!("{{\"format\": \"{FORMAT}\", \"mark\": \"{mark}\"}}"))
            .unwrap();
    }

    fn mark(path: &Path) -> String {
        fs::read_to_string(path.join(MANIFEST_FILE)).unwrap()
    }

    fn entries(path: &Path) -> usize {
        fs::read_dir(path).unwrap().count()
    }

    #[test]
    fn force_replaces_only_our_own_output() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        output(&out, "first");
        assert!(matches!(StagedDir::begin(&out, false), Err(SliceError::Exists { .. })));
        let staged = StagedDir::begin(&out, true).unwrap();
        output(staged.path(), "second");
        assert!(mark(&out).contains("first"));
        staged.commit().unwrap();
        assert!(mark(&out).contains("second"));
        assert_eq!(entries(dir.path()), 1);

        let foreign = dir.path().join("photos");
        fs::create_dir(&foreign).unwrap();
        assert!(StagedDir::begin(&foreign, false).is_ok(), "an empty folder holds nothing to lose");
        fs::write(foreign.join("holiday.jpg"), "x").unwrap();
        let error = StagedDir::begin(&foreign, true).unwrap_err();
        assert!(error.to_string().contains("no slice manifest"), "{error}");
        let file = dir.path().join("file");
        fs::write(&file, "x").unwrap();
        assert!(matches!(StagedDir::begin(&file, true), Err(SliceError::Exists { .. })));
        assert!(matches!(StagedDir::begin(Path::new("/"), true), Err(SliceError::Invalid { .. })));
    }

    #[test]
    fn an_empty_folder_is_filled() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("a/b/out");
        fs::create_dir_all(&out).unwrap();
        let staged = StagedDir::begin(&out, false).unwrap();
        output(staged.path(), "new");
        staged.commit().unwrap();
        assert!(mark(&out).contains("new"));
    }

    #[test]
    fn a_failed_commit_keeps_the_old_output() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        output(&out, "old");
        let staged = StagedDir::begin(&out, true).unwrap();
        fs::remove_dir_all(staged.path()).unwrap();
        assert!(matches!(staged.commit(), Err(SliceError::Io(_))));
        assert!(mark(&out).contains("old"));
        assert_eq!(entries(dir.path()), 1);
    }

    #[test]
    fn an_output_that_appears_meanwhile_is_not_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let staged = StagedDir::begin(&out, false).unwrap();
        output(&out, "other");
        assert!(matches!(staged.commit(), Err(SliceError::Exists { .. })));
        assert!(mark(&out).contains("other"));
        assert_eq!(entries(dir.path()), 1);
    }

    #[test]
    fn sweeping_removes_leftovers_and_mends_a_torn_replacement() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let name = out.file_name().unwrap();
        output(&dir.path().join(".out.partial-7-0"), "half");
        output(&dir.path().join(".out.old-7-0"), "kept");
        output(&dir.path().join(".outer.partial-7-0"), "of another output");
        sweep(dir.path(), name, &out, STALE).unwrap();
        assert!(mark(&out).contains("kept"));
        assert_eq!(entries(dir.path()), 3, "a young partial folder may belong to a running job");
        output(&dir.path().join(".out.old-8-0"), "replaced");
        sweep(dir.path(), name, &out, Duration::ZERO).unwrap();
        assert!(mark(&out).contains("kept"));
        assert_eq!(entries(dir.path()), 2);
    }
}
