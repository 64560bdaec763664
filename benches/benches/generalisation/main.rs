//! How the four architectures generalise (Rittig et al. 2021, Table 2, Figures 11 and 12): trained with equal budgets,
//! judged on held-out volumes and on the paper's objects' counterparts.
//!
//! `cargo bench -p pellucid-benches --bench generalisation`: short runs and small sets, in a quarter of an hour;
//! `-- --full` for all of `docs/results/generalisation`, in hours. A study that was cut off goes on where it was.

mod plan;
mod training;

use std::path::{Path, PathBuf};

use clap::{Parser, ValueEnum};
use pellucid::dataset::{LabelledSet, Recipe, SetHeader, Shard, generate};
use pellucid::voxel::{Control, MaterialTable};
use pellucid_benches::study::StudySettings;
use plan::Plan;

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Generalisation of the four architectures
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Folder for the states of the training runs and the labelled sets, from which the study goes on when it was cut
    /// off; in the build folder without it
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// Do only this part: the report is made of the runs that are finished
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
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let plan = Plan::new(args.study.full);
    let recipe = concat!(env!("CARGO_MANIFEST_DIR"), "/../datasets/recipes/paper.json");
    let recipe = Recipe::read(Path::new(recipe))?;
    let size = if args.study.full { "full" } else { "small" };
    let folder = args.state.clone().unwrap_or_else(|| Path::new(env!("CARGO_TARGET_TMPDIR")).join("generalisation-state"));
    let folder = folder.join(size);
    let sets = folder.join("sets");
    std::fs::create_dir_all(&sets)?;
    let mut held_out = recipe.clone();
    if !args.study.full {
        for split in &mut held_out.splits {
            (split.volumes, split.points, split.std_error) = (12, 24, Some(0.01));
        }
    }
    let header = SetHeader {
        recipe: held_out,
        split: "validation".into(),
        materials: MaterialTable::cmykw(),
        shard: Shard::WHOLE,
    };
    println!("labelling validation");
    let validation = LabelledSet::load(&[generate(&sets, &header, &control)?], &control)?;
    if args.only != Some(Stage::Report) {
        for &group in &plan.groups {
            training::train(&plan, group, &recipe, &validation, &folder, &control)?;
        }
    }
    Ok(())
}
