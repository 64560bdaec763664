//! Files that are read within a bound and written whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::FileError;

/// Reads a file of at most `limit` bytes.
///
/// # Errors
/// [`FileError`] when it cannot be read, is no file, or is longer (kind `FileTooLarge`).
pub fn read_bounded(path: impl AsRef<Path>, limit: u64) -> Result<Vec<u8>, FileError> {
    let path = path.as_ref();
    read(path, limit).map_err(FileError::at("read", path))
}

/// [`read_bounded`] of UTF-8 text.
///
/// # Errors
/// As there, and of kind `InvalidData` where the bytes are no UTF-8.
pub fn read_text_bounded(path: impl AsRef<Path>, limit: u64) -> Result<String, FileError> {
    let path = path.as_ref();
    let bytes = read_bounded(path, limit)?;
    String::from_utf8(bytes)
        .map_err(|e| FileError::at("read", path)(io::Error::new(io::ErrorKind::InvalidData, e)))
}

fn read(path: &Path, limit: u64) -> io::Result<Vec<u8>> {
    let file = File::open(path)?;
    let mut bytes = Vec::new();
    // The length that a file's entry claims may be wrong or grow: the bound holds while reading.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > limit {
        let text = format!("larger than the {limit} bytes that are read");
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, text));
    }
    Ok(bytes)
}

/// Writes a file by way of a temporary one in the same folder, which takes its name once all of it is on the disk: a
/// crash leaves the old file, or none.
///
/// # Errors
/// [`FileError`]; the temporary file is gone then.
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("report.json");
/// pellucid_core::files::write_whole(&path, |out| std::io::Write::write_all(out, b"{}"))?;
/// assert_eq!(std::fs::read(&path)?, b"{}");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_whole(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut BufWriter<WholeFile>) -> io::Result<()>,
) -> Result<(), FileError> {
    let path = path.as_ref();
    let mut out = BufWriter::new(WholeFile::create(path)?);
    let written = write(&mut out).and_then(|()| out.into_inner().map_err(io::IntoInnerError::into_error));
    written.map_err(FileError::at("write", path))?.commit()
}

/// A file that is written under a temporary name in the same folder and takes its own with [`WholeFile::commit`], for
/// writers that go back to what they wrote. Dropped before that it leaves the old file, or none. It has no buffer.
///
/// ```
/// use pellucid_core::files::WholeFile;
/// use std::io::Write;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("labels.npy");
/// let mut file = WholeFile::create(&path)?;
/// file.write_all(b"...")?;
/// assert!(!path.exists());
/// file.commit()?;
/// assert_eq!(std::fs::read(&path)?, b"...");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct WholeFile {
    file: File,
    path: PathBuf,
    temporary: PathBuf,
    committed: bool,
}

impl WholeFile {
    /// Creates the temporary file.
    ///
    /// # Errors
    /// [`FileError`] naming `path`.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FileError> {
        let path = path.as_ref();
        let (temporary, file) = create_beside(path).map_err(FileError::at("create", path))?;
        Ok(Self { file, path: path.to_owned(), temporary, committed: false })
    }

    /// Gives the file its name once all of it is on the disk.
    ///
    /// # Errors
    /// [`FileError`]; the temporary file is gone then.
    pub fn commit(mut self) -> Result<(), FileError> {
        let placed = self.file.sync_all().and_then(|()| fs::rename(&self.temporary, &self.path));
        placed.map_err(FileError::at("write", &self.path))?;
        self.committed = true;
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for WholeFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if !self.committed {
            // What failed is told; that its remains could not be removed either would say nothing more.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

/// [`write_whole`] of bytes at hand.
///
/// # Errors
/// As there.
pub fn write_whole_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<(), FileError> {
    write_whole(path, |out| out.write_all(bytes))
}

/// Whether a file's name matches a pattern, in which `*` stands for any run of characters. Capitals matter.
///
/// ```
/// use pellucid_core::files::name_matches;
/// assert!(name_matches("slice_*.png", "slice_0017.png"));
/// ```
pub fn name_matches(pattern: &str, name: &str) -> bool {
    let Some((head, rest)) = pattern.split_once('*') else { return pattern == name };
    let Some(mut name) = name.strip_prefix(head) else { return false };
    let Some((middle, tail)) = rest.rsplit_once('*') else {
        return name.ends_with(rest);
    };
    // The leftmost place of each piece leaves most for the next.
    for piece in middle.split('*') {
        match name.find(piece) {
            Some(at) => name = &name[at + piece.len()..],
            None => return false,
        }
    }
    name.ends_with(tail)
}

/// A new file `.NAME.partial-PID-N` beside `path`.
fn create_beside(path: &Path) -> io::Result<(PathBuf, File)> {
    let name = path
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"))?;
    for n in 0..u32::MAX {
        let mut temporary = std::ffi::OsString::from(".");
        temporary.push(name);
        temporary.push(format!(".partial-{}-{n}", std::process::id()));
        let temporary = path.with_file_name(temporary);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((temporary, file)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(io::Error::new(io::ErrorKind::AlreadyExists, "no free temporary name"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_whole_bytes(&path, b"old").unwrap();
        let error = write_whole(&path, |out| {
            out.write_all(b"half of the new")?;
            Err(io::Error::other("disk full"))
        })
        .unwrap_err();
        assert_eq!(crate::chain(&error), format!("cannot write {}: disk full", path.display()));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        assert!(write_whole_bytes(folder.path().join("none/a.txt"), b"").is_err());
    }

    #[test]
    fn reading_stops_at_the_bound() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bin");
        fs::write(&path, [7; 100]).unwrap();
        assert_eq!(read_bounded(&path, 100).unwrap(), [7; 100]);
        let error = read_bounded(&path, 99).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::FileTooLarge);
        // A device without an end is no reason to read on.
        if Path::new("/dev/zero").exists() {
            assert!(read_bounded("/dev/zero", 1000).is_err());
        }
        fs::write(&path, [0xff, 0xfe]).unwrap();
        assert_eq!(read_text_bounded(&path, 9).unwrap_err().source.kind(), io::ErrorKind::InvalidData);
    }

    #[test]
    fn stars_stand_for_any_run_of_characters() {
        for (pattern, name, right) in [
            ("a.json", "a.json", true),
            ("a.json", "A.json", false),
            ("slice_*.png", "slice_00001.png", true),
            ("slice_*.png", "slice_.png", true),
            ("slice_*.png", "slice_1.png.txt", false),
            ("slice_*g", "slice_", false),
            ("proof.*", "proof.exr", true),
            ("proof.*", "proof", false),
            ("*", "anything", true),
            ("a*b*c", "a1b2b3c", true),
            ("a*b*c", "a1c", false),
            ("a*a", "a", false),
            ("**", "x", true),
        ] {
            assert_eq!(name_matches(pattern, name), right, "{pattern} {name}");
        }
    }
}
