//! The `pellucid-mpi` command: `mpirun -n N pellucid-mpi prepare MODEL --out DIR`.
#![forbid(unsafe_code)]

mod plate;

use std::io::Write;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use clap::{Parser, Subcommand};
use mpi::Threading;
use pellucid::core::Team;
use pellucid_cli::{Failure, GenerateArgs, TrainArgs};
use pellucid_mpi::{World, process_time};

/// How long the others wait for the first to say what is wrong, which as a rule is the same everywhere.
const COURTESY: Duration = Duration::from_secs(2);

/// Runs commands of `pellucid` on many machines: started by `mpirun`, on files that all machines see.
#[derive(Parser)]
#[command(name = "pellucid-mpi", version, about)]
struct Cli {
    /// Let every process say what its messages took
    #[arg(long, global = true)]
    traffic: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Turn a textured model into printable slices, sharing out the predictions; or several models, dealing out the jobs
    Prepare(Box<plate::Args>),
    /// Label the points of a recipe's splits, dealing out the volumes; a stopped run goes on where it was
    Dataset(GenerateArgs),
    /// Train the appearance network, each process on its part of every batch
    Train(Box<TrainArgs>),
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    let Some((universe, _)) = mpi::initialize_with_threading(Threading::Funneled) else {
        tell("error: MPI cannot be started");
        return ExitCode::FAILURE;
    };
    let world = Arc::new(World::of(&universe));
    let team: Arc<dyn Team> = world.clone();
    if team.rank() != 0 {
        pellucid_cli::quiet();
    }
    let result = match cli.command {
        Command::Prepare(args) => plate::run(&args, &team, tell),
        Command::Dataset(args) => pellucid_cli::generate_in(&args, &*team),
        Command::Train(args) => pellucid_cli::train_in(&args, &team),
    };
    let Err(failure) = result else {
        if cli.traffic {
            tell_traffic(&world);
        }
        return ExitCode::SUCCESS;
    };
    if team.rank() != 0 {
        std::thread::sleep(COURTESY);
    }
    let (text, status) = match failure {
        Failure::Cancelled(rest) => (format!("cancelled; {rest}"), 130),
        Failure::Error(text) => (text, 1),
    };
    tell(&format!("error: rank {}: {text}", team.rank()));
    world.abort(status)
}

/// A line for the traffic's reader, `benches/mpi_scaling.sh`.
fn tell_traffic(world: &World) {
    let traffic = world.traffic();
    let work = process_time().map_or(f64::NAN, |all| all.saturating_sub(traffic.processor).as_secs_f64());
    tell(&format!(
        "traffic: rank {} of {}: {} meetings, {} bytes, {:.3} s in them; {work:.3} s of processor time besides",
        world.rank(),
        world.size(),
        traffic.meetings,
        traffic.bytes,
        traffic.wall.as_secs_f64()
    ));
}

/// A line on standard error, if anybody listens.
fn tell(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}
