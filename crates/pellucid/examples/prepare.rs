//! The whole job, as a slicer would run it: a textured model in, a print's folder out. Stages and warnings are told, and
//! a run that was stopped goes on where it was.
//!
//! `cargo run --release -p pellucid --example prepare -- model.glb 12 print`

use std::path::Path;
use std::sync::atomic::AtomicBool;

use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::stage::{Observer, Stage};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, Report, Workspace};

/// Tells a person what happens.
struct Lines;

impl Observer for Lines {
    fn end(&self, stage: Stage) {
        println!("{} done", stage.name());
    }

    fn warn(&self, message: &str) {
        println!("note: {message}");
    }
}

/// Prepares a model so many mm high.
pub fn prepare(
    model: &Path,
    height_mm: f64,
    settings: PrintSettings,
    out: &Path,
) -> Result<Report, PrintError> {
    let job = PrintJob::new(PrintSettings { scale: Scale::HeightMm(height_mm), ..settings })?;
    // Asked before hours of work, not after.
    job.check_output(out, true)?;
    let model = import_path(model, &ImportLimits::default())?;
    // Setting this from another thread stops the job within 100 ms.
    let stop = AtomicBool::new(false);
    let monitor = Monitor::new(&Lines, &stop);
    let workspace = Workspace::resume(out);
    let prepared = job.prepare(&model, &workspace, &monitor)?;
    let report = prepared.write(out, true, &monitor)?;
    workspace.finish()?;
    Ok(report)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, height_mm, out] = &arguments[..] else {
        return Err("prepare MODEL HEIGHT_MM OUT".into());
    };
    let report = prepare(model.as_ref(), height_mm.parse()?, PrintSettings::default(), out.as_ref())?;
    let [before, after] =
        [&report.evaluation.unrefined, &report.evaluation.refined].map(|e| e.voxel.printable.mean);
    println!("mean dE2000 to what can be printed: {before:.1} unrefined, {after:.1} refined");
    Ok(())
}
