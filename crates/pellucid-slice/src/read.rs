//! Reads a stack of slices back into the label grid it was made from.

use std::collections::BTreeMap;
use std::path::Path;

use pellucid_voxel::{AIR, Control, LabelGrid};
use png::{BitDepth, ColorType, Transformations};
use rayon::prelude::*;

use crate::SliceError;
use crate::decode::{Header, Image};
use crate::manifest::{self, Manifest};
use crate::slab::{LayerRows, read_layers};

/// Reads `manifest.json` and the slices it names from an output folder of [`crate::export()`].
///
/// Labels, frame and voxel counts come back exactly. Every image is checked against the manifest
/// before it is decoded, a file too short or too long for its claimed size is refused before
/// anything is allocated for it, and colours outside the palette, material in the padding layers
/// or voxel counts other than the manifest's are errors. Memory: the grid, and per thread the
/// compressed files of 16 layers. Progress counts layers.
///
/// # Errors
/// [`SliceError::Io`] for a missing file, [`SliceError::Invalid`] naming the file for anything
/// inconsistent or corrupted, [`SliceError::Unsupported`] for a later format,
/// [`SliceError::Cancelled`].
pub fn read_stack(dir: &Path, control: &Control) -> Result<(LabelGrid, Manifest), SliceError> {
    let manifest = Manifest::load(dir)?;
    let [width, height, _] = manifest.size;
    let header =
        Header { size: [width, height], color: ColorType::Rgba, depth: BitDepth::Eight, interlaced: false };
    (0..manifest.layers).into_par_iter().try_for_each(|layer| {
        control.check()?;
        header.check_length(&manifest.slice_path(dir, layer)).map(drop)
    })?;
    let materials = manifest.materials.iter().map(|m| (m.rgba, m.label));
    let colors: BTreeMap<_, _> = materials.chain([(manifest.background, AIR)]).collect();
    let open = |layer| {
        let image = Image::open(&manifest.slice_path(dir, layer), header, Transformations::IDENTITY)?;
        Ok(Slice {
            image,
            colors: &colors,
            background: manifest.background,
            padding: layer >= manifest.size[2],
        })
    };
    let grid = read_layers(manifest.frame()?, manifest.layers, manifest.row_order, open, control)?;
    let counts = grid.histogram();
    for m in &manifest.materials {
        let found = counts[usize::from(m.label)];
        if found != m.voxels {
            return Err(SliceError::file(
                &dir.join(manifest::MANIFEST_FILE),
                format!("says {} voxels of {:?} and the slices hold {found}; export again", m.voxels, m.name),
            ));
        }
    }
    Ok((grid, manifest))
}

/// One image of a stack.
struct Slice<'a> {
    image: Image,
    colors: &'a BTreeMap<[u8; 4], u8>,
    background: [u8; 4],
    /// Lies above the object.
    padding: bool,
}

impl LayerRows for Slice<'_> {
    fn read_row(&mut self, row: u32, labels: &mut [u8]) -> Result<(), SliceError> {
        let mut last = (self.background, AIR);
        let mut wrong = None;
        for (x, (pixel, out)) in self.image.row(row)?.chunks_exact(4).zip(labels).enumerate() {
            let rgba = [pixel[0], pixel[1], pixel[2], pixel[3]];
            if rgba != last.0 {
                let Some(&label) = self.colors.get(&rgba) else {
                    wrong = Some(format!("pixel ({x}, {row}) is {rgba:?}, which is no material's colour"));
                    break;
                };
                last = (rgba, label);
            }
            if self.padding && last.1 != AIR {
                wrong = Some(format!("holds material at pixel ({x}, {row}) above the object"));
                break;
            }
            *out = last.1;
        }
        wrong.map_or(Ok(()), |reason| Err(SliceError::file(&self.image.path, reason)))
    }

    fn finish(&mut self) -> Result<(), SliceError> {
        self.image.finish()
    }
}
