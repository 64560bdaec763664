//! Folders of charts and of fits.

use std::path::Path;

use pellucid_color::calibration::{Calibration, Measurements};
use pellucid_core::Control;
use pellucid_core::files::write_whole_bytes;
use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_slice::{ExportSettings, PrintTarget};
use serde_json::{Value, json};

use super::{Chart, map};
use crate::PrintError;

/// The table to fill, in a chart's folder.
pub const CHART_FILE: &str = "chart.csv";
/// The drawing of where patches are, in a chart's folder.
pub const MAP_FILE: &str = "chart.svg";
/// The fitted table, in a fit's folder.
pub const MATERIALS_FILE: &str = "materials.json";
/// Uncertainties and every patch's error, in a fit's folder.
pub const CALIBRATION_FILE: &str = "calibration.json";

/// What [`CALIBRATION_FILE`] says it is.
const FORMAT: &str = "pellucid-calibration";

/// Writes a chart's slices with `manifest.json`, [`CHART_FILE`] and [`MAP_FILE`] into a folder that appears complete or
/// not at all. Progress counts layers.
///
/// # Errors
/// As [`pellucid_slice::export()`] and [`Chart::grid`].
pub fn write_chart(
    chart: &Chart,
    printer: &PrintTarget,
    export: &ExportSettings,
    folder: &Path,
    control: &Control<'_>,
) -> Result<(), PrintError> {
    let own = pellucid_slice::own_files().and([CHART_FILE, MAP_FILE]);
    let staged = StagedDir::begin(folder, export.force, &own)?;
    let grid = chart.grid(&control.silent())?;
    pellucid_slice::write_stack(&grid, chart.materials(), printer, export, staged.path(), control)?;
    write_whole_bytes(staged.path().join(CHART_FILE), chart.table().as_bytes())?;
    write_whole_bytes(staged.path().join(MAP_FILE), map::svg(chart, printer).as_bytes())?;
    staged.commit()?;
    Ok(())
}

/// Writes [`MATERIALS_FILE`] and [`CALIBRATION_FILE`] into a folder that appears complete or not at all.
///
/// # Errors
/// [`PrintError::Staging`] when something else is in the folder, or an earlier fit and `force` is not given;
/// [`PrintError::Io`].
pub fn write_fit(
    calibration: &Calibration,
    measurements: &Measurements,
    force: bool,
    folder: &Path,
) -> Result<(), PrintError> {
    let own = OwnFiles::new([MATERIALS_FILE, CALIBRATION_FILE]).marked_by(CALIBRATION_FILE, is_calibration);
    let staged = StagedDir::begin(folder, force, &own)?;
    let (fitted, checked) = (calibration.delta_e(false), calibration.delta_e(true));
    let report = json!({
        "format": FORMAT,
        "format_version": 1,
        "refractive_index": calibration.refractive_index,
        "quantity": measurements.quantity(),
        "unmeasured": measurements.unmeasured(),
        "clipped": measurements.clipped(),
        "delta_e": {
            "fitted": { "mean": fitted.0, "max": fitted.1 },
            "checked": { "mean": checked.0, "max": checked.1 },
        },
        "materials": calibration.fits,
        "patches": calibration.patches,
    });
    for (name, value) in [(MATERIALS_FILE, json!(calibration.materials)), (CALIBRATION_FILE, report)] {
        let mut text = format!("{value:#}");
        text.push('\n');
        write_whole_bytes(staged.path().join(name), text.as_bytes())?;
    }
    staged.commit()?;
    Ok(())
}

fn is_calibration(bytes: &[u8]) -> bool {
    serde_json::from_slice::<Value>(bytes).is_ok_and(|v| v.get("format").is_some_and(|f| f == FORMAT))
}
