//! The `pellucid` command.
#![forbid(unsafe_code)]

mod dataset;
mod prepare;
mod progress;
mod train;
mod validate;

use std::error::Error;
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
}

/// How a command ended early.
enum Failure {
    /// Ctrl-C; nothing was written.
    Cancelled,
    /// Ctrl-C; what is left to go on from.
    Stopped(&'static str),
    /// Everything else; its causes are told too.
    Error(Box<dyn Error + Send + Sync>),
}

impl From<pellucid::PrintError> for Failure {
    fn from(error: pellucid::PrintError) -> Self {
        if error.is_cancelled() { Failure::Cancelled } else { Failure::Error(error.into()) }
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
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure::Cancelled) => {
            eprintln!("cancelled; nothing was written");
            ExitCode::from(130)
        }
        Err(Failure::Stopped(left)) => {
            eprintln!("cancelled; {left}");
            ExitCode::from(130)
        }
        Err(Failure::Error(error)) => {
            eprintln!("error: {}", pellucid_core::chain(error.as_ref()));
            ExitCode::FAILURE
        }
    }
}
