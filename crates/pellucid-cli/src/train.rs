//! `pellucid train`: weights from a recipe.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::ValueEnum;
use pellucid::dataset::{
    LabelledSet, Labelling, Recipe, STENCIL_VALUES, Sampler, StoredVolumes, Stream, StreamOptions,
};
use pellucid::rpnn::file::{Provenance, save};
use pellucid::rpnn::train::{SampleSource, Score, TrainSettings, Trainer};
use pellucid::rpnn::transform::{InputForm, LevelOrder};
use pellucid::rpnn::{Precision, RpnnError};
use pellucid::trace::Boundary;
use pellucid::voxel::{Control, MaterialTable};
use rayon::prelude::*;

use crate::Failure;

/// Steps between rows of the loss curve.
const RECORD: u64 = 100;
/// Steps between validations at the start of a run; later every checkpoint validates.
const FIRST_VALIDATIONS: [u64; 4] = [250, 500, 1000, 2000];
/// Length of a run until its speed is known.
const UNPLANNED: u64 = 1 << 20;

/// Trains the appearance network on procedural volumes
#[derive(clap::Args)]
pub struct Args {
    /// Data set recipe in JSON, whose volumes are made while they are used
    #[arg(long, value_name = "FILE", required_unless_present = "stored")]
    recipe: Option<PathBuf>,
    /// Files made by `pellucid dataset generate`, all parts of one split, to train on instead
    #[arg(long, value_name = "FILE", num_args = 1.., conflicts_with_all = ["recipe", "split", "spp", "points"])]
    stored: Vec<PathBuf>,
    /// Folder for weights.safetensors, the checkpoint run.safetensors and curve.csv
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Architecture
    #[arg(long, value_enum, default_value_t = Variant::Lo)]
    variant: Variant,
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

/// A split's labelled points in memory.
struct Set {
    stencils: Vec<f32>,
    radiance: Vec<f32>,
    std_error: Vec<f32>,
}

struct Source<'a>(Stream, Control<'a>);

impl SampleSource for Source<'_> {
    fn batch(
        &mut self,
        index: u64,
        stencils: &mut [f32],
        radiance: &mut [f32],
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(self.0.batch(index, stencils, radiance, &self.1)?)
    }
}

/// Runs the command.
pub fn run(args: &Args, cancel: &AtomicBool) -> Result<(), Failure> {
    train(args, cancel).map_err(|e| {
        if cancel.load(Ordering::Relaxed) {
            Failure::Cancelled
        } else {
            Failure::Error(pellucid_core::chain(e.as_ref()))
        }
    })
}

type Error = Box<dyn std::error::Error + Send + Sync>;

