//! `pellucid calibrate`: a chart of a printer's materials, and materials from its measurements.

mod chart;
mod fit;

use std::sync::atomic::AtomicBool;

use crate::Failure;

/// The two halves of a calibration.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Write a chart to print: slices, a map of its patches, and a table to fill with their colours
    Chart(chart::Args),
    /// Find materials from a filled table; `prepare --materials` takes them
    Fit(fit::Args),
}

/// Runs the command.
pub fn run(command: &Command, cancel: &AtomicBool) -> Result<(), Failure> {
    match command {
        Command::Chart(args) => chart::run(args, cancel),
        Command::Fit(args) => fit::run(args, cancel),
    }
}
