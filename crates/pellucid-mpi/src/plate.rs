//! `pellucid-mpi prepare`: one model by all processes, or a plate of models dealt out as jobs.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use pellucid::Workspace;
use pellucid::core::team::Alone;
use pellucid::core::{FileError, Team};
use pellucid_cli::{Failure, PrepareArgs, prepare_in};

/// Arguments of `pellucid-mpi prepare`: those of `pellucid prepare`, and further models.
#[derive(clap::Args)]
#[group(skip)]
pub struct Args {
    #[command(flatten)]
    one: PrepareArgs,
    /// Further models: each is then a job of one process, and goes to a folder of its name in --out
    #[arg(value_name = "MODELS")]
    more: Vec<PathBuf>,
}

/// Runs the command; `tell` gets a line for every model that was not prepared, at once.
pub fn run(args: &Args, team: &Arc<dyn Team>, tell: fn(&str)) -> Result<(), Failure> {
    if args.more.is_empty() {
        return prepare_in(&args.one, team);
    }
    let jobs = jobs(args)?;
    let out = args.one.out();
    std::fs::create_dir_all(out).map_err(FileError::at("create", out))?;
    let alone: Arc<dyn Team> = Arc::new(Alone);
    let mut failed = 0;
    for job in jobs.iter().skip(team.rank()).step_by(team.size()) {
        if let Err(failure) = one(job, &alone) {
            let (Failure::Cancelled(text) | Failure::Error(text)) = failure;
            tell(&format!("error: {}: {text}", job.model().display()));
            failed += 1;
        }
    }
    // The other jobs of the plate are done whatever became of one.
    let mut all = [failed];
    team.sum(&mut all);
    match all {
        [0] => Ok(()),
        [failed] => Err(Failure::message(format!("{failed} of {} models were not prepared", jobs.len()))),
    }
}

/// A job of the plate, unless an earlier run did it.
fn one(job: &PrepareArgs, alone: &Arc<dyn Team>) -> Result<(), Failure> {
    let done = job.out().exists() && !Workspace::folder_of(job.out()).exists();
    if job.resume() && done { Ok(()) } else { prepare_in(job, alone) }
}

/// A job for each model.
fn jobs(args: &Args) -> Result<Vec<PrepareArgs>, Failure> {
    let models = std::iter::once(args.one.model()).chain(args.more.iter().map(PathBuf::as_path));
    let mut names = HashSet::new();
    models
        .map(|model: &Path| {
            let name = model.file_stem().unwrap_or_default();
            if name.is_empty() || !names.insert(name) {
                let text = format!("{}: another model of the plate has the same name", model.display());
                return Err(Failure::message(text));
            }
            Ok(args.one.with_model(model.to_owned(), args.one.out().join(name)))
        })
        .collect()
}
