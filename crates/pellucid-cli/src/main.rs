//! The `pellucid` command.
#![forbid(unsafe_code)]

mod dataset;
mod files;
mod prepare;
mod progress;
mod stopwatch;
mod study_rpnn;
mod study_tracer;
mod train;
mod validate;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Parser, Subcommand};

/// Set by Ctrl-C; long work looks at it and ends cleanly.
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
    /// Turn a textured glTF model into printable slices, a soft proof and an error report
    Prepare(prepare::Args),
    /// Train the appearance network
    Train(train::Args),
    /// Make, describe or verify files of labelled points
    #[command(subcommand)]
    Dataset(dataset::Command),
    /// Compare the path tracer with a file of reference radiances
    Validate(validate::Args),
    /// Measure, and write tables and plots
    #[command(subcommand)]
    Study(Study),
}

#[derive(Subcommand)]
enum Study {
    /// Errors and times of networks beside Monte Carlo on labelled sets
    Rpnn(study_rpnn::Args),
    /// Error against run time of every estimator of the path tracer
    Tracer(study_tracer::Args),
}

/// How a command ended early.
enum Failure {
    /// Ctrl-C.
    Cancelled,
    /// Everything else, as a message for the user.
    Error(String),
}

impl From<pellucid::PrintError> for Failure {
    fn from(error: pellucid::PrintError) -> Self {
        if error.is_cancelled() { Failure::Cancelled } else { Failure::Error(error.to_string()) }
    }
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    // Without a handler Ctrl-C still ends the process; only the tidying up is lost.
    if let Err(error) = ctrlc::set_handler(|| {
        if CANCEL.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    }) {
        eprintln!("warning: Ctrl-C will not tidy up: {error}");
    }
    let result = match cli.command {
        Command::Prepare(args) => prepare::run(&args, &CANCEL),
        Command::Train(args) => train::run(&args, &CANCEL),
        Command::Dataset(command) => dataset::run(&command, &CANCEL),
        Command::Validate(args) => validate::run(&args, &CANCEL),
        Command::Study(Study::Rpnn(args)) => study_rpnn::run(&args, &CANCEL),
        Command::Study(Study::Tracer(args)) => study_tracer::run(&args, &CANCEL),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Cancelled) => {
            eprintln!("cancelled; nothing was written");
            ExitCode::from(130)
        }
        Err(Failure::Error(message)) => {
            eprintln!("error: {message}");
            ExitCode::FAILURE
        }
    }
}
