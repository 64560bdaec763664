//! Slice export: a label grid as one PNG a layer and a manifest.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicU64;

use pellucid_core::FileError;
use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_voxel::{AIR, Control, LabelGrid, MaterialTable};
use rayon::prelude::*;

use crate::check::check;
use crate::encode::LayerFormat;
use crate::manifest::{self, MANIFEST_FILE, Manifest};
use crate::{ExportSettings, PrintTarget, SliceError};

/// What [`export`] writes into an output folder, known by its manifest. A caller that adds files to the same output adds
/// their names with [`OwnFiles::and`].
pub fn own_files() -> OwnFiles {
    OwnFiles::new([MANIFEST_FILE, "slices/slice_*.png"]).marked_by(MANIFEST_FILE, manifest::is_manifest)
}

/// Writes `slices/slice_00000.png` (bottom layer) and upwards and `manifest.json` into the folder
/// `dir`, which appears complete or not at all.
///
/// Every image is RGBA, x by y voxels, one pixel a voxel, in the target's colours and no others,
/// with its DPI; [`crate::RowOrder`] says which way is up. An object of fewer layers than the target needs is
/// padded with empty layers above, as the manifest says. The bytes are the same for any number of
/// threads; each thread holds one layer of labels. Progress counts layers.
///
/// # Errors
/// [`SliceError::Invalid`] for a grid at another pitch, with labels past the table or a material
/// without a colour; [`SliceError::Unsupported`] for an object larger than the build space or too
/// many materials; [`SliceError::Output`] when `dir` holds anything but an earlier output, or one
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
    let slices = dir.join("slices");
    fs::create_dir_all(&slices).map_err(FileError::at("create", &slices))?;
    let [width, height, depth] = grid.size();
    let mut colors = [manifest.background; 256];
    for m in &manifest.materials {
        colors[usize::from(m.label)] = m.rgba;
    }
    let format = LayerFormat {
        width,
        height,
        dpi: [target.dpi()[0], target.dpi()[1]],
        rows: target.row_order(),
        colors,
    };
    let done = AtomicU64::new(0);
    (0..manifest.layers).into_par_iter().try_for_each_init(
        || vec![AIR; width as usize * height as usize],
        |labels, z| {
            control.check()?;
            if z < depth {
                grid.copy_layer(z, labels)?;
            } else {
                labels.fill(AIR);
            }
            format.write(labels, &manifest::slice_path(dir, z), control)?;
            control.advance(&done, 1, u64::from(manifest.layers));
            Ok::<(), SliceError>(())
        },
    )?;
    manifest.save(dir)?;
    Ok(manifest)
}
