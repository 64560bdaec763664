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
        before.voxel.printable.mean,
        after.voxel.printable.mean,
        100.0 * report.evaluation.reduction()
    );
    let sharp = |slope: Option<f64>| slope.map_or("none".to_owned(), |s| format!("{s:.2}"));
    let _ = writeln!(
        text,
        "as seen from 300 mm (over 0.1 mm): {:.2} unrefined, {:.2} refined; sharpness {} and {}",
        before.at_0_1_mm.printable.mean,
        after.at_0_1_mm.printable.mean,
        sharp(before.sharpness.slope),
        sharp(after.sharpness.slope)
    );
    let _ = writeln!(
        text,
        "refined: median {:.2}, 95 % below {:.2}; {:.0} % of the surface has a colour out of the printer's reach",
        after.voxel.printable.median,
        after.voxel.printable.p95,
        100.0 * report.refinement.out_of_gamut
    );
    let shares = &after.shares;
    let [gamut, thin, rest] =
        [shares.out_of_gamut, shares.too_thin, shares.cross_talk].map(|share| 100.0 * share);
    let _ = writeln!(
        text,
        "left to the texture (over 0.1 mm): {:.2}, {gamut:.0} % out of gamut, {thin:.0} % too thin, {rest:.0} % cross-talk",
        after.at_0_1_mm.raw.mean
    );
    for light in &report.lights {
        let _ = writeln!(
            text,
            "under {}: {:.2} unrefined, {:.2} refined; from its look under {}: {:.2} and {:.2}",
            light.illuminant.name(),
            light.error[0].mean,
            light.error[1].mean,
            report.record.settings.illuminant.name(),
            light.inconstancy[0].mean,
            light.inconstancy[1].mean
        );
    }
    if let Some(choice) = &report.choice {
        let _ = writeln!(text, "predictor: {}, since {}", choice.chosen.name(), choice.reason);
    }
    if let Some(clear) = &report.clear {
        let _ =
            writeln!(text, "clear resin: {} voxels, {:.1} % of the print", clear.voxels, 100.0 * clear.share);
    }
    if let Some(texture) = &report.texture {
        let [width, height] = texture.size;
        let map = if texture.own_uv_map { "its own UV map" } else { "a new UV map" };
        let _ = writeln!(
            text,
            "texture of {width} x {height} on {map}; predicted gain over the texture as it was: {:.0} % (over 0.1 mm)",
            100.0 * texture.gain
        );
    }
    let _ = writeln!(text, "wrote {}", out.display());
    text
}
