//! How the four architectures generalise (Rittig et al. 2021, Table 2, Figures 11 and 12): trained with equal budgets,
//! judged on held-out volumes and on the paper's objects' counterparts.
//!
//! `cargo bench -p pellucid-benches --bench generalisation`: short runs and small sets, in a quarter of an hour;
//! `-- --full` for all of `docs/results/generalisation`, in hours. A study that was cut off goes on where it was.

mod finished;
mod held_out;
mod judging;
mod models;
mod object;
mod pictures;
mod plan;
mod report;
mod runs;
mod scores;
mod speed;
mod tables;
mod training;

use std::path::{Path, PathBuf};

use clap::{Parser, ValueEnum};
use judging::Judging;
use pellucid::core::files::write_whole_bytes;
use pellucid::dataset::Recipe;
use pellucid::voxel::Control;
use pellucid_benches::appearance::Error;
use pellucid_benches::study::stopwatch::on_one_thread;
use pellucid_benches::study::{Record, Study, StudySettings};
use pictures::Look;
use plan::Plan;
use report::Measured;
use runs::Runs;

/// Generalisation of the four architectures
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Folder for the states of the training runs and labelled sets, from which a study goes on when it was cut off; in
    /// the build folder without it. What finished runs came to is kept beside the report, in `runs.json`: a group whose
    /// state is gone need not be trained again
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Do only this part; the report is made of the runs that are finished
    #[arg(long, value_enum)]
    only: Option<Stage>,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Stage {
    Training,
    Report,
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let full = args.study.full;
    let plan = Plan::new(full);
    let recipe = concat!(env!("CARGO_MANIFEST_DIR"), "/../datasets/recipes/paper.json");
    let recipe = Recipe::read(Path::new(recipe))?;
    let scratch = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let folder = args.state.clone().unwrap_or_else(|| scratch.join("generalisation-state"));
    let folder = folder.join(if full { "full" } else { "small" });
    std::fs::create_dir_all(folder.join("sets"))?;
    let validation = held_out::labelled(&recipe, "validation", full, &folder.join("sets"), &control)?;
    let mut record = Record::now("generalisation", 1);
    record.add("matrix products", "factors rounded to bfloat16, sums in f32");
    record.add("budget", format!("{} steps of 256 samples for each network", plan.steps));
    let study = Study::new("generalisation", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let mut runs = Runs::read(study.folder())?;
    if args.only != Some(Stage::Report) {
        for &group in plan.groups.iter().filter(|&&group| !runs.has(group)) {
            training::train(&plan, group, &recipe, &validation, &folder, &control)?;
        }
    }
    if args.only == Some(Stage::Training) {
        return Ok(());
    }
    let networks = finished::finished(&plan, &folder, &runs)?;
    if networks.is_empty() {
        return Err("no training run is finished yet".into());
    }
    let look = if full { Look { edge: 180, spp: 512 } } else { Look { edge: 96, spp: 64 } };
    let out = study.folder();
    let judging =
        Judging { recipe: &recipe, networks: &networks, full, look, folder: &folder, out, control: &control };
    let (mut rows, mut pictures) = judging.sets(&mut runs)?;
    let (of_models, model_pictures) = judging.models(&mut runs)?;
    rows.extend(of_models);
    pictures.extend(model_pictures);
    let (speeds, stencil_us) = speed::measure(&plan, &validation, &control)?;
    let models: Vec<&str> = models::chosen(full).into_iter().map(|(name, _)| name).collect();
    let sets = held_out::SETS.iter().chain(&models);
    let not_judged = sets.flat_map(|set| runs.not_judged(set, &networks).map(move |n| format!("{n}: {set}")));
    let measured = Measured {
        plan: &plan,
        not_judged: &not_judged.collect::<Vec<_>>(),
        networks: &networks,
        rows: &rows,
        speeds: &speeds,
        stencil_us,
        models: &models,
        picture_spp: look.spp,
        pictures: &pictures,
    };
    write_whole_bytes(out.join("sizes.svg"), tables::sizes(&rows, &held_out::SETS).svg().as_bytes())?;
    study.write(
        "Generalisation of the four architectures",
        &report::markdown(&measured, report::findings(out).as_deref()),
        &tables::all(&rows),
        &tables::curves(&plan, &networks),
    )?;
    Ok(())
}
