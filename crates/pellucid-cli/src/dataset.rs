//! `pellucid dataset`: files of labelled points.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use indicatif::{ProgressBar, ProgressStyle};
use pellucid::dataset::{self, DatasetError, Recipe, SetHeader, Shard};
use pellucid::voxel::{Control, MaterialTable};
use pellucid_core::{FileError, chain};

use crate::Failure;

/// What to do with files of labelled points.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Label the points of a recipe's splits; a stopped run goes on where it was
    Generate(GenerateArgs),
    /// Say what files hold
    Info(InfoArgs),
    /// Make some volumes of a file again and compare them bit by bit
    Verify(VerifyArgs),
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

fn parse_shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    let (index, count) = numbers.ok_or("write it as 0/4")?;
    Shard::new(index, count).map_err(|e| e.to_string())
}

/// Runs the command.
pub fn run(command: &Command, cancel: &AtomicBool) -> Result<(), Failure> {
    let done = match command {
        Command::Generate(args) => generate(args, cancel),
        Command::Info(args) => args.files.iter().try_for_each(|file| info(file)),
        Command::Verify(args) => args.files.iter().try_for_each(|file| {
            let volumes =
                with_bar(cancel, |control| dataset::verify(file, args.volumes, args.seed, control))?;
            println!("{}: {volumes} volumes are as this version makes them", file.display());
            Ok(())
        }),
    };
    done.map_err(|error| match error {
        DatasetError::Cancelled => Failure::Cancelled,
        other => Failure::Error(chain(&other)),
    })
}

fn generate(args: &GenerateArgs, cancel: &AtomicBool) -> Result<(), DatasetError> {
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
        info(&with_bar(cancel, |control| dataset::generate(&args.out, &header, control))?)?;
    }
    Ok(())
}

fn info(file: &Path) -> Result<(), DatasetError> {
    let info = dataset::info(file)?;
    let Shard { index, count } = info.header.shard;
    println!(
        "{}: recipe {:?} seed {}, split {:?}, part {index} of {count}, {} samples, mean radiance {:.4}, standard error {:.5} rms, {:.5} at most",
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

/// Shows the volumes done on a terminal.
fn with_bar<T>(cancel: &AtomicBool, work: impl FnOnce(&Control<'_>) -> T) -> T {
    let bar = ProgressBar::new(0);
    if let Ok(style) = ProgressStyle::with_template("{pos:>6} of {len} volumes [{bar:32}] {eta} left") {
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
