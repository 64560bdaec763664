//! A print farm's queue: models one after the other, each with a limit of time, and one that fails stops nobody. What a
//! job did until its limit is kept, and the next run of the queue goes on there.
//!
//! `cargo run --release -p pellucid --example queue -- 600 prints a.glb b.glb`

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use pellucid::mesh::{ImportLimits, import_path};
use pellucid::stage::Silent;
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, Workspace};

/// How a job of the queue ended.
#[derive(Debug)]
pub enum Outcome {
    /// The print lies there.
    Printed(PathBuf),
    /// Its time was up; the next run goes on with it.
    Interrupted,
    /// What a person has to look at.
    Failed(PrintError),
}

/// Runs the jobs of a queue.
pub fn run(models: &[PathBuf], settings: &PrintSettings, limit: Duration, out: &Path) -> Vec<Outcome> {
    models.iter().map(|model| one(model, settings, limit, out)).collect()
}

fn one(model: &Path, settings: &PrintSettings, limit: Duration, out: &Path) -> Outcome {
    let folder = out.join(model.file_stem().unwrap_or_default());
    let stop = AtomicBool::new(false);
    let (done, wait) = mpsc::channel::<()>();
    let result = std::thread::scope(|scope| {
        let stop = &stop;
        scope.spawn(move || {
            if wait.recv_timeout(limit) == Err(mpsc::RecvTimeoutError::Timeout) {
                stop.store(true, Ordering::Relaxed);
            }
        });
        let result = prepare(model, settings, &folder, stop);
        drop(done);
        result
    });
    match result {
        Ok(()) => Outcome::Printed(folder),
        Err(PrintError::Cancelled) => Outcome::Interrupted,
        Err(error) => Outcome::Failed(error),
    }
}

fn prepare(model: &Path, settings: &PrintSettings, out: &Path, stop: &AtomicBool) -> Result<(), PrintError> {
    let job = PrintJob::new(settings.clone())?;
    job.check_output(out, true)?;
    let monitor = Monitor::new(&Silent, stop);
    let model = import_path(model, &ImportLimits::default())?;
    let workspace = Workspace::resume(out);
    job.prepare(&model, &workspace, &monitor)?.write(out, true, &monitor)?;
    workspace.finish()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seconds, out, models @ ..] = &arguments[..] else {
        return Err("queue SECONDS OUT MODEL...".into());
    };
    std::fs::create_dir_all(out)?;
    let models: Vec<PathBuf> = models.iter().map(PathBuf::from).collect();
    let limit = Duration::from_secs(seconds.parse()?);
    for (model, outcome) in models.iter().zip(run(&models, &PrintSettings::default(), limit, out.as_ref())) {
        println!("{}: {outcome:?}", model.display());
    }
    Ok(())
}
