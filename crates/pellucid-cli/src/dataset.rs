//! `pellucid dataset`: files of labelled points.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use indicatif::{ProgressBar, ProgressStyle};
use pellucid::dataset::set_file::{SetHeader, Shard};
use pellucid::dataset::{self, DatasetError, Judgement, LabelledSet, Recipe};
use pellucid::training::{TrainingError, judge_network};
use pellucid::voxel::{Control, MaterialTable};
use pellucid_core::{FileError, files};

use crate::Failure;
use crate::train::Format;

/// What to do with files of labelled points.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Label the points of a recipe's splits; a stopped run goes on where it was
    Generate(GenerateArgs),
    /// Say what files hold
    Info(InfoArgs),
    /// Make some volumes of a file again and compare them bit by bit
    Verify(VerifyArgs),
    /// Tell a network's errors on labelled points, by family of shapes
    Judge(JudgeArgs),
}

/// Arguments of `pellucid dataset generate`.
#[derive(clap::Args)]
pub struct GenerateArgs {
    /// The recipe in JSON, such as datasets/recipes/default.json
    recipe: PathBuf,
    /// Folder for the files, one a split
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Splits to make; all but `train` without it
    #[arg(long, value_name = "NAME")]
    split: Vec<String>,
    /// Make part I of N only, I from 0
    #[arg(long, value_name = "I/N", value_parser = parse_shard)]
    shard: Option<Shard>,
}

/// Arguments of `pellucid dataset info`.
#[derive(clap::Args)]
pub struct InfoArgs {
    /// Files made by `generate`
    #[arg(required = true)]
    files: Vec<PathBuf>,
}

/// Arguments of `pellucid dataset verify`.
#[derive(clap::Args)]
pub struct VerifyArgs {
    /// Files made by `generate`
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Volumes of each file to make again
    #[arg(long, default_value_t = 4)]
    volumes: u32,
    /// Seed that chooses them
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

/// Arguments of `pellucid dataset judge`.
#[derive(clap::Args)]
pub struct JudgeArgs {
    /// Files made by `generate`, each a whole split
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Weights to judge, made by `pellucid train`; those the program carries without it
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
    /// Number format of matrix products
    #[arg(long, value_enum, default_value_t = Format::F32)]
    precision: Format,
    /// Write the figures to this file too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    let (index, count) = numbers.ok_or("write it as 0/4")?;
    Shard::new(index, count).map_err(|e| e.to_string())
}

/// Runs the command.
pub fn run(command: &Command, cancel: &AtomicBool) -> Result<(), Failure> {
    let done = match command {
        Command::Generate(args) => generate(args, cancel),
        Command::Info(args) => args.files.iter().try_for_each(|file| Ok(info(file)?)),
        Command::Verify(args) => args.files.iter().try_for_each(|file| {
            let volumes = with_bar("volumes", cancel, |control| {
                dataset::verify(file, args.volumes, args.seed, control)
            })?;
            println!("{}: {volumes} volumes are as this version makes them", file.display());
            Ok(())
        }),
        Command::Judge(args) => judge(args, cancel),
    };
    done.map_err(|error| match (error, command) {
        (TrainingError::Cancelled, Command::Generate(_)) => {
            Failure::Stopped("the same command goes on where it was")
        }
        (TrainingError::Cancelled, _) => Failure::Cancelled,
        (other, _) => Failure::Error(other.into()),
    })
}

fn generate(args: &GenerateArgs, cancel: &AtomicBool) -> Result<(), TrainingError> {
    let recipe = Recipe::read(&args.recipe)?;
    let splits = if args.split.is_empty() {
        recipe.splits.iter().map(|s| s.name.clone()).filter(|name| name != "train").collect()
    } else {
        args.split.clone()
    };
    std::fs::create_dir_all(&args.out).map_err(FileError::at("create", &args.out))?;
    for split in splits {
        let header = SetHeader {
            recipe: recipe.clone(),
            split,
            materials: MaterialTable::cmykw(),
            shard: args.shard.unwrap_or(Shard::WHOLE),
        };
        info(&with_bar("volumes", cancel, |control| dataset::generate(&args.out, &header, control))?)?;
    }
    Ok(())
}

fn info(file: &Path) -> Result<(), DatasetError> {
    let info = dataset::info(file)?;
    let Shard { index, count } = info.header.shard;
    println!(
        "{}: recipe {} seed {}, split {}, part {index} of {count}, {} samples, mean radiance {:.4}, standard error {:.5} rms, {:.5} at most",
        file.display(),
        info.header.recipe.name,
        info.header.recipe.seed,
        info.header.split,
        info.samples,
        info.mean,
        info.rms_std_error,
        info.max_std_error
    );
    Ok(())
}

fn judge(args: &JudgeArgs, cancel: &AtomicBool) -> Result<(), TrainingError> {
    let (weights, provenance) = match &args.weights {
        Some(path) => pellucid::rpnn::file::load(path)?,
        None => pellucid::rpnn::shipped()?,
    };
    let mut judgements = Vec::new();
    for file in &args.files {
        let set = with_bar("volumes", cancel, |control| LabelledSet::load(&[file], control))?;
        let judgement = with_bar("samples", cancel, |control| {
            judge_network(&weights, &provenance, args.precision.precision(), &set, control)
        })?;
        print_table(file, &judgement);
        judgements.push(judgement);
    }
    if let Some(path) = &args.json {
        files::write_whole(path, |out| {
            serde_json::to_writer_pretty(&mut *out, &judgements)?;
            writeln!(out)
        })?;
    }
    Ok(())
}

fn print_table(file: &Path, judgement: &Judgement) {
    println!("{}: recipe {}, split {}", file.display(), judgement.recipe, judgement.split);
    println!("  {:12} {:>8} {:>8} {:>8} {:>8}", "shape", "samples", "rmse", "bias", "p95");
    let by_shape = judgement.by_shape.iter().map(|s| (s.shape.name(), s.score));
    for (name, score) in std::iter::once(("all", judgement.all)).chain(by_shape) {
        println!(
            "  {name:12} {:>8} {:>8.4} {:>+8.4} {:>8.4}",
            score.samples, score.rmse, score.bias, score.p95
        );
    }
}

/// Shows the volumes or samples done on a terminal.
fn with_bar<T>(what: &str, cancel: &AtomicBool, work: impl FnOnce(&Control<'_>) -> T) -> T {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{pos:>6} of {len} {msg} [{bar:32}] {eta} left") {
        bar.set_message(what.to_owned());
        bar.set_style(style.progress_chars("=> "));
    }
    let progress = |done: u64, total: u64| {
        bar.set_length(total);
        bar.set_position(done);
    };
    let result = work(&Control::none().with_cancel(cancel).with_progress(&progress));
    bar.finish_and_clear();
    result
}
