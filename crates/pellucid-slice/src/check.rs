//! Whether a print target can hold what is to be printed.

use pellucid_core::Fault;
use pellucid_voxel::{AIR, LabelGrid, MaterialTable};

use crate::manifest::{self, FORMAT, FORMAT_VERSION, Manifest, ManifestMaterial};
use crate::{ExportSettings, PrintTarget, SliceError};

/// Checks before any work whether a print that may use the materials `labels` of a table can be written for a target.
/// [`AIR`] and repeated labels are fine.
///
/// # Errors
/// [`SliceError::Invalid`] for a label past the table or a material of which the palette has no colour,
/// [`SliceError::Unsupported`] for more materials than the printer takes at once.
///
/// ```
/// use pellucid_slice::{PrintTarget, check_materials};
/// use pellucid_voxel::MaterialTable;
/// let (three, cmykw) = (PrintTarget::j750().with_max_materials(3)?, MaterialTable::cmykw());
/// assert!(check_materials(&three, &cmykw, 1..=5).is_err());
/// assert!(check_materials(&three, &cmykw, [4, 5]).is_ok());
/// # Ok::<(), pellucid_slice::SliceError>(())
/// ```
pub fn check_materials(
    target: &PrintTarget,
    materials: &MaterialTable,
    labels: impl IntoIterator<Item = u8>,
) -> Result<(), SliceError> {
    let mut voxels = [0; 256];
    labels.into_iter().for_each(|label| voxels[usize::from(label)] = 1);
    printable(target, materials, &voxels).map(drop)
}

/// Checks that `target` can print `grid`, without writing anything, and returns the manifest that
/// an export would write.
///
/// # Errors
/// As [`crate::export()`], but for the output folder and [`SliceError::Io`].
pub fn check(
    grid: &LabelGrid,
    materials: &MaterialTable,
    target: &PrintTarget,
    settings: &ExportSettings,
) -> Result<Manifest, SliceError> {
    let container = settings.format;
    container.check(target)?;
    check_pitch(grid, target)?;
    check_size(grid, target)?;
    let used = printable(target, materials, &grid.histogram())?;
    let least = if container.is_for_printers() { target.min_layers() } else { 0 };
    let padding_layers = least.saturating_sub(grid.size()[2]);
    let row_order = container.row_order(target);
    Ok(Manifest {
        format: FORMAT.into(),
        format_version: FORMAT_VERSION,
        generator: settings.generator.clone(),
        target: target.name().into(),
        pitch_mm: grid.frame().pitch().mm(),
        dpi: target.dpi(),
        origin_mm: grid.frame().origin_mm(),
        size: grid.size(),
        layers: grid.size()[2] + padding_layers,
        padding_layers,
        files: container.files().into(),
        row_order,
        orientation: manifest::orientation(container, row_order),
        background: container.background(target),
        materials: used,
        seed: settings.seed,
        settings: settings.settings.clone(),
    })
}

fn check_pitch(grid: &LabelGrid, target: &PrintTarget) -> Result<(), SliceError> {
    let (have, want) = (grid.frame().pitch().mm(), target.pitch().mm());
    if have.iter().zip(want).any(|(h, w)| (h / w - 1.0).abs() > 1e-6) {
        let reason = format!("{have:?} mm is not that of {:?}, {want:?} mm", target.name());
        let fault = Fault::new("grid pitch", reason).remedy("voxelise at the target's pitch");
        return Err(SliceError::Invalid(fault));
    }
    Ok(())
}

fn check_size(grid: &LabelGrid, target: &PrintTarget) -> Result<(), SliceError> {
    let mm = target.pitch().mm();
    check_extent(target, std::array::from_fn(|a| f64::from(grid.size()[a]) * mm[a]))
}

/// Tells whether an object of a size `[x, y, z]` in mm fits the target, before it is voxelised.
///
/// # Errors
/// [`SliceError::Unsupported`] naming both sizes.
pub fn check_extent(target: &PrintTarget, extent_mm: [f64; 3]) -> Result<(), SliceError> {
    let most = target.build_space_mm();
    if (0..3).all(|a| extent_mm[a] <= most[a] * (1.0 + 1e-9)) {
        return Ok(());
    }
    let text = |mm: [f64; 3]| mm.map(millimetres).join(" x ");
    let reason = format!("{} mm is more than the {} mm of {:?}", text(extent_mm), text(most), target.name());
    Err(SliceError::Unsupported(Fault::new("object size", reason).remedy("scale or turn the model")))
}

/// At most two decimals; sizes that nobody prints in powers of ten.
fn millimetres(mm: f64) -> String {
    if mm.abs() >= 1e7 { format!("{mm:.1e}") } else { format!("{}", (100.0 * mm).round() / 100.0) }
}

/// The materials of which there are voxels, with the colours that stand for them.
fn printable(
    target: &PrintTarget,
    materials: &MaterialTable,
    voxels: &[u64; 256],
) -> Result<Vec<ManifestMaterial>, SliceError> {
    let mut used = Vec::new();
    for (label, &voxels) in (0..=255u8).zip(voxels) {
        if label == AIR || voxels == 0 {
            continue;
        }
        let material = materials.get(label).ok_or_else(|| {
            let reason =
                format!("label {label} is in use, and the material table ends at {}", materials.len());
            SliceError::invalid("labels", reason)
        })?;
        let rgba = target.color_of(&material.name).ok_or_else(|| {
            let subject = format!("printer profile {:?}, palette", target.name());
            let reason = format!("has no colour for material {:?} (label {label})", material.name);
            SliceError::Invalid(Fault::new(subject, reason).remedy("add one"))
        })?;
        let resin = target.resins().get(&material.name).cloned();
        used.push(ManifestMaterial { label, name: material.name.clone(), resin, rgba, voxels });
    }
    if used.len() > target.max_materials() as usize {
        let names: Vec<_> = used.iter().map(|m| m.name.as_str()).collect();
        let reason = format!(
            "{} are needed ({}) and {:?} takes {}",
            used.len(),
            names.join(", "),
            target.name(),
            target.max_materials()
        );
        return Err(SliceError::Unsupported(Fault::new("materials", reason).remedy("prepare with fewer")));
    }
    Ok(used)
}
