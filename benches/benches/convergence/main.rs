//! What refinement reaches, and in what time: strategies on the project's models, judged with paths of the judge's own.
//!
//! `cargo bench -p pellucid-benches --bench convergence`: two models, small, in minutes; `-- --full` for all eight at
//! 200,000 to 500,000 surface voxels, and more that are named. Runs that are done are kept and not repeated; one that was cut off
//! goes on.

mod objects;
mod report;

use std::path::{Path, PathBuf};

use clap::Parser;
use objects::Subject;
use pellucid::{Monitor, PrintJob, PrintSettings, Report, StrategyKind, Workspace};
use pellucid_benches::study::{Record, Study, StudySettings};
use pellucid_core::files;

type Error = Box<dyn std::error::Error + Send + Sync>;

/// What refinement reaches, and in what time
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Further models with their heights in mm
    #[arg(long, value_name = "FILE=MM")]
    also: Vec<String>,
    /// Surface voxels that models are scaled to: 250,000 in the full study, 25,000 in the small one
    #[arg(long, value_name = "N")]
    surface_voxels: Option<u32>,
    /// Only objects whose name holds one of these
    #[arg(long, value_name = "TEXT", value_delimiter = ',')]
    only: Vec<String>,
    /// Folder that keeps what was done, prints and proofs among it; in the build folder without it
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
}

/// Strategies in the order of the tables.
const STRATEGIES: [StrategyKind; 2] = [StrategyKind::SurfaceFirst, StrategyKind::Descent];

/// A refined object.
pub struct Run {
    /// Its name.
    pub object: String,
    /// How it was refined.
    pub strategy: StrategyKind,
    /// What came of it.
    pub report: Report,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    let mut record = Record::now("convergence", rayon::current_num_threads());
    record.add("settings", "the defaults of the library");
    let study = Study::new("convergence", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let usual = if args.study.full { objects::WANTED } else { objects::WANTED_SMALL };
    let wanted = args.surface_voxels.map_or(usual, f64::from);
    let state = args.state.clone().unwrap_or_else(|| {
        Path::new(env!("CARGO_TARGET_TMPDIR")).join(if args.study.full {
            "convergence-full"
        } else {
            "convergence-small"
        })
    });
    std::fs::create_dir_all(&state)?;
    let mut runs = Vec::new();
    for subject in objects::all(args.study.full, wanted, &args.also)? {
        if !args.only.is_empty() && !args.only.iter().any(|text| subject.name.contains(text)) {
            continue;
        }
        for strategy in STRATEGIES {
            runs.push(refined(&subject, strategy, &state)?);
            println!("{}", report::line(&runs[runs.len() - 1]));
        }
    }
    study.write(
        "What refinement reaches, and in what time",
        &report::markdown(&runs),
        &report::table(&runs),
        &report::plot(&runs),
    )?;
    Ok(())
}

/// Refines an object, or reads what an earlier run left.
fn refined(subject: &Subject, strategy: StrategyKind, state: &Path) -> Result<Run, Error> {
    let out = state.join(format!("{}-{}", subject.key(), strategy.name()));
    let kept = out.join("report.json");
    let report = if kept.exists() {
        serde_json::from_str(&files::read_text_bounded(&kept, 64 << 20)?)?
    } else {
        let (model, scale) = subject.sized()?;
        let job = PrintJob::new(PrintSettings { scale, strategy, ..PrintSettings::default() })?;
        let workspace = Workspace::resume(&out);
        // One for all stages: it keeps their times.
        let monitor = Monitor::silent();
        let prepared = job.prepare(&model, &workspace, &monitor)?;
        let report = prepared.write(&out, false, &monitor)?;
        workspace.finish()?;
        report
    };
    Ok(Run { object: subject.name.clone(), strategy, report })
}
