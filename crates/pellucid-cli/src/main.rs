//! The `pellucid` command.
#![forbid(unsafe_code)]

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
enum Command {}

/// How a command ended early.
enum Failure {
    /// Ctrl-C.
    Cancelled,
    /// Everything else, as a message for the user.
    Error(String),
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
    let result: Result<(), Failure> = match cli.command {};
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
