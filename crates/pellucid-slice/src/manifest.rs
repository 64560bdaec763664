//! The manifest beside a stack of slices.

use std::path::{Path, PathBuf};

use pellucid_core::{Fault, files};
use pellucid_voxel::{Frame, Pitch};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{Container, Recorded, RowOrder, SliceError, json};

/// What `format` says in every manifest.
pub const FORMAT: &str = "pellucid-slices";
/// The version this crate writes and reads.
pub const FORMAT_VERSION: u32 = 1;
/// File name of the manifest in an output folder.
pub const MANIFEST_FILE: &str = "manifest.json";
/// Where the slices lie in an output folder, printf style; the number is the layer, 0 at the bottom.
pub const FILE_PATTERN: &str = "slices/slice_%05d.png";
/// Largest manifest that is read, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// One material of a print.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ManifestMaterial {
    /// Label in the voxel grid, 1 to 255.
    pub label: u8,
    /// Name in the material table.
    pub name: String,
    /// The printer's own name of it, where the profile knows one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resin: Option<String>,
    /// The colour that stands for it in the images.
    pub rgba: [u8; 4],
    /// Number of voxels of it.
    pub voxels: u64,
}

/// Everything another tool needs to use a stack of slices. Written as `manifest.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Always [`FORMAT`].
    pub format: String,
    /// Version of this format, [`FORMAT_VERSION`].
    pub format_version: u32,
    /// Program and version that wrote the stack.
    pub generator: String,
    /// Name of the print target.
    pub target: String,
    /// Voxel edges `[x, y, z]` in millimetres.
    pub pitch_mm: [f64; 3],
    /// Dots per inch along `[x, y, z]`.
    pub dpi: [f64; 3],
    /// Lower corner of voxel (0, 0, 0) in millimetres, z up.
    pub origin_mm: [f64; 3],
    /// Voxels of the object's grid along `[x, y, z]`; every image is `size[0]` x `size[1]` pixels.
    pub size: [u32; 3],
    /// Number of layers: `size[2]` and the padding above.
    pub layers: u32,
    /// Empty layers above the object, added where the printer asks for more layers.
    pub padding_layers: u32,
    /// Image names, printf style over the layer number, bottom layer 0 first; or the one file of another container,
    /// [`Container::files`].
    pub files: String,
    /// Which end of the y axis is the top row of an image, or comes first in a volume.
    pub row_order: RowOrder,
    /// The same in words, for a reader without this crate.
    pub orientation: String,
    /// Colour of empty space.
    pub background: [u8; 4],
    /// The materials in use, by ascending label.
    pub materials: Vec<ManifestMaterial>,
    /// Random seed of the preparation.
    pub seed: u64,
    /// Further settings of the program that wrote the stack.
    pub settings: Recorded,
}

impl Manifest {
    /// What the slices are written as.
    pub fn container(&self) -> Container {
        Container::of_files(&self.files).unwrap_or_default()
    }

    /// Path of a layer's image in the output folder `dir` of a [`Container::Png`].
    pub fn slice_path(&self, dir: &Path, layer: u32) -> PathBuf {
        slice_path(dir, layer)
    }

    /// The frame of the object's grid.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] or [`SliceError::Unsupported`] as [`Frame::new`].
    pub fn frame(&self) -> Result<Frame, SliceError> {
        Ok(Frame::new(self.origin_mm, Pitch::new(self.pitch_mm)?, self.size)?)
    }

    /// Reads and checks `manifest.json` in an output folder.
    ///
    /// # Errors
    /// [`SliceError::Io`] when it cannot be read, [`SliceError::Invalid`] when it is not a
    /// consistent manifest, [`SliceError::Unsupported`] for another format version.
    pub fn load(dir: &Path) -> Result<Self, SliceError> {
        let path = dir.join(MANIFEST_FILE);
        let text = files::read_text_bounded(&path, MAX_BYTES)?;
        Self::parse(&text).map_err(|error| error.in_file(&path))
    }

