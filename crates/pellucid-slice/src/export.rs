//! Slice export: a label grid as one PNG a layer, or another container, and a manifest.

use std::path::Path;

use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_voxel::{Control, LabelGrid, MaterialTable};

use crate::check::check;
#[cfg(feature = "gcvf")]
use crate::container::gcvf;
#[cfg(feature = "npy")]
use crate::container::npy;
#[cfg(feature = "nrrd")]
use crate::container::nrrd;
use crate::container::png_stack::PngStack;
use crate::container::writer::write_layers;
use crate::manifest::{self, MANIFEST_FILE, Manifest};
use crate::{Container, ExportSettings, PrintTarget, SliceError};

/// What [`export`] writes into an output folder, known by its manifest. A caller that adds files to the same output adds
/// their names with [`OwnFiles::and`].
pub fn own_files() -> OwnFiles {
    OwnFiles::new([MANIFEST_FILE, "slices/slice_*.png"])
        .and([Container::Gcvf, Container::Nrrd, Container::Npy].map(Container::files))
        .marked_by(MANIFEST_FILE, manifest::is_manifest)
}

/// Writes `slices/slice_00000.png` (bottom layer) and upwards, or the one file of another [`Container`], and
/// `manifest.json` into the folder `dir`, which appears complete or not at all.
///
/// Every image is RGBA, x by y voxels, one pixel a voxel, in the target's colours and no others,
/// with its DPI; [`crate::RowOrder`] says which way is up. An object of fewer layers than the target needs is
/// padded with empty layers above, as the manifest says; volumes ([`Container::Nrrd`], [`Container::Npy`]) are not. The bytes are the same for any number of
/// threads; each thread holds one layer of labels. Progress counts layers.
///
/// # Errors
/// [`SliceError::Invalid`] for a grid at another pitch, with labels past the table or a material
/// without a colour; [`SliceError::Unsupported`] for an object larger than the build space, too
/// many materials, and as [`Container::check`]; [`SliceError::Output`] when `dir` holds anything but an earlier output, or one
/// and `settings.force` is not set; [`SliceError::Io`]; [`SliceError::Cancelled`]. Nothing is left behind and an existing output is untouched then.
pub fn export(
    grid: &LabelGrid,
    materials: &MaterialTable,
    target: &PrintTarget,
    settings: &ExportSettings,
    dir: &Path,
    control: &Control,
) -> Result<Manifest, SliceError> {
    let staged = StagedDir::begin(dir, settings.force, &own_files())?;
    let manifest = write_stack(grid, materials, target, settings, staged.path(), control)?;
    staged.commit()?;
    Ok(manifest)
}

/// As [`export`] into a folder that exists, for a caller that stages a larger output itself with
/// [`StagedDir`]. `settings.force` is not looked at; files of the same name are overwritten.
///
/// # Errors
/// As [`export`]; files written so far stay.
pub fn write_stack(
    grid: &LabelGrid,
    materials: &MaterialTable,
    target: &PrintTarget,
    settings: &ExportSettings,
    dir: &Path,
    control: &Control,
) -> Result<Manifest, SliceError> {
    control.check()?;
    let manifest = check(grid, materials, target, settings)?;
    let layers = manifest.layers;
    match settings.format {
        Container::Png => write_layers(grid, layers, PngStack::begin(dir, &manifest)?, control)?,
        #[cfg(feature = "gcvf")]
        Container::Gcvf => {
            let path = dir.join(settings.format.files());
            write_layers(grid, layers, gcvf::GcvfWriter::begin(path, grid, &manifest, target)?, control)?;
        }
        #[cfg(feature = "nrrd")]
        Container::Nrrd => {
            let path = dir.join(settings.format.files());
            write_layers(grid, layers, nrrd::NrrdWriter::begin(path, &manifest)?, control)?;
        }
        #[cfg(feature = "npy")]
        Container::Npy => {
            let path = dir.join(settings.format.files());
            write_layers(grid, layers, npy::NpyWriter::begin(path, manifest.size)?, control)?;
        }
        #[allow(unreachable_patterns)]
        other => return Err(other.missing()),
    }
    manifest.save(dir)?;
    Ok(manifest)
}
