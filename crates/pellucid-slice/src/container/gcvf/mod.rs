//! GrabCAD's voxel file, `slices.gcvf`: a zip archive of the PNG slices and what describes them.
//!
//! There is no public specification; this follows the files of two public writers, and no printer's software was asked
//! yet whether it takes it. The archive holds
//!
//! | entry | what |
//! | --- | --- |
//! | `ConfigFile.xml` | resolution, size, materials with their colours and voxels: [`Config`] |
//! | `layer_0.png` … | one RGBA image a layer, bottom first, as in a PNG stack, padding included |
//! | `Mesh.stl` | the shape for display, in blocks: binary, mm, x from 0 to the width, y from 0 (top row) down to minus the height, z up |
//! | `MeshBbx.ktn` | six little-endian `f32`: least and greatest corner of what is solid, in columns, rows and layers |
//! | `Zbuffer.png` | 16-bit grey, one pixel a column of voxels: number of the topmost solid layer, 0 where there is none |
//!
//! Names of materials are the printer profile's resins ([`crate::PrintTarget::resins`]), or the materials' own.

mod config;
mod display;
mod read;

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use pellucid_core::files::WholeFile;
use pellucid_core::{Fault, FileError};
use pellucid_voxel::{Control, LabelGrid};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, System, ZipWriter};

use super::writer::LayerWriter;
use crate::encode::LayerFormat;
use crate::manifest::Manifest;
use crate::{PrintTarget, SliceError};

pub use config::{Config, ConfigMaterial};
pub use read::read;
pub(crate) use read::read_stated;

/// Most layers, whose numbers `Zbuffer.png` can hold.
const MAX_LAYERS: u32 = 1 << 16;
/// What comes before an image's number.
const PREFIX: &str = "layer_";
const CONFIG_FILE: &str = "ConfigFile.xml";

/// Voxel edges as a GCVF states them, in whole numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Resolution {
    /// Dots per inch along x and y.
    pub dpi: [u32; 2],
    /// Height of a layer in nanometres.
    pub layer_nm: u32,
}

impl Resolution {
    /// That of a printer.
    ///
    /// # Errors
    /// [`SliceError::Unsupported`] when its dots per inch or its layers' nanometres are not whole.
    ///
    /// ```
    /// use pellucid_slice::{PrintTarget, container::gcvf::Resolution};
    /// let target = PrintTarget::j750();
    /// let resolution = Resolution::of(&target)?;
    /// assert_eq!((resolution.dpi, resolution.layer_nm), ([600, 300], 27_000));
    /// assert_eq!(resolution.pitch_mm(), target.pitch().mm());
    /// # Ok::<(), pellucid_slice::SliceError>(())
    /// ```
    pub fn of(target: &PrintTarget) -> Result<Self, SliceError> {
        Self::new(target.dpi(), target.pitch().mm()).ok_or_else(|| {
            let reason = format!("pitch {:?} mm", target.pitch().mm());
            let fault = Fault::new(format!("printer profile {:?} for a GCVF", target.name()), reason)
                .remedy("whole dots per inch along x and y, and layers of whole nanometres");
            SliceError::Unsupported(fault)
        })
    }

    fn new([x, y, _]: [f64; 3], [.., layer_mm]: [f64; 3]) -> Option<Self> {
        let whole = |value: f64| {
            let near = value.round();
            ((1.0..4e9).contains(&near) && (value / near - 1.0).abs() < 1e-9).then_some(near as u32)
        };
        Some(Self { dpi: [whole(x)?, whole(y)?], layer_nm: whole(1e6 * layer_mm)? })
    }

    /// Edges of a voxel in mm.
    pub fn pitch_mm(self) -> [f64; 3] {
        let [x, y] = self.dpi.map(|dpi| 25.4 / f64::from(dpi));
        [x, y, f64::from(self.layer_nm) / 1e6]
    }
}

/// The same bytes on any day and system.
fn options(method: CompressionMethod) -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(method)
        .last_modified_time(DateTime::default())
        .system(System::Unix)
        .unix_permissions(0o644)
}

