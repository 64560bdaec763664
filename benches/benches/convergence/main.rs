//! What refinement reaches, and in what time: strategies and predictors on the project's models, judged with paths of the
//! judge's own (Rittig et al. 2021, Figures 8, 14 and 15, Table 1).
//!
//! `cargo bench -p pellucid-benches --bench convergence`: a model, small, in minutes; `-- --full` for all eight at
//! 200,000 to 500,000 surface voxels, and more that are named. Runs that are done are kept and not repeated.

mod objects;
mod pictures;
mod report;
mod runs;
mod watched;
mod ways;

use std::path::PathBuf;

use clap::Parser;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::{Record, ResumableSettings, Study};
use runs::Run;
use ways::WAYS;

/// What refinement reaches, and in what time
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    settings: ResumableSettings,
    /// Further models with their heights in mm
    #[arg(long, value_name = "FILE=MM")]
    also: Vec<String>,
    /// Surface voxels that models are scaled to: 250,000 in the full study, 25,000 in the small one
    #[arg(long, value_name = "N")]
    surface_voxels: Option<u32>,
    /// Only objects whose name holds one of these
    #[arg(long, value_name = "TEXT", value_delimiter = ',')]
    only: Vec<String>,
    /// Only ways to refine whose name holds one of these, as "descent" or "512 paths"
    #[arg(long, value_name = "TEXT", value_delimiter = ',')]
    ways: Vec<String>,
    /// Only report what earlier runs did
    #[arg(long)]
    done: bool,
    /// Folder for the prints; in the build folder without it
    #[arg(long, value_name = "DIR")]
    prints: Option<PathBuf>,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    let full = args.settings.study.full;
    let kept = args.settings.kept("convergence", env!("CARGO_TARGET_TMPDIR"))?;
    let prints = args
        .prints
        .clone()
        .unwrap_or_else(|| PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("convergence-prints"));
    std::fs::create_dir_all(&prints)?;
    let usual = if full { objects::WANTED } else { objects::WANTED_SMALL };
    let wanted = args.surface_voxels.map_or(usual, f64::from);
    let named = |name: &str, texts: &[String]| texts.is_empty() || texts.iter().any(|t| name.contains(t));
    let mut runs = Vec::new();
    for subject in objects::all(full, wanted, &args.also)?.iter().filter(|s| named(&s.name, &args.only)) {
        for way in WAYS.iter().filter(|w| named(w.name, &args.ways)) {
            if args.done {
                runs.extend(runs::done(subject, way, &kept)?);
            } else {
                runs.push(runs::refined(subject, way, &kept, &prints)?);
                println!("{}", runs[runs.len() - 1].line());
            }
        }
    }
    write(&args, &runs)
}

fn write(args: &Args, runs: &[Run]) -> Result<(), Error> {
    let mut record = Record::now("convergence", rayon::current_num_threads());
    record.add("settings", "the defaults of the library");
    let mut machines: Vec<&str> = runs.iter().map(|run| run.machine.as_str()).collect();
    machines.sort_unstable();
    machines.dedup();
    record.add("runs on", machines.join("; "));
    let study = Study::new("convergence", env!("CARGO_TARGET_TMPDIR"), &args.settings.study, record)?;
    for of_object in runs.chunk_by(|a, b| a.object == b.object) {
        pictures::sheet(study.folder(), of_object)?;
    }
    report::write_iterates(study.folder(), runs)?;
    study.write(
        "What refinement reaches, and in what time",
        &report::markdown(runs),
        &report::table(runs),
        &report::plot(runs),
    )?;
    Ok(())
}
