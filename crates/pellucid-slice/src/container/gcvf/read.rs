//! Reading GCVFs without trust in what they claim.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::Mutex;

use pellucid_core::FileError;
use pellucid_voxel::{AIR, Control, Frame, LabelGrid, Pitch};
use png::{BitDepth, ColorType, Transformations};
use zip::ZipArchive;
use zip::result::ZipError;

use super::{CONFIG_FILE, Config};
use crate::decode::{Header, Image, MAX_DEFLATE_RATIO};
use crate::manifest::Manifest;
use crate::read::Slice;
use crate::slab::read_layers;
use crate::{RowOrder, SliceError};

/// Longest `ConfigFile.xml` that is read.
const MAX_CONFIG: u64 = 1 << 20;
/// Most voxels a byte of the archive. Images are deflated, and may be once more as entries, so that a small file could
/// claim more than anybody's memory; prints have a hundredth of this.
const MAX_VOXELS_A_BYTE: u64 = 1 << 16;

/// Reads the slices of a GCVF, of this program or another, as a grid with its lower corner at 0, and what the file says of
/// them. Label n is the nth material of the list, [`Config::materials`]; the top row of an image is the highest y.
///
/// Images are RGBA. Entries that share bytes, sizes that the entries cannot hold, and colours that are no material's are
/// refused; nothing is allocated on a claim alone. Memory: the grid, and per thread the images of 16 layers as files.
/// Progress counts layers.
///
/// # Errors
/// [`SliceError::Io`]; [`SliceError::Invalid`] for what is no GCVF, contradicts itself or is damaged;
/// [`SliceError::Unsupported`] for another version, encryption, and beyond what a grid holds; [`SliceError::Cancelled`].
pub fn read(path: impl AsRef<Path>, control: &Control<'_>) -> Result<(LabelGrid, Config), SliceError> {
    let path = path.as_ref();
    let (archive, config) = open(path)?;
    let pitch = Pitch::new(config.resolution.pitch_mm()).map_err(|e| SliceError::from(e).in_file(path))?;
    let [width, height] = config.slice_size;
    let slices = Slices {
        path,
        archive,
        config: &config,
        frame: Frame::new([0.0; 3], pitch, [width, height, config.slices])?,
        rows: RowOrder::HighestYFirst,
        colors: config.materials.iter().map(|m| m.rgba).zip(1..).collect(),
    };
    let grid = slices.read(control)?;
    let counts = grid.histogram();
    for (m, count) in config.materials.iter().zip(&counts[1..]) {
        if m.voxels != *count {
            let reason = format!("says {} voxels of {:?}, and its images hold {count}", m.voxels, m.name);
            return Err(SliceError::file(path, reason));
        }
    }
    Ok((grid, config))
}

/// The same where a manifest says what the file must hold.
pub(crate) fn read_stated(
    path: &Path,
    manifest: &Manifest,
    control: &Control<'_>,
) -> Result<LabelGrid, SliceError> {
    let (archive, config) = open(path)?;
    let [width, height, _] = manifest.size;
    let near = |(a, b): (&f64, f64)| (a / b - 1.0).abs() < 1e-6;
    let same = config.slice_size == [width, height]
        && config.slices == manifest.layers
        && config.background == manifest.background
        && config
            .materials
            .iter()
            .map(|m| (m.rgba, m.voxels))
            .eq(manifest.materials.iter().map(|m| (m.rgba, m.voxels)))
        && manifest.pitch_mm.iter().zip(config.resolution.pitch_mm()).all(near);
    if !same {
        let reason = "has another size, pitch, background or other materials than the manifest says";
        return Err(SliceError::file(path, reason));
    }
    let slices = Slices {
        path,
        archive,
        config: &config,
        frame: manifest.frame()?,
        rows: manifest.row_order,
        colors: manifest.materials.iter().map(|m| (m.rgba, m.label)).collect(),
    };
    slices.read(control)
}

type Archive = ZipArchive<BufReader<File>>;

