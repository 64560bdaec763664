//! Labels as one NRRD volume, `labels.nrrd`, for volume viewers and research tools.
//!
//! `uint8`, gzip, axes x, y, z with x fastest, as the grid has them: z grows upwards. `space directions` are the voxels'
//! edges in mm, `space origin` is the centre of voxel (0, 0, 0), as the format has it. What a label stands for follows as
//! key/value pairs: `material 1:=cyan` and `rgba 1:=0 174 239 255`. The format is Kindlmann's; gzip as Deutsch 1996 has it.

mod header;

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use flate2::bufread::MultiGzDecoder;
use flate2::write::DeflateEncoder;
use flate2::{Compression, Crc};
use pellucid_core::FileError;
use pellucid_core::files::WholeFile;
use pellucid_voxel::{Control, Frame, LabelGrid};

use super::volume::read_labels;
use super::writer::LayerWriter;
use crate::SliceError;
use crate::decode::MAX_DEFLATE_RATIO;
use crate::manifest::{Manifest, ManifestMaterial};
use header::Header;

/// Magic, deflate, no name or time, unknown system.
const GZIP_HEADER: [u8; 10] = [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255];
/// The last block of deflated data, an empty one.
const LAST_BLOCK: [u8; 2] = [3, 0];

/// Reads a volume of `uint8` labels with data in the same file, raw or by gzip, and the materials that its key/value
/// pairs name, as far as voxels of them are there. Axes are x, y, z in mm; the lower corner may differ in its last digit
/// from what was written. Nothing is allocated for a size that the file cannot hold. Progress counts layers.
///
/// # Errors
/// [`SliceError::Io`]; [`SliceError::Invalid`] for what is no NRRD file, contradicts itself or is damaged;
/// [`SliceError::Unsupported`] for other types, encodings, axes and units, data in files of its own, and beyond what a
/// grid holds; [`SliceError::Cancelled`].
pub fn read(
    path: impl AsRef<Path>,
    control: &Control<'_>,
) -> Result<(LabelGrid, Vec<ManifestMaterial>), SliceError> {
    let path = path.as_ref();
    let (bytes, header) = open(path)?;
    let mm = header.pitch.mm();
    let corner = std::array::from_fn(|a| header.centre_mm[a] - mm[a] / 2.0);
    let grid = read_labels(Frame::new(corner, header.pitch, header.size)?, bytes, path, control)?;
    let counts = grid.histogram();
    let materials = header.materials.into_iter().filter_map(|(label, name, rgba)| {
        let voxels = counts[usize::from(label)];
        (voxels > 0).then_some(ManifestMaterial { label, name, rgba, voxels, resin: None })
    });
    Ok((grid, materials.collect()))
}

/// The same where a manifest says what the file must hold.
pub(crate) fn read_stated(
    path: &Path,
    manifest: &Manifest,
    control: &Control<'_>,
) -> Result<LabelGrid, SliceError> {
    let (bytes, header) = open(path)?;
    let frame = manifest.frame()?;
    let colors = header.materials.iter().map(|(label, _, rgba)| (*label, *rgba));
    let same = header.size == frame.size()
        && header.pitch == frame.pitch()
        && colors.eq(manifest.materials.iter().map(|m| (m.label, m.rgba)));
    if !same {
        return Err(SliceError::file(
            path,
            "has another size, pitch or other materials than the manifest says",
        ));
    }
    read_labels(frame, bytes, path, control)
}

/// A file at the first label, and its header.
fn open(path: &Path) -> Result<(Box<dyn Read>, Header), SliceError> {
    let file = File::open(path).map_err(FileError::at("read", path))?;
    let length = file.metadata().map_err(FileError::at("read", path))?.len();
    let mut bytes = BufReader::with_capacity(1 << 16, file);
    let header = Header::read(&mut bytes, path)?;
    let voxels = header.size.iter().map(|&s| u128::from(s)).product::<u128>();
    let data = u128::from(length.saturating_sub(header.bytes));
    let fits = match header.gzip {
        true => voxels <= data * u128::from(MAX_DEFLATE_RATIO),
        false => voxels == data,
    };
    if !fits {
        let reason = format!("has {length} bytes, which cannot be a volume of {:?} voxels", header.size);
        return Err(SliceError::file(path, reason));
    }
    Ok((if header.gzip { Box::new(MultiGzDecoder::new(bytes)) } else { Box::new(bytes) }, header))
}

/// A volume that is being written: one gzip member, whose layers are deflated each for itself.
pub(crate) struct NrrdWriter {
    path: PathBuf,
    out: BufWriter<WholeFile>,
    sum: Crc,
}

impl NrrdWriter {
    pub fn begin(path: PathBuf, manifest: &Manifest) -> Result<Self, SliceError> {
        let mut writer =
            Self { out: BufWriter::with_capacity(1 << 16, WholeFile::create(&path)?), path, sum: Crc::new() };
        writer.put(header::text(manifest).as_bytes())?;
        writer.put(&GZIP_HEADER)?;
        Ok(writer)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), SliceError> {
        Ok(self.out.write_all(bytes).map_err(FileError::at("write", &self.path))?)
    }
}

impl LayerWriter for NrrdWriter {
    /// Deflated up to a byte's end, and the checksum of what was deflated.
    type Layer = (Vec<u8>, Crc);

    fn encode(&self, _: u32, labels: &[u8], _: &Control<'_>) -> Result<Self::Layer, SliceError> {
        let mut sum = Crc::new();
        sum.update(labels);
        let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
        // A flush ends the block at a whole byte, so that the layers' data can be joined.
        encoder
            .write_all(labels)
            .and_then(|()| encoder.flush())
            .map_err(FileError::at("write", &self.path))?;
        Ok((std::mem::take(encoder.get_mut()), sum))
    }

    fn write(&mut self, (deflated, sum): Self::Layer) -> Result<(), SliceError> {
        self.sum.combine(&sum);
        self.put(&deflated)
    }

    fn finish(mut self, _: &Control<'_>) -> Result<(), SliceError> {
        self.put(&LAST_BLOCK)?;
        let (sum, length) = (self.sum.sum(), self.sum.amount());
        self.put(&sum.to_le_bytes())?;
        self.put(&length.to_le_bytes())?;
        let file = self.out.into_inner().map_err(|e| FileError::at("write", &self.path)(e.into_error()))?;
        Ok(file.commit()?)
    }
}