    fn parse(text: &str) -> Result<Self, SliceError> {
        let Head { format, format_version } = json::parse("manifest", text)?;
        if format.as_ref().and_then(Value::as_str) != Some(FORMAT) {
            let reason = format!("is not that of a slice manifest, {FORMAT:?}");
            return Err(SliceError::invalid("manifest, format", reason));
        }
        if format_version.as_ref().and_then(Value::as_u64) != Some(u64::from(FORMAT_VERSION)) {
            let version = format_version.map_or("none".into(), |v| v.to_string());
            let fault = Fault::new("manifest, format_version", format!("{version} is not known"))
                .remedy(format!("this release reads {FORMAT_VERSION}"));
            return Err(SliceError::Unsupported(fault));
        }
        let manifest: Manifest = json::parse("manifest", text)?;
        manifest.check()?;
        Ok(manifest)
    }

    /// Writes the manifest into an output folder.
    pub(crate) fn save(&self, dir: &Path) -> Result<(), SliceError> {
        let path = dir.join(MANIFEST_FILE);
        let mut text =
            serde_json::to_string_pretty(self).map_err(|e| SliceError::file(&path, e.to_string()))?;
        text.push('\n');
        Ok(files::write_whole_bytes(&path, text.as_bytes())?)
    }

    /// Checks that the fields agree with each other.
    fn check(&self) -> Result<(), SliceError> {
        let invalid =
            |field: &str, reason: String| Err(SliceError::invalid(format!("manifest, {field}"), reason));
        let frame = self.frame()?;
        if self.size[2].checked_add(self.padding_layers) != Some(self.layers) {
            let reason = format!(
                "{} must be size[2] {} and padding_layers {}",
                self.layers, self.size[2], self.padding_layers
            );
            return invalid("layers", reason);
        }
        if self.layers > Frame::MAX_EDGE {
            return invalid("layers", format!("{} passes {}", self.layers, Frame::MAX_EDGE));
        }
        if Container::of_files(&self.files).is_none() {
            let known = Container::ALL.map(Container::files).join(", ");
            return invalid("files", format!("{:?} must be one of {known}", self.files));
        }
        let mut colors = vec![self.background];
        let mut label = 0;
        let mut voxels = 0u64;
        for m in &self.materials {
            if m.label <= label {
                return invalid("materials", format!("label {} of {:?} must ascend from 1", m.label, m.name));
            }
            if colors.contains(&m.rgba) {
                return invalid("materials", format!("{:?} has a colour in use, {:?}", m.name, m.rgba));
            }
            label = m.label;
            colors.push(m.rgba);
            match voxels.checked_add(m.voxels).filter(|&sum| sum <= frame.voxels()) {
                Some(sum) => voxels = sum,
                None => {
                    return invalid("materials", format!("more voxels than the grid's {}", frame.voxels()));
                }
            }
        }
        Ok(())
    }
}

/// What tells whether a text is a manifest, and of which version.
#[derive(Deserialize)]
struct Head {
    format: Option<Value>,
    format_version: Option<Value>,
}

/// Whether a file's contents are a manifest of any version.
pub(crate) fn is_manifest(bytes: &[u8]) -> bool {
    serde_json::from_slice::<Head>(bytes)
        .is_ok_and(|head| head.format.as_ref().and_then(Value::as_str) == Some(FORMAT))
}

/// Path of a layer's image in the output folder `dir`, as [`FILE_PATTERN`].
pub(crate) fn slice_path(dir: &Path, layer: u32) -> PathBuf {
    dir.join("slices").join(format!("slice_{layer:05}.png"))
}

/// The words for [`Manifest::orientation`].
pub(crate) fn orientation(container: Container, rows: RowOrder) -> String {
    if !container.is_for_printers() {
        return "Labels are ordered by z, y, x, with x fastest; z grows upwards from the bottom layer 0, and x and y \
                as in the manifest's lengths. The axes are right-handed."
            .into();
    }
    let rows = match rows {
        RowOrder::HighestYFirst => {
            "The top row of an image is the highest y, so an image viewer shows the layer as seen from above"
        }
        RowOrder::LowestYFirst => {
            "The top row of an image is y = 0, so an image viewer shows the layer mirrored, as seen from below"
        }
    };
    format!(
        "Layer 0 is the bottom; z grows upwards with the layer number. x grows with the column. {rows}. \
         The axes are right-handed."
    )
}
