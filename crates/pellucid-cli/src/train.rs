//! `pellucid train`: weights from a recipe.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use clap::ValueEnum;
use pellucid::core::team::Alone;
use pellucid::core::{Fault, Team};
use pellucid::dataset::{Prints, Recipe, Shard, StreamOptions};
use pellucid::rpnn::Precision;
use pellucid::rpnn::train::{Score, TrainSettings, Trainer};
use pellucid::rpnn::transform::{InputForm, LevelOrder};
use pellucid::training::{
    self, Outcome, RunSettings, TrainingError, TrainingSet, provenance, validation_set,
};
use pellucid::voxel::{Control, MaterialTable};

use crate::{Failure, terminal};

/// Trains the appearance network on procedural volumes
#[derive(clap::Args)]
pub struct Args {
    /// Data set recipe in JSON, whose volumes are made while they are used
    #[arg(long, value_name = "FILE", required_unless_present = "stored")]
    recipe: Option<PathBuf>,
    /// Files made by `pellucid dataset generate`, all parts of one split, to train on instead
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["recipe", "split", "spp", "points"])]
    stored: Vec<PathBuf>,
    /// Folders made by `pellucid prepare`, whose labels take the place of some of the recipe's volumes
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "stored")]
    prints: Vec<PathBuf>,
    /// Part of the volumes that are prints
    #[arg(long, value_name = "PART", default_value_t = 0.2, requires = "prints")]
    prints_share: f64,
    /// Folder for weights.safetensors, the checkpoint run.safetensors and curve.csv
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Architecture
    #[arg(long, value_enum, default_value_t = Variant::Lo)]
    variant: Variant,
    /// What the network's last layer gives
    #[arg(long, value_enum, default_value_t = Head::FirstFlight)]
    head: Head,
    /// Level of the stencil that the network reads first
    #[arg(long, value_enum, default_value_t = Order::CoarseToFine)]
    order: Order,
    /// Number of steps, over which the learning rate falls to zero
    #[arg(long, value_name = "N", conflicts_with = "minutes")]
    steps: Option<u64>,
    /// Time to train; the number of steps is fitted to it from the speed measured on the way
    #[arg(long, value_name = "N")]
    minutes: Option<f64>,
    /// Go on from the checkpoint in --out; bit for bit the run it was when its length is not changed
    #[arg(long)]
    resume: bool,
    /// Split of the recipe to train on
    #[arg(long, default_value = "train")]
    split: String,
    /// Split of the recipe to validate on, labelled when the run starts, or a file made by `pellucid dataset
    /// generate`; "none" leaves validation out
    #[arg(long, default_value = "validation", value_name = "SPLIT|FILE")]
    validation: String,
    /// Number format of matrix products
    #[arg(long, value_enum, default_value_t = Format::F32)]
    precision: Format,
    /// Who computes outputs and gradients; a run may be resumed on another
    #[arg(long, value_enum, default_value_t = Engine::Own)]
    engine: Engine,
    /// Highest learning rate
    #[arg(long, default_value_t = 1.5e-3)]
    rate: f64,
    /// Paths per label; the recipe's number without it
    #[arg(long, value_name = "N")]
    spp: Option<u32>,
    /// Points per volume; the recipe's number without it
    #[arg(long, value_name = "N")]
    points: Option<u32>,
    /// Volumes whose samples are shuffled together
    #[arg(long, default_value_t = 64)]
    window: u32,
    /// Times that each sample is used, mirrored otherwise each time
    #[arg(long, default_value_t = 2)]
    passes: u32,
    /// Threads that make samples beside the one that trains
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Minutes between checkpoints
    #[arg(long, default_value_t = 5.0)]
    checkpoint: f64,
    /// Seed of initial weights, order and mirrors
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Variant {
    /// Layers of their own for every level
    Baseline,
    /// One block shared by all levels
    L,
    /// Layers shared by mirrored octants
    O,
    /// Both: the default
    Lo,
}

