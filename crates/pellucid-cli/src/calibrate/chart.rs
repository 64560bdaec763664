//! `pellucid calibrate chart`.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use pellucid::calibration::{CHART_FILE, Chart, ChartSettings, MAP_FILE, write_chart};
use pellucid::core::Control;

use crate::{Failure, arguments, terminal};

/// Arguments of `pellucid calibrate chart`.
#[derive(clap::Args)]
pub struct Args {
    /// Folder to create: slices, manifest.json, chart.csv and chart.svg
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    slices: arguments::Slices,
    /// Inks, by the names of the printer's palette; fewer for printers that take fewer materials at once
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "cyan,magenta,yellow")]
    inks: Vec<String>,
    /// The white that inks are measured over
    #[arg(long, value_name = "NAME", default_value = "white")]
    white: String,
    /// The black that inks are measured over
    #[arg(long, value_name = "NAME", default_value = "black")]
    black: String,
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let printer = args.slices.printer()?;
    let settings = ChartSettings {
        white: args.white.clone(),
        black: args.black.clone(),
        inks: args.inks.iter().map(|name| name.trim().to_owned()).collect(),
        ..ChartSettings::default()
    };
    let chart = Chart::new(&printer, &settings)?;
    let control = Control::none().with_cancel(cancel);
    write_chart(&chart, &printer, &args.slices.export(), &args.out, &control)?;
    terminal::print(&format!(
        "print it lying flat, measure each patch in its middle ({MAP_FILE} shows where), fill {CHART_FILE} in, and give \
         that to `pellucid calibrate fit`\nwrote {}\n",
        args.out.display()
    ))?;
    Ok(())
}
