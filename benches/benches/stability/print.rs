//! Halftone and slices: shares at their ends, many materials, flat voxels.

use pellucid::halftone::{BlueNoiseMask, Thresholds};
use pellucid::slice::{ExportSettings, PrintTarget, export, read_stack};
use pellucid::voxel::{Control, Frame, LabelGrid, Material, MaterialTable, Pitch};

use super::Error;
use super::case::Case;

pub const PART: &str = "print";

fn case(name: &str, measured: &'static str, found: f64, bound: f64) -> Case {
    Case { part: PART, name: name.to_owned(), measured, found, bound: Some(bound) }
}

/// Shares that halftones give, and labels that come back from slices.
pub fn cases(control: &Control<'_>) -> Result<Vec<Case>, Error> {
    let mut found = Vec::new();
    for (name, pitch) in [("27 µm layers", Pitch::j750()), ("pitch 1 : 100", Pitch::new([1.0, 0.5, 0.01])?)]
    {
        let mask = BlueNoiseMask::new(pitch, 1, control)?;
        for (share, bound) in [(0.0, 0.0), (1.0, 0.0), (1e-3, 5e-4), (0.5, 5e-3), (0.999, 5e-4)] {
            let wrong = (shown(&mask, share) - f64::from(share)).abs();
            found.push(case(
                &format!("{name}, share {share}"),
                "error of the halftone's share",
                wrong,
                bound,
            ));
        }
    }
    found.push(round_trip(15, Pitch::new([0.5, 0.25, 0.005])?, control)?);
    found.push(round_trip(2, Pitch::j750(), control)?);
    Ok(found)
}

/// The share of voxels of a period that take the first of two materials.
fn shown(mask: &BlueNoiseMask, share: f32) -> f64 {
    let mut row = [0];
    Thresholds::write(&[share, 1.0 - share], &mut row);
    let [sx, sy, sz] = mask.size();
    let mut first = 0u64;
    for z in 0..sz {
        for y in 0..sy {
            first += mask.row(y, z).iter().filter(|&&t| Thresholds::choose(&row, t) == 0).count() as u64;
        }
    }
    first as f64 / (u64::from(sx) * u64::from(sy) * u64::from(sz)) as f64
}

/// Voxels that differ after a stack was written and read.
fn round_trip(materials: u8, pitch: Pitch, control: &Control<'_>) -> Result<Case, Error> {
    let name = |m: u8| format!("m{m}");
    let table = (1..=materials).map(|m| Material {
        name: name(m),
        sigma_s: vec![f32::from(m)],
        sigma_a: vec![0.1],
        g: 0.0.into(),
    });
    let table = MaterialTable::new(vec!["light".to_owned()], table.collect())?;
    let palette = (1..=materials).map(|m| (name(m), [10 * m, 255 - 10 * m, 7, 255]));
    let target = PrintTarget::new("study", pitch, [1000.0; 3], palette)?;
    let frame = Frame::new([0.0; 3], pitch, [33, 47, 70])?;
    let grid =
        LabelGrid::from_fn(frame, |[x, y, z]| ((x * 7 + y * 31 + z * z) % (u32::from(materials) + 1)) as u8);
    let folder = std::env::temp_dir().join(format!("pellucid-stability-{}-{materials}", std::process::id()));
    export(&grid, &table, &target, &ExportSettings::default(), &folder, control)?;
    let back = read_stack(&folder, control);
    std::fs::remove_dir_all(&folder)?;
    let (back, _) = back?;
    let differ = grid.solid_voxels().filter(|&(v, label)| back.get(v) != label).count() as u64
        + back.solid_count().abs_diff(grid.solid_count());
    let name = format!(
        "{materials} materials, voxels of {} mm",
        pitch.mm().map(|mm| format!("{mm:.3}")).join(" x ")
    );
    Ok(case(&name, "voxels that differ after writing and reading slices", differ as f64, 0.0))
}