/// An archive that is being written.
pub(crate) struct GcvfWriter<'a> {
    path: PathBuf,
    zip: ZipWriter<Muted<BufWriter<WholeFile>>>,
    grid: &'a LabelGrid,
    format: LayerFormat,
    layers: u32,
}

impl<'a> GcvfWriter<'a> {
    pub fn begin(
        path: PathBuf,
        grid: &'a LabelGrid,
        manifest: &Manifest,
        target: &PrintTarget,
    ) -> Result<Self, SliceError> {
        if manifest.layers > MAX_LAYERS {
            let reason = format!("{} layers; a GCVF holds {MAX_LAYERS}", manifest.layers);
            return Err(SliceError::unsupported("object height", reason));
        }
        let out =
            Muted { inner: BufWriter::with_capacity(1 << 16, WholeFile::create(&path)?), failed: false };
        let mut writer =
            Self { zip: ZipWriter::new(out), path, grid, format: LayerFormat::of(manifest), layers: 0 };
        let config = Config::of(manifest, Resolution::of(target)?, target.max_materials());
        writer.put(CONFIG_FILE, CompressionMethod::Deflated, config.to_xml().as_bytes())?;
        Ok(writer)
    }

    fn put(&mut self, name: &str, method: CompressionMethod, bytes: &[u8]) -> Result<(), SliceError> {
        self.zip.start_file(name, options(method)).map_err(|e| failed(&self.path, e))?;
        Ok(self.zip.write_all(bytes).map_err(FileError::at("write", &self.path))?)
    }
}

/// A writer that takes anything once it has failed: a dropped archive tries to end itself, and tells the terminal if it
/// cannot.
struct Muted<W> {
    inner: W,
    failed: bool,
}

impl<W> Muted<W> {
    fn unless_failed<T>(&mut self, otherwise: T, act: impl FnOnce(&mut W) -> io::Result<T>) -> io::Result<T> {
        if self.failed {
            return Ok(otherwise);
        }
        let result = act(&mut self.inner);
        self.failed = result.as_ref().is_err_and(|e| e.kind() != io::ErrorKind::Interrupted);
        result
    }
}

impl<W: Write> Write for Muted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.unless_failed(bytes.len(), |inner| inner.write(bytes))
    }

    fn flush(&mut self) -> io::Result<()> {
        self.unless_failed((), Write::flush)
    }
}

impl<W: Seek> Seek for Muted<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.unless_failed(0, |inner| inner.seek(to))
    }
}

/// An archive could not be written.
fn failed(path: &Path, error: zip::result::ZipError) -> SliceError {
    FileError::at("write", path)(error.into()).into()
}

impl LayerWriter for GcvfWriter<'_> {
    /// A PNG file.
    type Layer = Vec<u8>;

    fn encode(&self, layer: u32, labels: &[u8], control: &Control<'_>) -> Result<Vec<u8>, SliceError> {
        let mut png = Vec::new();
        let name = self.path.join(image_name(layer));
        self.format.encode_to(labels, &mut png, &name, control)?;
        Ok(png)
    }

    fn write(&mut self, png: Vec<u8>) -> Result<(), SliceError> {
        let name = image_name(self.layers);
        self.layers += 1;
        // A PNG is deflated already.
        self.put(&name, CompressionMethod::Stored, &png)
    }

    fn finish(mut self, control: &Control<'_>) -> Result<(), SliceError> {
        let display = display::Display { grid: self.grid, rows: self.format.rows };
        self.put("Mesh.stl", CompressionMethod::Deflated, &display.stl())?;
        control.check()?;
        self.put("MeshBbx.ktn", CompressionMethod::Stored, &display.bounds())?;
        let zbuffer = display.zbuffer_png().map_err(|e| SliceError::file(&self.path, e.to_string()))?;
        self.put("Zbuffer.png", CompressionMethod::Stored, &zbuffer)?;
        control.check()?;
        let out = self.zip.finish().map_err(|e| failed(&self.path, e))?;
        let file = out.inner.into_inner().map_err(|e| FileError::at("write", &self.path)(e.into_error()))?;
        Ok(file.commit()?)
    }
}

fn image_name(layer: u32) -> String {
    format!("{PREFIX}{layer}.png")
}