/// An archive whose entries do not overlap, and its configuration.
fn open(path: &Path) -> Result<(Archive, Config), SliceError> {
    let file = File::open(path).map_err(FileError::at("read", path))?;
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|e| in_archive(path, e))?;
    if archive.has_overlapping_files().map_err(|e| in_archive(path, e))? {
        return Err(SliceError::file(path, "its entries share bytes; pack it again"));
    }
    let name = path.join(CONFIG_FILE);
    let bytes = entry(&mut archive, CONFIG_FILE, &name, |size| match size {
        0..=MAX_CONFIG => Ok(MAX_CONFIG),
        _ => Err(SliceError::file(&name, format!("has {size} bytes; {MAX_CONFIG} are read"))),
    })?;
    let xml = String::from_utf8(bytes).map_err(|_| SliceError::file(&name, "is no UTF-8 text"))?;
    let config = Config::parse(&xml, &name)?;
    Ok((archive, config))
}

/// The bytes of an entry, at most as many as `most` allows for the size that it claims; `path` is what errors call it.
fn entry(
    archive: &mut Archive,
    name: &str,
    path: &Path,
    most: impl FnOnce(u64) -> Result<u64, SliceError>,
) -> Result<Vec<u8>, SliceError> {
    let file = archive.by_name(name).map_err(|e| in_archive(path, e))?;
    let (size, packed) = (file.size(), file.compressed_size());
    if size > packed.saturating_mul(MAX_DEFLATE_RATIO).saturating_add(64) {
        let reason = format!("claims {size} bytes, which its {packed} cannot hold");
        return Err(SliceError::file(path, reason));
    }
    let most = most(size)?.min(size);
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes).map_err(|e| SliceError::reading(path, e, "its end"))?;
    if bytes.len() as u64 != size {
        return Err(SliceError::file(path, format!("claims {size} bytes and has others")));
    }
    Ok(bytes)
}

/// What is wrong with an archive, or the disk.
fn in_archive(path: &Path, error: ZipError) -> SliceError {
    let unsupported = |reason: String| SliceError::unsupported(path.display().to_string(), reason);
    match error {
        ZipError::Io(e) => SliceError::reading(path, e, "the archive's directory"),
        ZipError::FileNotFound => SliceError::file(path, "is missing"),
        ZipError::UnsupportedArchive(reason) => unsupported(reason.to_owned()),
        e @ ZipError::CompressionMethodNotSupported(_) => unsupported(e.to_string()),
        e => SliceError::file(path, format!("is not a readable zip archive: {e}")),
    }
}

/// The images of an archive.
struct Slices<'a> {
    path: &'a Path,
    archive: Archive,
    config: &'a Config,
    frame: Frame,
    rows: RowOrder,
    /// The label of each material's colour.
    colors: BTreeMap<[u8; 4], u8>,
}

impl Slices<'_> {
    fn read(self, control: &Control<'_>) -> Result<LabelGrid, SliceError> {
        let Config { slice_size, slices, background, .. } = *self.config;
        let length = std::fs::metadata(self.path).map_err(FileError::at("read", self.path))?.len();
        let voxels = slice_size.iter().fold(u64::from(slices), |n, &edge| n.saturating_mul(u64::from(edge)));
        if voxels > length.saturating_mul(MAX_VOXELS_A_BYTE) {
            let reason = format!("claims {voxels} voxels, and has {length} bytes");
            return Err(SliceError::file(self.path, reason));
        }
        let header =
            Header { size: slice_size, color: ColorType::Rgba, depth: BitDepth::Eight, interlaced: false };
        let mut colors = self.colors;
        colors.insert(background, AIR);
        let archive = Mutex::new(self.archive);
        let depth = self.frame.size()[2];
        let open = |layer: u32| {
            let name = format!("{}{}.png", self.config.prefix, self.config.start + layer);
            let path = self.path.join(&name);
            let bytes = {
                let mut archive = archive.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                entry(&mut archive, &name, &path, |size| header.check_length(size, &path))?
            };
            let image = Image::of_bytes(bytes, &path, header, Transformations::IDENTITY)?;
            Ok(Slice { image, colors: &colors, background, padding: layer >= depth })
        };
        read_layers(self.frame, slices, self.rows, open, control)
    }
}
