//! The few figures of a report that a user looks for first.

use std::fmt::Write;
use std::path::Path;

use pellucid::Report;

/// Lines for standard output.
pub fn of(report: &Report, out: &Path) -> String {
    let mut text = String::new();
    let [x, y, z] = report.extent_mm;
    let (before, after) = (&report.evaluation.unrefined, &report.evaluation.refined);
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{x:.1} x {y:.1} x {z:.1} mm, {} layers, {} surface voxels",
        report.layers, report.surface_voxels
    );
    let _ = writeln!(
        text,
        "colour error (mean dE2000 to the printable target): {:.2} unrefined, {:.2} refined ({:.0} % less)",
        before.voxel.mean,
        after.voxel.mean,
        100.0 * report.evaluation.reduction()
    );
    let _ = writeln!(
        text,
        "as seen from 300 mm (smoothed over 0.1 mm): {:.2} unrefined, {:.2} refined; sharpness {:.2}, {:.2}",
        before.at_0_1_mm.mean, after.at_0_1_mm.mean, before.sharpness, after.sharpness
    );
    let _ = writeln!(
        text,
        "refined: median {:.2}, 95 % below {:.2}; {:.0} % of the surface has a colour out of the printer's reach",
        after.voxel.median,
        after.voxel.p95,
        100.0 * report.refinement.out_of_gamut
    );
    let _ = writeln!(text, "wrote {}", out.display());
    text
}
