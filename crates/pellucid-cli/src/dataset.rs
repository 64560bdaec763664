//! `pellucid dataset`: files of labelled points.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use indicatif::{ProgressBar, ProgressStyle};
use pellucid::core::{FileError, Team, files};
use pellucid::dataset::{self, Errors, Judgement, LabelledSet, Recipe, SetHeader, Shard};
use pellucid::training::judge_network;
use pellucid::voxel::{Control, MaterialTable};
use serde_json::{Value, json};

use crate::train::Format;
use crate::{Failure, terminal};

/// Parts that a team makes of a set: the same for every number of members, so that another one goes on with them, and
/// enough to be shared out evenly.
const PARTS: u32 = 48;

/// What to do with files of labelled points.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Label the points of a recipe's splits; a stopped run goes on where it was
    Generate(GenerateArgs),
    /// Say what files hold
    Info(InfoArgs),
    /// Make some volumes of a file again and compare them bit by bit
    Verify(VerifyArgs),
    /// Tell a network's errors on labelled points, by family of shapes and by channel
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
    match command {
        Command::Generate(args) => generate(args, cancel).map_err(|failure| match failure {
            Failure::Cancelled(_) => Failure::Cancelled("the same command goes on where it was".into()),
            other => other,
        }),
        Command::Info(args) => args.files.iter().try_for_each(|file| info(file)),
        Command::Verify(args) => args.files.iter().try_for_each(|file| verify(args, file, cancel)),
        Command::Judge(args) => judge(args, cancel),
    }
}

/// `pellucid dataset generate` as a member of a team: volumes are dealt out in parts, which the first member joins. The
/// files are, byte for byte, those of one member alone.
///
/// # Errors
/// [`Failure`], as a message for the user.
pub fn generate_in(args: &GenerateArgs, team: &dyn Team) -> Result<(), Failure> {
    if args.shard.is_some() {
        return Err(Failure::message("--shard: the volumes are dealt out among the processes; leave it out"));
    }
    let never = AtomicBool::new(false);
    for whole in headers(args)? {
        let parts = PARTS.min(whole.split()?.volumes).max(1);
        let made = args.out.join(dataset::labels::file_name(&whole.split, Shard::WHOLE)).exists();
        for index in (0..parts).skip(team.rank()).step_by(team.size()).filter(|_| !made) {
            let part = SetHeader { shard: Shard::new(index, parts)?, ..whole.clone() };
            with_bar("volumes", &never, |control| dataset::generate(&args.out, &part, control))?;
        }
        // Until every member has made its parts.
        team.sum(&mut [0]);
        if team.rank() == 0 {
            info(&dataset::join(&args.out, &whole, parts)?)?;
        }
    }
    Ok(())
}

/// What the files of the arguments' splits are to hold; makes their folder.
fn headers(args: &GenerateArgs) -> Result<Vec<SetHeader>, Failure> {
    let recipe = Recipe::read(&args.recipe)?;
    let splits = if args.split.is_empty() {
        recipe.splits.iter().map(|s| s.name.clone()).filter(|name| name != "train").collect()
    } else {
        args.split.clone()
    };
    std::fs::create_dir_all(&args.out).map_err(FileError::at("create", &args.out))?;
    let header = |split| SetHeader {
        recipe: recipe.clone(),
        split,
        materials: MaterialTable::cmykw(),
        shard: args.shard.unwrap_or(Shard::WHOLE),
    };
    Ok(splits.into_iter().map(header).collect())
}

fn generate(args: &GenerateArgs, cancel: &AtomicBool) -> Result<(), Failure> {
    for header in headers(args)? {
        info(&with_bar("volumes", cancel, |control| dataset::generate(&args.out, &header, control))?)?;
    }
    Ok(())
}

fn info(file: &Path) -> Result<(), Failure> {
    let info = dataset::info(file)?;
    let Shard { index, count } = info.header.shard;
    terminal::print(&format!(
        "{}: recipe {} seed {}, split {}, part {index} of {count}, {} samples, mean radiance {:.4}, standard error {:.5} rms, {:.5} at most\n",
        file.display(),
        info.header.recipe.name,
        info.header.recipe.seed,
        info.header.split,
        info.samples,
        info.mean,
        info.rms_std_error,
        info.max_std_error
    ))?;
    Ok(())
}

fn verify(args: &VerifyArgs, file: &Path, cancel: &AtomicBool) -> Result<(), Failure> {
    let volumes =
        with_bar("volumes", cancel, |control| dataset::verify(file, args.volumes, args.seed, control))?;
    terminal::print(&format!("{}: {volumes} volumes are as this version makes them\n", file.display()))?;
    Ok(())
}

fn judge(args: &JudgeArgs, cancel: &AtomicBool) -> Result<(), Failure> {
    let network = match &args.weights {
        Some(path) => pellucid::rpnn::file::load(path)?,
        None => pellucid::rpnn::shipped()?,
    };
    let mut judgements = Vec::new();
    for file in &args.files {
        let set = with_bar("volumes", cancel, |control| LabelledSet::load(&[file], control))?;
        let judgement = with_bar("samples", cancel, |control| {
            judge_network(&network, args.precision.precision(), &set, control)
        })?;
        terminal::print(&table(file, set.header(), &judgement))?;
        judgements.push(figures(set.header(), &judgement));
    }
    if let Some(path) = &args.json {
        files::write_whole(path, |out| {
            serde_json::to_writer_pretty(&mut *out, &judgements)?;
            writeln!(out)
        })?;
    }
    Ok(())
}

/// Lines of figures for people.
fn table(file: &Path, header: &SetHeader, judgement: &Judgement) -> String {
    let mut text = format!("{}: recipe {}, split {}\n", file.display(), header.recipe.name, header.split);
    text += &format!("  {:12} {:>8} {:>8} {:>8} {:>8}\n", "part", "samples", "rmse", "bias", "p95");
    let mut row = |part: &str, Errors { score, absolute }: &Errors| {
        text += &format!(
            "  {part:12} {:>8} {:>8.4} {:>+8.4} {:>8.4}\n",
            score.count(),
            score.rmse(),
            score.bias(),
            absolute.p95
        );
    };
    row("all", &judgement.whole);
    for (shape, errors) in &judgement.classes {
        row(shape.name(), errors);
    }
    for (channel, errors) in header.materials.channel_names().iter().zip(&judgement.channels) {
        row(&format!("channel {channel}"), errors);
    }
    text
}

/// The same for programs.
fn figures(header: &SetHeader, judgement: &Judgement) -> Value {
    let figures = |Errors { score, absolute }: &Errors| {
        json!({
            "samples": score.count(),
            "rmse": score.rmse(),
            "raw_rmse": score.raw_rmse(),
            "bias": score.bias(),
            "p95": absolute.p95,
        })
    };
    let shapes: Vec<Value> = judgement
        .classes
        .iter()
        .map(|(shape, errors)| json!({ "shape": shape.name(), "errors": figures(errors) }))
        .collect();
    let names = header.materials.channel_names();
    let channels: Vec<Value> = names
        .iter()
        .zip(&judgement.channels)
        .map(|(channel, errors)| json!({ "channel": channel, "errors": figures(errors) }))
        .collect();
    json!({
        "recipe": header.recipe.name,
        "split": header.split,
        "all": figures(&judgement.whole),
        "shapes": shapes,
        "channels": channels,
    })
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
