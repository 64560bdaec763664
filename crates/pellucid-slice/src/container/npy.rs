//! Labels as one NumPy array, `labels.npy`.
//!
//! Format 1.0 (Kern 2007), `uint8`, C order, shape `(z, y, x)`: `numpy.load("labels.npy")[z, y, x]` is a voxel's label, 0 for air;
//! z grows upwards, y to the back. Pitch, origin and what the labels stand for are in `manifest.json` beside it.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use pellucid_core::files::WholeFile;
use pellucid_core::{Fault, FileError};
use pellucid_voxel::{Control, Frame, LabelGrid, Pitch};

use super::volume::read_labels;
use super::writer::LayerWriter;
use crate::SliceError;

const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header that is read.
const MAX_HEADER: usize = 1 << 16;

/// Reads a NumPy array of labels, `uint8` in C order with the shape `(z, y, x)`, as a grid of a pitch whose voxel
/// (0, 0, 0) has its lower corner at `origin_mm`. Nothing is allocated for a size that the file does not have. Progress
/// counts layers.
///
/// # Errors
/// [`SliceError::Io`]; [`SliceError::Invalid`] for what is no such array, or is damaged; [`SliceError::Unsupported`] for
/// arrays of another type, order or number of axes, and beyond what a grid holds; [`SliceError::Cancelled`].
pub fn read(
    path: impl AsRef<Path>,
    pitch: Pitch,
    origin_mm: [f64; 3],
    control: &Control<'_>,
) -> Result<LabelGrid, SliceError> {
    let (bytes, size) = open(path.as_ref())?;
    read_labels(Frame::new(origin_mm, pitch, size)?, bytes, path.as_ref(), control)
}

/// The same where the frame is known.
pub(crate) fn read_frame(path: &Path, frame: Frame, control: &Control<'_>) -> Result<LabelGrid, SliceError> {
    let (bytes, size) = open(path)?;
    if size != frame.size() {
        let reason = format!("has {size:?} voxels along x, y, z, and the manifest {:?}", frame.size());
        return Err(SliceError::file(path, reason));
    }
    read_labels(frame, bytes, path, control)
}

/// A file at the first label, and the voxels along x, y, z.
fn open(path: &Path) -> Result<(impl Read, [u32; 3]), SliceError> {
    let file = File::open(path).map_err(FileError::at("read", path))?;
    let length = file.metadata().map_err(FileError::at("read", path))?.len();
    let mut bytes = BufReader::with_capacity(1 << 16, file);
    let exact = |bytes: &mut [u8], from: &mut BufReader<File>| {
        from.read_exact(bytes).map_err(|e| SliceError::reading(path, e, "the header"))
    };
    let mut head = [0; 8];
    exact(&mut head, &mut bytes)?;
    if &head[..6] != MAGIC {
        return Err(SliceError::file(path, "is not a NumPy array (.npy)"));
    }
    let mut size_field = [0; 4];
    let size_bytes = if head[6] == 1 { 2 } else { 4 };
    exact(&mut size_field[..size_bytes], &mut bytes)?;
    let header_length = u32::from_le_bytes(size_field) as usize;
    if !(1..=3).contains(&head[6]) || header_length > MAX_HEADER {
        let reason = format!("has version {} and a header of {header_length} bytes", head[6]);
        return Err(unsupported(path, reason, "save it by numpy.save"));
    }
    let mut header = vec![0; header_length];
    exact(&mut header, &mut bytes)?;
    let size = shape(path, &String::from_utf8_lossy(&header))?;
    let voxels = size.iter().map(|&s| u128::from(s)).product::<u128>();
    let start = (8 + size_bytes + header_length) as u64;
    if u128::from(length.saturating_sub(start)) != voxels {
        let reason = format!("has {length} bytes, which is not an array of {size:?} voxels");
        return Err(SliceError::file(path, reason));
    }
    Ok((bytes, size))
}

/// Voxels along x, y, z, of a header that must be that of labels.
fn shape(path: &Path, header: &str) -> Result<[u32; 3], SliceError> {
    let value = |key: &str| {
        let at = header.find(&format!("'{key}':"));
        let rest = at.map(|at| header[at + key.len() + 3..].trim_start());
        rest.ok_or_else(|| SliceError::file(path, format!("its header has no '{key}'")))
    };
    let kind = value("descr")?;
    if !["'|u1'", "'u1'", "'<u1'", "'>u1'"].iter().any(|known| kind.starts_with(known)) {
        let kind = kind.split(',').next().unwrap_or_default();
        return Err(unsupported(path, format!("is of type {kind}"), "convert it by astype(\"uint8\")"));
    }
    if !value("fortran_order")?.starts_with("False") {
        return Err(unsupported(path, "is in Fortran order".into(), "save numpy.ascontiguousarray of it"));
    }
    let inside = value("shape")?.strip_prefix('(').and_then(|rest| rest.split_once(')'));
    let Some((numbers, _)) = inside else {
        return Err(SliceError::file(path, "its shape is not a tuple"));
    };
    let axes: Vec<&str> = numbers.split(',').map(str::trim).filter(|n| !n.is_empty()).collect();
    let [z, y, x] = axes[..] else {
        let reason = format!("has {} axes", axes.len());
        return Err(unsupported(path, reason, "labels have the axes (z, y, x)"));
    };
    let number = |text: &str| {
        text.parse().map_err(|_| SliceError::file(path, format!("its shape has {text:?}, which is no size")))
    };
    Ok([number(x)?, number(y)?, number(z)?])
}

fn unsupported(path: &Path, reason: String, remedy: &str) -> SliceError {
    SliceError::Unsupported(Fault::new(path.display().to_string(), reason).remedy(remedy))
}

/// An array that is being written.
pub(crate) struct NpyWriter {
    path: PathBuf,
    out: BufWriter<WholeFile>,
}

impl NpyWriter {
    pub fn begin(path: PathBuf, [x, y, z]: [u32; 3]) -> Result<Self, SliceError> {
        let mut out = BufWriter::with_capacity(1 << 16, WholeFile::create(&path)?);
        out.write_all(&header([x, y, z])).map_err(FileError::at("write", &path))?;
        Ok(Self { path, out })
    }
}

/// Magic, version, length and dictionary, padded so that the data begins at a multiple of 64 bytes.
fn header([x, y, z]: [u32; 3]) -> Vec<u8> {
    let dictionary = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({z}, {y}, {x}), }}");
    let length = (10 + dictionary.len() + 1).next_multiple_of(64) - 10;
    let mut bytes = MAGIC.to_vec();
    bytes.extend([1, 0]);
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{dictionary:<width$}\n", width = length - 1).bytes());
    bytes
}

impl LayerWriter for NpyWriter {
    type Layer = Vec<u8>;

    fn encode(&self, _: u32, labels: &[u8], _: &Control<'_>) -> Result<Vec<u8>, SliceError> {
        Ok(labels.to_vec())
    }

    fn write(&mut self, layer: Vec<u8>) -> Result<(), SliceError> {
        Ok(self.out.write_all(&layer).map_err(FileError::at("write", &self.path))?)
    }

    fn finish(self, _: &Control<'_>) -> Result<(), SliceError> {
        let file = self.out.into_inner().map_err(|e| FileError::at("write", &self.path)(e.into_error()))?;
        Ok(file.commit()?)
    }
}
