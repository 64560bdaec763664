//! Reads a stack of slices back into the label grid it was made from.

use std::collections::BTreeMap;
use std::path::Path;

use pellucid_voxel::{AIR, Control, LabelGrid};
use png::{BitDepth, ColorType, Transformations};
use rayon::prelude::*;

use crate::decode::{Header, Image};
use crate::manifest::{self, Manifest};
use crate::slab::{LayerRows, read_layers};
use crate::{Container, SliceError};

/// Reads `manifest.json` and the slices it names, in whatever [`Container`], from an output folder of
/// [`crate::export()`].
///
/// Labels, frame and voxel counts come back exactly. Every image is checked against the manifest
/// before it is decoded, a file too short or too long for its claimed size is refused before
/// anything is allocated for it, and colours outside the palette, material in the padding layers
/// or voxel counts other than the manifest's are errors. Memory: the grid, and per thread the
/// compressed files of 16 layers. Progress counts layers.
///
/// # Errors
/// [`SliceError::Io`] for a missing file, [`SliceError::Invalid`] naming the file for anything
/// inconsistent or corrupted, [`SliceError::Unsupported`] for a later format or a container that this build has not,
/// [`SliceError::Cancelled`].
pub fn read_stack(dir: &Path, control: &Control) -> Result<(LabelGrid, Manifest), SliceError> {
    let manifest = Manifest::load(dir)?;
    let grid = match manifest.container() {
        Container::Png => read_pngs(dir, &manifest, control)?,
        #[cfg(feature = "gcvf")]
        Container::Gcvf => {
            crate::container::gcvf::read_stated(&dir.join(&manifest.files), &manifest, control)?
        }
        #[cfg(feature = "nrrd")]
        Container::Nrrd => {
            crate::container::nrrd::read_stated(&dir.join(&manifest.files), &manifest, control)?
        }
        #[cfg(feature = "npy")]
        Container::Npy => {
            crate::container::npy::read_frame(&dir.join(&manifest.files), manifest.frame()?, control)?
        }
        #[allow(unreachable_patterns)]
        other => return Err(other.missing()),
    };
    check_counts(dir, &manifest, &grid)?;
    Ok((grid, manifest))
}

/// The manifest's voxels of every material, and none of others.
fn check_counts(dir: &Path, manifest: &Manifest, grid: &LabelGrid) -> Result<(), SliceError> {
    let mut counts = grid.histogram();
    let wrong = |reason: String| Err(SliceError::file(&dir.join(manifest::MANIFEST_FILE), reason));
    for m in &manifest.materials {
        let found = std::mem::take(&mut counts[usize::from(m.label)]);
        if found != m.voxels {
            return wrong(format!(
                "says {} voxels of {:?} and the slices hold {found}; export again",
                m.voxels, m.name
            ));
        }
    }
    match counts[1..].iter().position(|&count| count > 0) {
        Some(at) => {
            wrong(format!("has no material of label {}, which the slices hold; export again", at + 1))
        }
        None => Ok(()),
    }
}

/// The images of a stack must all be like this.
fn header_of(manifest: &Manifest) -> Header {
    let [width, height, _] = manifest.size;
    Header { size: [width, height], color: ColorType::Rgba, depth: BitDepth::Eight, interlaced: false }
}

fn read_pngs(dir: &Path, manifest: &Manifest, control: &Control) -> Result<LabelGrid, SliceError> {
    let header = header_of(manifest);
    (0..manifest.layers).into_par_iter().try_for_each(|layer| {
        control.check()?;
        header.check_file(&manifest.slice_path(dir, layer)).map(drop)
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
    read_layers(manifest.frame()?, manifest.layers, manifest.row_order, open, control)
}

/// One image of a stack.
pub(crate) struct Slice<'a> {
    pub image: Image,
    /// The label of each colour.
    pub colors: &'a BTreeMap<[u8; 4], u8>,
    pub background: [u8; 4],
    /// Lies above the object.
    pub padding: bool,
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
