//! Slice export: a label grid as one PNG a layer and a manifest.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicU64;

use pellucid_voxel::{AIR, Control, LabelGrid, MaterialTable};
use rayon::prelude::*;
use serde_json::{Map, Value};

use crate::encode::LayerFormat;
use crate::manifest::{self, FILE_PATTERN, FORMAT, FORMAT_VERSION, Manifest, ManifestMaterial};
use crate::{PrintTarget, SliceError, StagedDir};

/// What the caller wants recorded, and whether an output may be replaced.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportSettings {
    /// Replace an existing output of this program.
    pub force: bool,
    /// Random seed of the preparation, for the manifest.
    pub seed: u64,
    /// Program and version, for the manifest.
    pub generator: String,
    /// Anything else worth recording in the manifest.
    pub settings: Map<String, Value>,
}

impl Default for ExportSettings {
    fn default() -> Self {
        Self {
            force: false,
            seed: 0,
            generator: concat!("pellucid-slice ", env!("CARGO_PKG_VERSION")).into(),
            settings: Map::new(),
        }
    }
}

/// Checks that `target` can print `grid`, without writing anything, and returns the manifest that
/// an export would write.
///
/// # Errors
/// As [`export`], but for the output folder and [`SliceError::Io`].
pub fn check(
    grid: &LabelGrid,
    materials: &MaterialTable,
    target: &PrintTarget,
    settings: &ExportSettings,
) -> Result<Manifest, SliceError> {
    let frame = grid.frame();
    let (have, want) = (frame.pitch().mm(), target.pitch().mm());
    if have.iter().zip(want).any(|(h, w)| (h / w - 1.0).abs() > 1e-6) {
        return Err(SliceError::invalid(
            "grid pitch",
            format!(
                "{have:?} mm is not that of {:?}, {want:?} mm; voxelise at the target's pitch",
                target.name()
            ),
        ));
    }
    for (a, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let (mm, most) = (f64::from(grid.size()[a]) * want[a], target.build_space_mm()[a]);
        if mm > most * (1.0 + 1e-9) {
            return Err(SliceError::unsupported(
                "object size",
                format!(
                    "{mm:.2} mm along {axis} is more than the {most} mm of {:?}; scale or turn the model",
                    target.name()
                ),
            ));
        }
    }
    let mut used = Vec::new();
    for (label, &voxels) in (0..=255u8).zip(&grid.histogram()) {
        if label == AIR || voxels == 0 {
            continue;
        }
        let material = materials.get(label).ok_or_else(|| {
            SliceError::invalid(
                "grid",
                format!("{voxels} voxels have label {label}; the material table ends at {}", materials.len()),
            )
        })?;
        let rgba = target.color_of(&material.name).ok_or_else(|| {
            SliceError::invalid(
                format!("printer profile {:?}, palette", target.name()),
                format!("has no colour for material {:?} (label {label}); add one", material.name),
            )
        })?;
        used.push(ManifestMaterial { label, name: material.name.clone(), rgba, voxels });
    }
    if used.len() > target.max_materials() as usize {
        let names: Vec<_> = used.iter().map(|m| m.name.as_str()).collect();
        return Err(SliceError::unsupported(
            "materials",
            format!(
                "{} are in use ({}) and {:?} takes {}; prepare with fewer",
                used.len(),
                names.join(", "),
                target.name(),
                target.max_materials()
            ),
        ));
    }
    let padding_layers = target.min_layers().saturating_sub(grid.size()[2]);
    Ok(Manifest {
        format: FORMAT.into(),
        format_version: FORMAT_VERSION,
        generator: settings.generator.clone(),
        target: target.name().into(),
        pitch_mm: have,
        dpi: target.dpi(),
        origin_mm: frame.origin_mm(),
        size: grid.size(),
        layers: grid.size()[2] + padding_layers,
        padding_layers,
        files: FILE_PATTERN.into(),
        row_order: target.row_order(),
        orientation: manifest::orientation(target.row_order()),
        background: target.background(),
        materials: used,
        seed: settings.seed,
        settings: settings.settings.clone(),
    })
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
/// many materials; [`SliceError::Exists`] as [`StagedDir`]; [`SliceError::Io`];
/// [`SliceError::Cancelled`]. Nothing is left behind and an existing output is untouched then.
pub fn export(
    grid: &LabelGrid,
    materials: &MaterialTable,
    target: &PrintTarget,
    settings: &ExportSettings,
    dir: &Path,
    control: &Control,
) -> Result<Manifest, SliceError> {
    let staged = StagedDir::begin(dir, settings.force)?;
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
    fs::create_dir_all(&slices).map_err(SliceError::io("create", &slices))?;
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
            format.write(labels, &manifest::slice_path(dir, z))?;
            control.advance(&done, 1, u64::from(manifest.layers));
            Ok::<(), SliceError>(())
        },
    )?;
    manifest.save(dir)?;
    Ok(manifest)
}
