//! Which files in an output folder are the program's own.

use std::fs;
use std::path::{Path, PathBuf};

use crate::{FileError, files};

/// Most of a mark that is read, in bytes.
const MAX_MARK_BYTES: u64 = 16 << 20;
/// So many files that are not the program's are named.
const NAMED: usize = 5;

/// What a program writes into its output folder, so that nothing else is ever replaced or removed.
///
/// A pattern is a path below the folder, parted by `/`; `*` stands for any run of characters within one name, and a
/// `/` at the end for a folder with all that is in it. Capitals matter.
///
/// ```
/// use pellucid_core::staging::OwnFiles;
/// let own = OwnFiles::new(["manifest.json", "slices/slice_*.png"]).and(["proof.*"]);
/// # let folder = tempfile::tempdir()?;
/// std::fs::write(folder.path().join("proof.png"), "")?;
/// assert!(own.foreign(folder.path())?.is_empty());
/// std::fs::write(folder.path().join("cat.glb"), "")?;
/// assert_eq!(own.foreign(folder.path())?, [std::path::Path::new("cat.glb")]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct OwnFiles {
    patterns: Vec<Vec<String>>,
    mark: Option<Mark>,
}

/// A file by whose contents the program knows its own output again.
#[derive(Clone, Debug)]
struct Mark {
    name: String,
    accepts: fn(&[u8]) -> bool,
}

impl OwnFiles {
    /// The files that match one of the patterns.
    pub fn new<S: AsRef<str>>(patterns: impl IntoIterator<Item = S>) -> Self {
        Self::default().and(patterns)
    }

    /// The same and those that match one of `patterns`.
    pub fn and<S: AsRef<str>>(mut self, patterns: impl IntoIterator<Item = S>) -> Self {
        let parts = |p: S| p.as_ref().split('/').map(str::to_owned).collect();
        self.patterns.extend(patterns.into_iter().map(parts));
        self
    }

    /// The same, where a folder without a file `name` of which `accepts` is true holds nothing of the program's: names
    /// such as `manifest.json` are used by others too. Files longer than 16 MiB are not accepted.
    pub fn marked_by(mut self, name: impl Into<String>, accepts: fn(&[u8]) -> bool) -> Self {
        self.mark = Some(Mark { name: name.into(), accepts });
        self
    }

    /// Files and folders in `folder` that are not the program's, by path below it: the first few in order of name, none
    /// when all are. Links are files here and never followed.
    ///
    /// # Errors
    /// [`FileError`] when a folder cannot be read.
    pub fn foreign(&self, folder: &Path) -> Result<Vec<PathBuf>, FileError> {
        let marked = self.mark.as_ref().is_none_or(|mark| {
            let path = folder.join(&mark.name);
            fs::symlink_metadata(&path).is_ok_and(|m| m.is_file())
                && files::read_bounded(&path, MAX_MARK_BYTES).is_ok_and(|bytes| (mark.accepts)(&bytes))
        });
        if marked { self.foreign_names(folder) } else { Self::default().foreign_names(folder) }
    }

    /// [`OwnFiles::foreign`] by name alone.
    pub(super) fn foreign_names(&self, folder: &Path) -> Result<Vec<PathBuf>, FileError> {
        let patterns: Vec<&[String]> = self.patterns.iter().map(Vec::as_slice).collect();
        let mut found = Vec::new();
        walk(folder, Path::new(""), &patterns, &mut found)?;
        Ok(found)
    }
}

/// Looks through `root/below`; `patterns` are what is left of those that match the path so far.
fn walk(
    root: &Path,
    below: &Path,
    patterns: &[&[String]],
    found: &mut Vec<PathBuf>,
) -> Result<(), FileError> {
    let folder = root.join(below);
    let entries = fs::read_dir(&folder).and_then(|entries| {
        entries.map(|e| e.and_then(|e| Ok((e.file_name(), e.file_type()?)))).collect::<Result<Vec<_>, _>>()
    });
    let mut entries = entries.map_err(FileError::at("read", &folder))?;
    entries.sort_by(|a, b| a.0.cmp(&b.0));
    for (name, kind) in entries {
        if found.len() == NAMED {
            break;
        }
        // No pattern matches a name that is not Unicode.
        let text = name.to_str();
        let matching: Vec<&[String]> = patterns
            .iter()
            .filter(|p| text.is_some_and(|text| files::name_matches(&p[0], text)))
            .map(|p| &p[1..])
            .collect();
        let path = below.join(&name);
        let whole = matching.iter().any(|rest| matches!(rest, [end] if end.is_empty()));
        if kind.is_dir() && !whole {
            let inside: Vec<&[String]> = matching.into_iter().filter(|rest| !rest.is_empty()).collect();
            if inside.is_empty() {
                found.push(path);
            } else {
                walk(root, &path, &inside, found)?;
            }
        } else if !kind.is_dir() && !matching.iter().any(|rest| rest.is_empty()) {
            found.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_the_patterns_name_is_own() {
        let temp = tempfile::tempdir().unwrap();
        let write = |name: &str| {
            let path = temp.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "{}").unwrap();
        };
        let own = OwnFiles::new(["slices/slice_*.png", "manifest.json", "cache/"]);
        for name in ["slices/slice_1.png", "manifest.json", "cache/deep/anything"] {
            write(name);
        }
        assert_eq!(own.foreign(temp.path()).unwrap(), Vec::<PathBuf>::new());
        for name in
            ["slices/notes.txt", "slices/slice_2.png/x", "photos/holiday.jpg", "manifest.json.bak", ".hidden"]
        {
            write(name);
        }
        let foreign = own.foreign(temp.path()).unwrap();
        let names = [".hidden", "manifest.json.bak", "photos", "slices/notes.txt", "slices/slice_2.png"];
        assert_eq!(foreign, names.map(PathBuf::from));
        for i in 0..20 {
            write(&format!("more{i}"));
        }
        assert_eq!(own.foreign(temp.path()).unwrap().len(), NAMED);
    }

    #[test]
    fn without_its_mark_a_folder_holds_nothing_of_ours() {
        let temp = tempfile::tempdir().unwrap();
        let own = OwnFiles::new(["manifest.json", "report.json"])
            .marked_by("manifest.json", |bytes| bytes.starts_with(b"ours"));
        assert!(own.foreign(temp.path()).unwrap().is_empty(), "an empty folder holds nothing to lose");
        fs::write(temp.path().join("report.json"), "").unwrap();
        assert_eq!(own.foreign(temp.path()).unwrap(), [PathBuf::from("report.json")]);
        fs::write(temp.path().join("manifest.json"), "theirs").unwrap();
        assert_eq!(own.foreign(temp.path()).unwrap().len(), 2);
        fs::write(temp.path().join("manifest.json"), "ours").unwrap();
        assert!(own.foreign(temp.path()).unwrap().is_empty());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_is_no_folder_of_ours() {
        let temp = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(elsewhere.path(), temp.path().join("slices")).unwrap();
        let own = OwnFiles::new(["slices/"]);
        assert_eq!(own.foreign(temp.path()).unwrap(), [PathBuf::from("slices")]);
    }
}
