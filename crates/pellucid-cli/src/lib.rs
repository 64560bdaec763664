//! The commands of `pellucid`, for programs that run them elsewhere: over the members of a team, as `pellucid-mpi` does.
//!
//! This is the inside of a program: it writes to the terminal. Tools that want the work without the words call the crate
//! `pellucid`.
#![forbid(unsafe_code)]

mod arguments;
mod calibrate;
mod coupon;
mod dataset;
mod failure;
mod prepare;
mod preview;
mod progress;
mod proof;
mod subject;
mod summary;
mod terminal;
mod train;
mod validate;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Parser, Subcommand};

pub use dataset::{GenerateArgs, generate_in};
pub use failure::Failure;
pub use prepare::{Args as PrepareArgs, run_in as prepare_in};
pub use terminal::quiet;
pub use train::{Args as TrainArgs, run_in as train_in};

/// Set by Ctrl-C, termination or a hung-up terminal; long work looks at it and ends cleanly.
static CANCEL: AtomicBool = AtomicBool::new(false);

/// Prepares full-colour 3D prints whose colours survive the resin's translucency.
#[derive(Parser)]
#[command(name = "pellucid", version, about)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Turn a textured model into printable slices, a soft proof and an error report
    Prepare(Box<prepare::Args>),
    /// Show within seconds what a model would look like without refinement, and what will not print well
    Preview(Box<preview::Args>),
    /// Show what slices will look like when they are printed, whatever made them
    Proof(Box<proof::Args>),
    /// Write the slices of a small test print that shows whether a printer mirrors
    Coupon(coupon::Args),
    /// Make a chart of a printer's materials, or materials from its measurements
    #[command(subcommand)]
    Calibrate(calibrate::Command),
    /// Train the appearance network
    Train(train::Args),
    /// Make, describe, verify or judge by files of labelled points
    #[command(subcommand)]
    Dataset(dataset::Command),
    /// Compare the path tracer with a file of reference radiances
    Validate(validate::Args),
}

/// The program `pellucid`.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    // Without a handler Ctrl-C still ends the process; only the tidying up is lost.
    if let Err(error) = ctrlc::set_handler(|| {
        if CANCEL.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    }) {
        terminal::note(format!("warning: Ctrl-C will not tidy up: {error}"));
    }
    let result = match cli.command {
        Command::Prepare(args) => prepare::run(&args, &CANCEL),
        Command::Preview(args) => preview::run(&args, &CANCEL),
        Command::Proof(args) => proof::run(&args, &CANCEL),
        Command::Coupon(args) => coupon::run(&args, &CANCEL),
        Command::Calibrate(command) => calibrate::run(&command, &CANCEL),
        Command::Train(args) => train::run(&args, &CANCEL),
        Command::Dataset(command) => dataset::run(&command, &CANCEL),
        Command::Validate(args) => validate::run(&args, &CANCEL),
    };
    result.map_or_else(|failure| failure.tell(), |()| ExitCode::SUCCESS)
}
