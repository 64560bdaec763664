//! Networks beside Monte Carlo on labelled sets: errors and times (Rittig et al. 2021, Table 2 and Figures 11 and 12).
//!
//! `cargo bench -p pellucid-benches --bench network_error`: the shipped network on small sets, labelled on the first run,
//! in some minutes; `-- --full --weights FILE… --sets DIR` for all of `docs/results/network_error`.

mod pictures;
mod report;
mod scores;
mod shared;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Parser, ValueEnum};
use pellucid::color::Viewing;
use pellucid::color::spectrum::Illuminant;
use pellucid::dataset::{LabelledSet, Recipe, SetHeader, Shard, generate};
use pellucid::rpnn::{Inference, Precision, TrainedNetwork};
use pellucid::voxel::{Control, MaterialTable};
use pellucid_benches::study::stopwatch::on_one_thread;
use pellucid_benches::study::{Record, Study, StudySettings};
use scores::Row;

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Splits of which a picture is drawn in full.
const DRAWN: [&str; 5] = ["test", "unseen-shape", "unseen-density-x4", "unseen-density-quarter", "loops"];
/// Splits of the small study, with fewer volumes and points and looser labels.
const SMALL: [&str; 2] = ["test", "loops"];
const SMALL_VOLUMES: u32 = 12;
const SMALL_POINTS: u32 = 24;
const SMALL_STD_ERROR: f32 = 0.01;

/// Errors and times of networks beside Monte Carlo
#[derive(Parser)]
struct Args {
    #[command(flatten)]
    study: StudySettings,
    /// Weights to compare, made by `pellucid train`; the first is the one compared with Monte Carlo at equal time. Those
    /// that the library carries without it
    #[arg(long, value_name = "FILE", num_args = 1..)]
    weights: Vec<PathBuf>,
    /// Folder with labelled sets, made by `pellucid dataset generate`; without it they are made from the default recipe
    #[arg(long, value_name = "DIR")]
    sets: Option<PathBuf>,
    /// Number format of the networks' matrix products
    #[arg(long, value_enum, default_value_t = Format::F32)]
    precision: Format,
    /// Longer edge of a picture in pixels
    #[arg(long, default_value_t = 200)]
    edge: u32,
}

#[derive(Clone, Copy, ValueEnum)]
enum Format {
    F32,
    Bf16,
}

/// A network under study.
struct Candidate {
    name: String,
    trained: Arc<TrainedNetwork>,
    precision: Precision,
}

impl Candidate {
    fn read(path: &Path, precision: Precision) -> Result<Self, Error> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        Ok(Self::new(pellucid::rpnn::file::load(path)?, &stem, precision))
    }

    fn shipped(precision: Precision) -> Result<Self, Error> {
        Ok(Self::new(pellucid::rpnn::shipped()?, "shipped", precision))
    }

    fn new(trained: TrainedNetwork, from: &str, precision: Precision) -> Self {
        let name = format!("{} ({from})", trained.weights.variant().name());
        Self { name, trained: Arc::new(trained), precision }
    }

    fn inference(&self) -> Result<Inference, Error> {
        Ok(Inference::new(&self.trained.weights, self.trained.provenance.form, self.precision)?)
    }
}

fn main() -> Result<(), Error> {
    let args = Args::parse();
    on_one_thread(|| study(&args))
}

fn study(args: &Args) -> Result<(), Error> {
    let control = Control::none();
    let precision = match args.precision {
        Format::F32 => Precision::F32,
        Format::Bf16 => Precision::Bf16,
    };
    let candidates = match args.weights.is_empty() {
        true => vec![Candidate::shipped(precision)?],
        false => args.weights.iter().map(|w| Candidate::read(w, precision)).collect::<Result<_, _>>()?,
    };
    let mut record = Record::now("network_error", 1);
    record.add("matrix products", report::precision(precision));
    let study = Study::new("network_error", env!("CARGO_TARGET_TMPDIR"), &args.study, record)?;
    let mut rows: Vec<Row> = Vec::new();
    let mut pictures = Vec::new();
    for path in sets(args, study.folder(), &control)? {
        let set = LabelledSet::load(&[&path], &control)?;
        let header = set.header();
        let name = header.split.clone();
        println!("{name}: {} samples", set.len());
        let index = header.recipe.refractive_index;
        let viewing = Viewing::of_print(&header.materials, "white", index, Illuminant::D65)?;
        let from = rows.len();
        scores::measure(&name, &set, &viewing, &candidates, &mut rows, &control)?;
        for row in rows[from..].iter().filter(|r| r.class.is_none()) {
            println!(
                "  {}: rmse {:.4}, bias {:+.4}, {:.1} us a sample",
                row.predictor, row.rmse, row.bias, row.microseconds
            );
        }
        if args.study.full && DRAWN.contains(&name.as_str()) {
            let spp = report::equal_time_paths(&rows[from..], &shared::name_in_use(&candidates[0]));
            let file = format!("{name}.png");
            let picture = study.folder().join(&file);
            pictures::draw(&picture, &set, &viewing, &candidates, spp, args.edge, &control)?;
            pictures.push((file, name, spp));
        }
    }
    study.write(
        "Network and Monte Carlo on held-out volumes",
        &report::markdown(&rows, &candidates, &pictures),
        &report::table(&rows),
        &report::plot(&rows),
    )?;
    Ok(())
}

/// The sets to judge on, in the order of their names.
fn sets(args: &Args, folder: &Path, control: &Control<'_>) -> Result<Vec<PathBuf>, Error> {
    let mut files = match &args.sets {
        Some(folder) => {
            let named = |e: std::io::Error| format!("{}: {e}", folder.display());
            std::fs::read_dir(folder)
                .map_err(named)?
                .map(|entry| entry.map(|e| e.path()))
                .collect::<Result<Vec<_>, _>>()
                .map_err(named)?
        }
        None => made(args.study.full, &folder.join("sets"), control)?,
    };
    files.retain(|path| path.extension().is_some_and(|e| e == "set"));
    files.sort();
    if files.is_empty() {
        return Err("no file such as test.set in the folder of --sets".into());
    }
    Ok(files)
}

/// Held-out sets of the default recipe; what an earlier run made is used again.
fn made(full: bool, folder: &Path, control: &Control<'_>) -> Result<Vec<PathBuf>, Error> {
    let recipe = concat!(env!("CARGO_MANIFEST_DIR"), "/../datasets/recipes/default.json");
    let mut recipe = Recipe::read(Path::new(recipe))?;
    recipe.splits.retain(|split| match full {
        true => !["train", "validation"].contains(&split.name.as_str()),
        false => SMALL.contains(&split.name.as_str()),
    });
    if !full {
        for split in &mut recipe.splits {
            split.volumes = SMALL_VOLUMES;
            split.points = SMALL_POINTS;
            split.std_error = Some(SMALL_STD_ERROR);
        }
    }
    std::fs::create_dir_all(folder)?;
    let names: Vec<String> = recipe.splits.iter().map(|split| split.name.clone()).collect();
    names
        .into_iter()
        .map(|split| {
            println!("labelling {split}");
            let header = SetHeader {
                recipe: recipe.clone(),
                split,
                materials: MaterialTable::cmykw(),
                shard: Shard::WHOLE,
            };
            Ok(generate(folder, &header, control)?)
        })
        .collect()
}
