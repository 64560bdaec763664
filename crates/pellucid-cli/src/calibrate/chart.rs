//! `pellucid calibrate chart`.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::calibration::{CHART_FILE, Chart, ChartSettings, MAP_FILE, write_chart};
use pellucid::core::Control;
use pellucid::slice::{Container, ExportSettings};

use crate::{Failure, arguments, terminal};

/// Arguments of `pellucid calibrate chart`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder to create: slices, manifest.json, chart.csv and chart.svg
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Printer: j750, j750-high-quality-vivid and so on, or the file of a profile
    #[arg(long, value_name = "NAME|FILE", default_value = "j750")]
    printer: String,
    /// What the slices are written as: png (a folder of them), gcvf, nrrd or npy
    #[arg(long, value_name = "FORMAT", value_parser = arguments::format, default_value = "png")]
    format: Container,
    /// Inks, by the names of the printer's palette; fewer for printers that take fewer materials at once
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "cyan,magenta,yellow")]
    inks: Vec<String>,
    /// The white that inks are measured over
    #[arg(long, value_name = "NAME", default_value = "white")]
    white: String,
    /// The black that inks are measured over
    #[arg(long, value_name = "NAME", default_value = "black")]
    black: String,
    /// Replace an output folder of an earlier run
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let printer = arguments::printer(&args.printer)?;
    let settings = ChartSettings {
        white: args.white.clone(),
        black: args.black.clone(),
        inks: args.inks.iter().map(|name| name.trim().to_owned()).collect(),
        ..ChartSettings::default()
    };
    let chart = Chart::new(&printer, &settings)?;
    let export = ExportSettings {
        force: args.force,
        format: args.format,
        generator: concat!("pellucid ", env!("CARGO_PKG_VERSION")).into(),
        ..ExportSettings::default()
    };
    let control = Control::none().with_cancel(cancel);
    write_chart(&chart, &printer, &export, &args.out, &control)?;
    terminal::print(&format!(
        "print it lying flat, measure each patch in its middle ({MAP_FILE} shows where), fill {CHART_FILE} in, and give \
         that to `pellucid calibrate fit`\nwrote {}\n",
        args.out.display()
    ))?;
    Ok(())
}