fn train(args: &Args, cancel: &AtomicBool) -> Result<(), Error> {
    let control = Control::none().with_cancel(cancel);
    let stored = match args.stored.is_empty() {
        true => None,
        false => Some(StoredVolumes::load(&args.stored)?),
    };
    let materials =
        stored.as_ref().map_or_else(MaterialTable::cmykw, |stored| stored.header().materials.clone());
    let recipe = match (&stored, &args.recipe) {
        (Some(stored), _) => stored.header().recipe.clone(),
        (None, Some(path)) => Recipe::read(path)?,
        (None, None) => return Err("--recipe or --stored is needed".into()),
    };
    let boundary = Boundary::with_index(recipe.refractive_index)?;
    std::fs::create_dir_all(&args.out).map_err(|e| format!("{}: {e}", args.out.display()))?;
    let state = args.out.join("run.safetensors");
    let mut trainer = start_or_resume(args, &state)?.with_engine(args.engine.network())?;
    let split = match &stored {
        Some(stored) => stored.header().split()?.clone(),
        None => recipe.split(&args.split)?.clone(),
    };
    let options = StreamOptions {
        batch: trainer.settings().batch,
        window: args.window,
        points: args.points.unwrap_or(split.points),
        spp: args.spp.unwrap_or(split.spp),
        boundary,
        seed: trainer.settings().seed,
        threads: args.threads,
    };
    let validation = (args.validation != "none")
        .then(|| match args.validation.ends_with(".set") {
            true => stored_set(Path::new(&args.validation), &control),
            false => labelled(&recipe, &args.validation, &materials, boundary, &control),
        })
        .transpose()?;
    let trained = Sampler::new(&recipe, &split.name, &materials, boundary)?;
    let provenance = |trainer: &Trainer| provenance(trainer, &recipe, trained.materials(), &options);
    let stream = match stored {
        Some(stored) => Stream::stored(stored, options.clone())?,
        None => Stream::new(&recipe, &split.name, &materials, options.clone())?,
    };
    let mut source = Source(stream, control);

    let (start, first_step) = (Instant::now(), trainer.steps_done());
    let every = Duration::from_secs_f64(60.0 * args.checkpoint.clamp(0.05, 600.0));
    let mut saved = start;
    let write = |trainer: &Trainer| -> Result<(), RpnnError> {
        trainer.save(&state)?;
        trainer.curve().write_csv(&args.out.join("curve.csv"))?;
        save(&args.out.join("weights.safetensors"), &trainer.averaged()?, &provenance(trainer))
    };
    let run = trainer.run(&mut source, |trainer, report| {
        if cancel.load(Ordering::Relaxed) {
            return Ok(ControlFlow::Break(()));
        }
        let due = saved.elapsed() >= every || trainer.finished();
        let validate = due || FIRST_VALIDATIONS.contains(&report.step);
        if !validate && !report.step.is_multiple_of(RECORD) {
            return Ok(ControlFlow::Continue(()));
        }
        let score = match &validation {
            Some(set) if validate => Some(trainer.validate(&set.stencils, &set.radiance, &set.std_error)?),
            _ => None,
        };
        trainer.record(report, score);
        if due {
            saved = Instant::now();
            if let Some(minutes) = args.minutes {
                fit_length(trainer, minutes, start, first_step)?;
            }
            write(trainer)?;
        }
        if let Some(score) = score {
            let steps = (trainer.steps_done() - first_step) as f64;
            progress(trainer, &score, steps / start.elapsed().as_secs_f64());
        }
        Ok(ControlFlow::Continue(()))
    });
    if cancel.load(Ordering::Relaxed) {
        write(&trainer)?;
        eprintln!("stopped after step {}; --resume goes on from there", trainer.steps_done());
        return Ok(());
    }
    run?;
    println!("wrote {}", args.out.join("weights.safetensors").display());
    Ok(())
}

/// A new run, or the one whose state the output folder holds.
fn start_or_resume(args: &Args, state: &Path) -> Result<Trainer, Error> {
    if args.resume {
        let mut trainer = Trainer::resume(state)?;
        if let Some(steps) = args.steps {
            trainer.set_steps(steps)?;
        }
        return Ok(trainer);
    }
    if state.exists() {
        return Err(format!("{} exists; --resume goes on from it", state.display()).into());
    }
    let defaults = TrainSettings::default();
    Ok(Trainer::new(TrainSettings {
        form: InputForm { order: args.order.network(), ..defaults.form },
        variant: args.variant.network(),
        steps: args.steps.unwrap_or(UNPLANNED),
        peak_rate: args.rate,
        precision: args.precision.precision(),
        seed: args.seed,
        ..defaults
    })?)
}

/// Sets the number of steps so that the run, at its mean speed so far, ends `minutes` after its start. In its
/// last third the length stays as it is, so that the learning rate comes to rest.
fn fit_length(trainer: &mut Trainer, minutes: f64, start: Instant, first: u64) -> Result<(), RpnnError> {
    let (passed, all) = (start.elapsed().as_secs_f64(), 60.0 * minutes);
    let done = trainer.steps_done();
    if trainer.finished() || passed > 0.67 * all && trainer.settings().steps < UNPLANNED {
        return Ok(());
    }
    let left = (all - passed).max(0.0) * (done - first) as f64 / passed;
    trainer.set_steps(done + (left as u64).max(1).max((trainer.settings().warm_up + 1).saturating_sub(done)))
}

