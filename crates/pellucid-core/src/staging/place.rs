//! Where an output folder lies.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::StagingError;
use crate::{Fault, FileError};

/// An output folder by its parent and name, links to it resolved.
#[derive(Debug)]
pub(super) struct Place {
    pub target: PathBuf,
    pub parent: PathBuf,
    pub name: OsString,
}

impl Place {
    pub fn of(target: &Path) -> Result<Self, StagingError> {
        let invalid = |reason: &str, remedy: &str| {
            let subject = format!("output folder {}", target.display());
            Err(StagingError::Invalid(Fault::new(subject, reason).remedy(remedy)))
        };
        // Without a slash at the end, behind which a link would not be seen as one.
        let target: &Path = &target.components().collect::<PathBuf>();
        let linked = fs::symlink_metadata(target).is_ok_and(|m| m.is_symlink());
        // A link that leads nowhere stays as it is, and is refused when its replaceability is looked at.
        let resolved = if linked { fs::canonicalize(target).ok() } else { None };
        let path = resolved.unwrap_or_else(|| target.to_owned());
        let Some(name) = path.file_name() else {
            return invalid("has no name of its own", "name a new folder");
        };
        let parent = match path.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        let place = Self { parent: parent.to_owned(), name: name.to_owned(), target: path };
        if place.is_mount_point() {
            return invalid("is where another file system is mounted", "name a new folder in it");
        }
        Ok(place)
    }

    /// `.NAME.`, a kind and a tag beside the output folder: the hidden names this module uses.
    pub fn sibling(&self, kind: &str, tag: &str) -> PathBuf {
        let mut out = OsString::from(".");
        out.push(&self.name);
        out.push(".");
        out.push(kind);
        out.push(tag);
        self.parent.join(out)
    }

    /// Whether the folders above can take the output, as far as looking can tell.
    pub fn check_parent(&self) -> Result<(), StagingError> {
        for above in self.parent.ancestors() {
            let above = if above.as_os_str().is_empty() { Path::new(".") } else { above };
            let kind = match fs::metadata(above) {
                Ok(meta) if !meta.is_dir() => io::ErrorKind::NotADirectory,
                Ok(meta) if meta.permissions().readonly() => io::ErrorKind::PermissionDenied,
                Ok(_) => return Ok(()),
                Err(e) if e.kind() == io::ErrorKind::NotFound => continue,
                Err(e) => return Err(FileError::at("look at", above)(e).into()),
            };
            return Err(FileError::at("write into", above)(kind.into()).into());
        }
        Ok(())
    }

    /// A mount point cannot be renamed, so an output that replaced it would fail when all work is done.
    #[cfg(unix)]
    fn is_mount_point(&self) -> bool {
        use std::os::unix::fs::MetadataExt;
        let device = |path: &Path| fs::metadata(path).map(|m| m.dev()).ok();
        let (own, parent) = (device(&self.target), device(&self.parent));
        own.is_some() && parent.is_some() && own != parent
    }

    #[cfg(not(unix))]
    fn is_mount_point(&self) -> bool {
        false
    }
}

/// Folders that were made above an output folder, outermost first.
#[derive(Debug, Default)]
pub(super) struct MadeParents(Vec<PathBuf>);

impl MadeParents {
    /// Makes `parent` and what is missing above it; what was made is gone again on an error.
    pub fn make(parent: &Path) -> Result<Self, StagingError> {
        let mut missing = Vec::new();
        for above in parent.ancestors() {
            if above.as_os_str().is_empty() || fs::metadata(above).is_ok() {
                break;
            }
            missing.push(above.to_owned());
        }
        let mut made = Self::default();
        for folder in missing.into_iter().rev() {
            match fs::create_dir(&folder) {
                Ok(()) => made.0.push(folder),
                // Another run was first, and it is that one's to remove.
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && folder.is_dir() => {}
                Err(e) => return Err(FileError::at("create", folder)(e).into()),
            }
        }
        Ok(made)
    }

    /// Lets them stay.
    pub fn keep(&mut self) {
        self.0.clear();
    }

    /// Removes those that are empty.
    pub fn remove(&mut self) {
        while let Some(folder) = self.0.pop() {
            let _ = fs::remove_dir(folder);
        }
    }
}

impl Drop for MadeParents {
    fn drop(&mut self) {
        self.remove();
    }
}