impl Variant {
    fn network(self) -> pellucid::rpnn::Variant {
        use pellucid::rpnn::Variant as V;
        match self {
            Self::Baseline => V::Baseline,
            Self::L => V::SharedLevels,
            Self::O => V::SharedOctants,
            Self::Lo => V::SharedLevelsAndOctants,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Head {
    /// Radiance, as in the paper
    Radiance,
    /// What follows the first collision, which is integrated exactly: the default
    FirstFlight,
}

impl Head {
    fn network(self) -> pellucid::rpnn::variant::Head {
        use pellucid::rpnn::variant::Head as H;
        match self {
            Self::Radiance => H::Radiance,
            Self::FirstFlight => H::FirstFlight,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Order {
    /// From the voxel outward, as in the paper
    FineToCoarse,
    /// From the whole inward: neighbours can share what the coarse levels say
    CoarseToFine,
}

impl Order {
    fn network(self) -> LevelOrder {
        match self {
            Self::FineToCoarse => LevelOrder::FineToCoarse,
            Self::CoarseToFine => LevelOrder::CoarseToFine,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
enum Engine {
    /// Pellucid's matrix products
    Own,
    /// candle, to compare with: in f32, and slower
    #[cfg(feature = "candle")]
    Candle,
}

impl Engine {
    fn network(self) -> pellucid::rpnn::train::Engine {
        use pellucid::rpnn::train::Engine as E;
        match self {
            Self::Own => E::Own,
            #[cfg(feature = "candle")]
            Self::Candle => E::Candle,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub enum Format {
    /// 32-bit floating point
    F32,
    /// Factors rounded to bfloat16, sums in 32 bits
    Bf16,
}

impl Format {
    /// The network's name for it.
    pub fn precision(self) -> Precision {
        match self {
            Self::F32 => Precision::F32,
            Self::Bf16 => Precision::Bf16,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    let alone: Arc<dyn Team> = Arc::new(Alone);
    train_as(args, &alone, cancel)
}

/// `pellucid train` as a member of a team, each of whom makes samples of volumes of its own and their gradient. The first
/// one validates and writes.
///
/// # Errors
/// [`Failure`], as a message for the user.
pub fn run_in(args: &Args, team: &Arc<dyn Team>) -> Result<(), Failure> {
    if team.size() > 1 && args.minutes.is_some() {
        return Err(Failure::message("--minutes: every process has a clock of its own; say --steps"));
    }
    train_as(args, team, &AtomicBool::new(false))
}

fn train_as(args: &Args, team: &Arc<dyn Team>, cancel: &AtomicBool) -> Result<(), Failure> {
    let control = &Control::none().with_cancel(cancel);
    let set = match &args.recipe {
        None => TrainingSet::stored(&args.stored)?,
        Some(recipe) => TrainingSet::of_recipe(Recipe::read(recipe)?, &args.split, MaterialTable::cmykw())?
            .with_prints(prints(args, control)?),
    };
    let trainer = start_or_resume(args)?.with_engine(args.engine.network())?;
    let mut trainer = trainer.with_team(Arc::clone(team))?;
    // All have read the checkpoint before the first member writes another.
    team.sum(&mut [0]);
    let defaults = set.options(trainer.samples_a_step(), trainer.settings().seed)?;
    let share = Shard::new(team.rank() as u32, team.size() as u32)?;
    let options = StreamOptions {
        window: args.window,
        passes: args.passes,
        points: args.points.unwrap_or(defaults.points),
        spp: args.spp.unwrap_or(defaults.spp),
        threads: args.threads,
        share,
        ..defaults
    };
    let header = set.header().clone();
    if team.rank() != 0 {
        return Ok(training::follow(&mut trainer, set.into_stream(options)?, control)?);
    }
    let validation = (args.validation != "none")
        .then(|| validation_set(&args.validation, &header, control))
        .transpose()?;
    let command = std::env::args().skip(1).collect::<Vec<_>>().join(" ");
    let provenance = |trainer: &Trainer| Ok(provenance(trainer, &header, &options, &command)?);
    let settings = RunSettings {
        folder: args.out.clone(),
        checkpoint: Duration::from_secs_f64(60.0 * args.checkpoint.clamp(0.05, 600.0)),
        minutes: args.minutes,
    };
    let stream = set.into_stream(options.clone())?;
    let outcome = training::run(
        &mut trainer,
        stream,
        validation.as_ref(),
        &settings,
        &provenance,
        &mut progress,
        control,
    )?;
    match outcome {
        Outcome::Finished => {
            terminal::print(&format!("wrote {}\n", args.out.join(training::WEIGHTS_FILE).display()))?;
            Ok(())
        }
        Outcome::Stopped => Err(Failure::Cancelled(format!(
            "{} holds step {}; --resume goes on from there",
            args.out.display(),
            trainer.steps_done()
        ))),
    }
}

/// The prints among the volumes.
fn prints(args: &Args, control: &Control<'_>) -> Result<Prints, Failure> {
    if args.prints.is_empty() {
        return Ok(Prints::none());
    }
    let mut grids = Vec::new();
    for folder in &args.prints {
        grids.push(pellucid::slice::read_stack(folder, control)?.0);
    }
    Ok(Prints::new(grids, args.prints_share)?)
}

/// A new run, or the one whose state the output folder holds.
fn start_or_resume(args: &Args) -> Result<Trainer, TrainingError> {
    let state = args.out.join(training::STATE_FILE);
    if args.resume {
        let mut trainer = Trainer::resume(&state)?;
        if let Some(steps) = args.steps {
            trainer.set_steps(steps)?;
        }
        return Ok(trainer);
    }
    if state.exists() {
        let fault = Fault::new("--out", format!("{} exists", state.display()));
        return Err(TrainingError::Invalid(fault.remedy("--resume goes on from it")));
    }
    let defaults = TrainSettings::default();
    let steps = args.steps.unwrap_or(training::UNPLANNED_STEPS);
    Ok(Trainer::new(TrainSettings {
        form: InputForm { order: args.order.network(), ..defaults.form },
        variant: args.variant.network(),
        head: args.head.network(),
        mean_output: args.head.network().mean_output(),
        steps,
        // A trial of a few steps warms up for fewer.
        warm_up: defaults.warm_up.min(steps / 4),
        peak_rate: args.rate,
        precision: args.precision.precision(),
        seed: args.seed,
        ..defaults
    })?)
}

fn progress(trainer: &Trainer, score: &Score, steps_a_second: f64) {
    let batch = trainer.settings().batch as u64;
    terminal::note(format!(
        "step {} of {}: {:.2} M samples, {:.0}/s; validation rmse {:.4}, bias {:+.4}, p95 {:.4}; {:.1} min in all",
        trainer.steps_done(),
        trainer.settings().steps,
        (trainer.steps_done() * batch) as f64 * 1e-6,
        steps_a_second * batch as f64,
        score.rmse,
        score.bias,
        score.p95,
        trainer.seconds() / 60.0
    ));
}