fn progress(trainer: &Trainer, score: &Score, steps_a_second: f64) {
    let batch = trainer.settings().batch as u64;
    println!(
        "step {} of {}: {:.2} M samples, {:.0}/s; validation rmse {:.4}, bias {:+.4}, p95 {:.4}; {:.1} min in all",
        trainer.steps_done(),
        trainer.settings().steps,
        (trainer.steps_done() * batch) as f64 * 1e-6,
        steps_a_second * batch as f64,
        score.rmse,
        score.bias,
        score.p95,
        trainer.seconds() / 60.0
    );
}

/// Labels a split as it asks for: its numbers of volumes and points, its paths or standard error.
fn labelled(
    recipe: &Recipe,
    split: &str,
    materials: &MaterialTable,
    boundary: Boundary,
    control: &Control<'_>,
) -> Result<Set, Error> {
    let sampler = Sampler::new(recipe, split, materials, boundary)?;
    let (volumes, points, labelling) =
        (sampler.split().volumes, sampler.split().points, Labelling::of(sampler.split()));
    let made = (0..volumes)
        .into_par_iter()
        .map(|volume| sampler.samples(volume, points, labelling, control))
        .collect::<Result<Vec<_>, _>>()?;
    Ok(Set {
        stencils: made.iter().flat_map(|s| s.stencils.to_f32()).collect(),
        radiance: made.iter().flat_map(|s| s.radiance.iter().copied()).collect(),
        std_error: made.iter().flat_map(|s| s.std_error.iter().copied()).collect(),
    })
}

/// A set that was labelled before.
fn stored_set(path: &Path, control: &Control<'_>) -> Result<Set, Error> {
    let set = LabelledSet::load(&[path], control)?;
    let mut stencils = vec![0.0; set.len() * STENCIL_VALUES];
    set.stencils(0, &mut stencils);
    Ok(Set { stencils, radiance: set.radiance().to_vec(), std_error: set.std_error().to_vec() })
}

/// What the weights were trained for, and how.
fn provenance(
    trainer: &Trainer,
    recipe: &Recipe,
    materials: &MaterialTable,
    options: &StreamOptions,
) -> Provenance {
    let range = |values: &dyn Fn(&pellucid::voxel::Material) -> Vec<f32>| {
        let all: Vec<f64> = materials.materials().iter().flat_map(values).map(f64::from).collect();
        [all.iter().copied().fold(f64::INFINITY, f64::min), all.iter().copied().fold(0.0, f64::max)]
    };
    let s = trainer.settings();
    let validation = trainer.curve().points.iter().rev().find_map(|p| p.validation);
    let validation = validation.map_or(String::new(), |v| {
        format!("; validation rmse {:.4}, bias {:+.4} over {} samples", v.rmse, v.bias, v.samples)
    });
    Provenance {
        form: s.form,
        pitch_mm: recipe.pitch.mm(),
        refractive_index: recipe.refractive_index,
        sigma_s_range: range(&|m| m.sigma_s.clone()),
        sigma_a_range: range(&|m| m.sigma_a.clone()),
        history: format!(
            "pellucid {} {}; recipe {:?}; {} of {} steps of {} samples at {} paths, {} points a volume; \
             {:.0} minutes{validation}",
            env!("CARGO_PKG_VERSION"),
            std::env::args().skip(1).collect::<Vec<_>>().join(" "),
            recipe.name,
            trainer.steps_done(),
            s.steps,
            s.batch,
            options.spp,
            options.points,
            trainer.seconds() / 60.0
        ),
    }
}
