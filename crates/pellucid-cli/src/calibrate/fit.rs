//! `pellucid calibrate fit`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::calibration::{MATERIALS_FILE, write_fit};
use pellucid::color::calibration::{
    Calibration, Coefficient, FitOptions, Geometry, Measurements, Patch, ReadOptions, fit,
};
use pellucid::color::spectrum::Illuminant;
use pellucid::core::Control;
use pellucid::core::files::read_text_bounded;

use crate::{Failure, arguments, terminal};

/// Arguments of `pellucid calibrate fit`.
#[derive(clap::Args)]
pub struct Args {
    /// A filled chart.csv, or a CSV or CGATS file with spectra, XYZ, L*a*b* or sRGB codes of the chart's patches
    measurements: PathBuf,
    /// Folder to create: materials.json and calibration.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The chart's own chart.csv, where the measurements only name the patches
    #[arg(long, value_name = "FILE")]
    chart: Option<PathBuf>,
    /// How patches were lit and seen: 45/0, d/8-excluded, d/8-included, or radiance for the program's own predictions
    #[arg(long, value_name = "GEOMETRY", value_parser = geometry, default_value = "45/0")]
    geometry: Geometry,
    /// The light whose white L*a*b* and XYZ are relative to: d50, d65 or e
    #[arg(long, value_name = "LIGHT", value_parser = illuminant, default_value = "d50")]
    illuminant: Illuminant,
    /// Refractive index of the resins
    #[arg(long, value_name = "N", value_parser = arguments::refractive_index, default_value = "1.5")]
    refractive_index: f64,
    /// Mean cosine of scattering, of all materials or as NAME=G of one; may be given more than once
    #[arg(long, value_name = "G|NAME=G", value_parser = mean_cosine, allow_hyphen_values = true)]
    g: Vec<(String, f64)>,
    /// Random error of a reading, in per cent of it
    #[arg(long, value_name = "PERCENT", default_value = "1")]
    noise: f64,
    /// Difference between measured and fitted colours, as dE2000, from which on nothing is fitted
    #[arg(long, value_name = "DE", default_value = "5")]
    most_delta_e: f64,
    /// The white that inks were measured over
    #[arg(long, value_name = "NAME", default_value = "white")]
    white: String,
    /// The black that inks were measured over
    #[arg(long, value_name = "NAME", default_value = "black")]
    black: String,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

fn geometry(name: &str) -> Result<Geometry, String> {
    let known = Geometry::ALL.map(Geometry::name).join(", ");
    Geometry::ALL
        .into_iter()
        .find(|g| g.name() == name)
        .ok_or_else(|| format!("a geometry is one of {known}"))
}

fn illuminant(name: &str) -> Result<Illuminant, String> {
    let known = || Illuminant::ALL.map(Illuminant::name).join(", ");
    Illuminant::from_name(name).ok_or_else(|| format!("a light is one of {}", known()))
}

/// The name is empty for all materials.
fn mean_cosine(text: &str) -> Result<(String, f64), String> {
    let (name, g) = text.rsplit_once('=').unwrap_or(("", text));
    let allowed = "a mean cosine is -0.99 to 0.99";
    let value: f64 = g.trim().parse().map_err(|_| format!("not a number; {allowed}"))?;
    if (-0.99..=0.99).contains(&value) {
        Ok((name.trim().to_owned(), value))
    } else {
        Err(allowed.to_owned())
    }
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let chart = match &args.chart {
        None => Vec::new(),
        Some(path) => {
            let text = read_text_bounded(path, Measurements::MAX_FILE_BYTES)?;
            Patch::parse_chart(&text).map_err(|error| error.in_file(path))?
        }
    };
    let read = ReadOptions {
        geometry: args.geometry,
        refractive_index: args.refractive_index,
        illuminant: args.illuminant,
        chart,
    };
    let measurements = Measurements::load(&args.measurements, &read)?;
    let mut g_of: BTreeMap<String, f64> = args.g.iter().cloned().collect();
    let usual = FitOptions::default();
    let options = FitOptions {
        refractive_index: args.refractive_index,
        g: g_of.remove("").unwrap_or(usual.g),
        g_of,
        white: args.white.clone(),
        black: args.black.clone(),
        relative_error: args.noise / 100.0,
        most_delta_e: args.most_delta_e,
        ..usual
    };
    let control = Control::none().with_cancel(cancel);
    let calibration =
        fit(&measurements, &options, &control).map_err(|error| error.in_file(&args.measurements))?;
    write_fit(&calibration, &measurements, args.force, &args.out)?;
    warn(&measurements);
    terminal::print(&format!(
        "{}wrote {}; `pellucid prepare --materials {}` takes it\n",
        summary(&calibration),
        args.out.display(),
        args.out.join(MATERIALS_FILE).display()
    ))?;
    Ok(())
}

fn warn(measurements: &Measurements) {
    let note = |what: &str, patches: &[String]| {
        if !patches.is_empty() {
            terminal::note(format!("warning: {what}: {}", patches.join(", ")));
        }
    };
    note("patches without values are left out", measurements.unmeasured());
    note(
        "colours outside Rec.709, of which three channels hold the nearest (spectra would hold them)",
        measurements.clipped(),
    );
}

/// Coefficients with their errors, and how well patches are met.
fn summary(calibration: &Calibration) -> String {
    let mut text = String::from("material, 1/mm      by channel, with standard error\n");
    // Writing to a string cannot fail.
    for fit in &calibration.fits {
        for (what, values) in [("scattering", &fit.sigma_s), ("absorption", &fit.sigma_a)] {
            let _ =
                writeln!(text, "{:>8} {what}  {}", fit.name, values.iter().map(shown).collect::<String>());
        }
    }
    for (what, check) in [("fitted", false), ("checking", true)] {
        let patches = calibration.patches.iter().filter(|p| p.check == check);
        if let Some(worst) = patches.max_by(|a, b| a.delta_e.total_cmp(&b.delta_e)) {
            let (mean, most) = calibration.delta_e(check);
            let _ = writeln!(
                text,
                "patches {what}: dE2000 {mean:.2} on average, {most:.2} at most ({}, {})",
                worst.id, worst.stack
            );
        }
    }
    text
}

fn shown(coefficient: &Coefficient) -> String {
    let Coefficient { value, relative_error } = coefficient;
    if *relative_error >= 1.0 {
        return format!(" {value:9.4} (open)");
    }
    format!(" {value:9.4} ±{:2.0} %", 100.0 * relative_error)
}
