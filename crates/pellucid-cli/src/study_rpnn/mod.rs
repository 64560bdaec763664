//! `pellucid study rpnn`: networks beside Monte Carlo on labelled sets (Rittig et al. 2021, Table 2 and Figures
//! 11 and 12).

mod output;
mod pictures;
mod scores;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use pellucid::color::MixtureModel;
use pellucid::dataset::LabelledSet;
use pellucid::predictor::Rpnn;
use pellucid::rpnn::file::Provenance;
use pellucid::rpnn::transform::LevelOrder;
use pellucid::rpnn::{Inference, Precision, TrainedNetwork, Weights};
use pellucid::voxel::Control;

use crate::Failure;
use crate::files::write_files;
use scores::Row;

type Error = Box<dyn std::error::Error + Send + Sync>;

/// Splits of which a picture is drawn.
const DRAWN: [&str; 5] = ["test", "unseen-shape", "unseen-density-x4", "unseen-density-quarter", "loops"];

/// Errors and times of networks beside Monte Carlo
#[derive(clap::Args)]
pub struct Args {
    /// Weights to compare, made by `pellucid train`; the first is the one compared with Monte Carlo at equal time
    #[arg(long, value_name = "FILE", required = true, num_args = 1..)]
    weights: Vec<PathBuf>,
    /// Folder with the labelled sets, made by `pellucid dataset generate`
    #[arg(long, value_name = "DIR")]
    sets: PathBuf,
    /// Folder for rpnn.md, rpnn.csv and the pictures
    #[arg(long, default_value = "docs/results/rpnn")]
    out: PathBuf,
    /// Number format of the networks' matrix products
    #[arg(long, value_enum, default_value_t = crate::train::Format::F32)]
    precision: crate::train::Format,
    /// Longer edge of a picture in pixels
    #[arg(long, default_value_t = 200)]
    edge: u32,
}

/// A network under study.
struct Candidate {
    name: String,
    weights: Weights,
    provenance: Provenance,
    precision: Precision,
}

impl Candidate {
    fn read(path: &Path, precision: Precision) -> Result<Self, Error> {
        let TrainedNetwork { weights, provenance } = pellucid::rpnn::file::load(path)?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let name = format!("{} ({stem})", weights.variant().name());
        Ok(Self { name, weights, provenance, precision })
    }

    /// The predictor as prints use it.
    fn predictor(&self) -> Rpnn {
        Rpnn::new(self.weights.clone(), self.provenance.clone(), self.precision)
    }

    /// Whether that predictor lets neighbours share coarse levels.
    fn shares(&self) -> bool {
        self.provenance.form.order == LevelOrder::CoarseToFine
    }

    /// The name of [`Candidate::predictor`] in tables.
    fn name_in_use(&self) -> String {
        if self.shares() { format!("{}, coarse levels shared", self.name) } else { self.name.clone() }
    }

    fn inference(&self) -> Result<Inference, Error> {
        Ok(Inference::new(&self.weights, self.provenance.form, self.precision)?)
    }
}

/// Runs the study on one thread and writes its results.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let control = Control::none().with_cancel(cancel);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let result = pool.map_err(Error::from).and_then(|pool| pool.install(|| study(args, &control)));
    match result {
        Ok(()) => Ok(()),
        Err(_) if control.cancelled() => Err(Failure::Cancelled),
        Err(error) => Err(Failure::Error(pellucid_core::chain(error.as_ref()))),
    }
}

fn study(args: &Args, control: &Control<'_>) -> Result<(), Error> {
    let precision = args.precision.precision();
    let candidates =
        args.weights.iter().map(|path| Candidate::read(path, precision)).collect::<Result<Vec<_>, _>>()?;
    std::fs::create_dir_all(&args.out).map_err(|e| format!("{}: {e}", args.out.display()))?;
    let mut rows: Vec<Row> = Vec::new();
    let mut seen = Vec::new();
    let named = |e: std::io::Error| format!("{}: {e}", args.sets.display());
    let mut files: Vec<PathBuf> = std::fs::read_dir(&args.sets)
        .map_err(named)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<Result<_, _>>()
        .map_err(named)?;
    files.retain(|path| path.extension().is_some_and(|e| e == "set"));
    files.sort();
    for path in files {
        let set = LabelledSet::load(&[&path], control)?;
        let header = set.header();
        let name = header.split.clone();
        println!("{name}: {} samples", set.len());
        let white =
            MixtureModel::new(&header.materials, "white", header.recipe.refractive_index)?.media_white();
        let from = rows.len();
        scores::measure(&name, &set, white, &candidates, &mut rows, control)?;
        for row in rows[from..].iter().filter(|r| r.class.is_none()) {
            println!(
                "  {}: rmse {:.4}, bias {:+.4}, {:.1} us a sample",
                row.predictor, row.rmse, row.bias, row.microseconds
            );
        }
        if DRAWN.contains(&name.as_str()) {
            let spp = output::equal_time_paths(&rows[from..], &candidates[0].name_in_use());
            let file = format!("{name}.png");
            pictures::draw(&args.out.join(&file), &set, white, &candidates, spp, args.edge, control)?;
            seen.push((file, name, spp));
        }
    }
    if rows.is_empty() {
        return Err(format!("{}: no file such as test.set in it", args.sets.display()).into());
    }
    write_files(
        &args.out,
        &[("rpnn.csv", output::csv(&rows)), ("rpnn.md", output::markdown(&rows, &candidates, &seen))],
    )?;
    Ok(())
}
