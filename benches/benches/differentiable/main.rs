//! The heuristic against differentiable rendering (Rittig et al. 2021, section 5.4, with Nimier-David et al. 2020): in a
//! setting like the paper's, and in the full one.
//!
//! `cargo bench -p pellucid-benches --bench differentiable`: small, in minutes; `-- --full` for
//! `docs/results/differentiable`. A study that was cut off goes on where it was.

mod models;
mod pictures;
mod report;
mod runs;
mod scene;
mod verdict;

use clap::Parser;
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::{Record, ResumableSettings, Study};
use scene::Scene;

/// The heuristic against differentiable rendering
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    settings: ResumableSettings,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    let full = args.settings.study.full;
    let kept = args.settings.kept("differentiable", env!("CARGO_TARGET_TMPDIR"))?;
    let scene = Scene::new(full)?;
    let mut record = Record::now("differentiable", rayon::current_num_threads());
    record.add("slab", scene.describe());
    record.add("models", "the defaults of the library; surface-first with the paper's 24 iterations");
    let study = Study::new("differentiable", env!("CARGO_TARGET_TMPDIR"), &args.settings.study, record)?;
    let runs = runs::all(&scene, &kept)?;
    let model_runs = models::all(full, &kept)?;
    let control = Control::none();
    pictures::slabs(study.folder(), &scene, &runs, &control)?;
    pictures::models(study.folder(), &model_runs, &control)?;
    report::plots(study.folder(), &runs, &model_runs)?;
    study.write(
        "The heuristic against differentiable rendering",
        &report::markdown(&scene, &runs, &model_runs),
        &report::points(&runs, &model_runs),
        &report::by_iteration(&runs),
    )?;
    Ok(())
}
