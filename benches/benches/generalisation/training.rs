//! Four networks trained in step on one stream of samples.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use pellucid::dataset::{LabelledSet, Recipe, STENCIL_VALUES, SetHeader, Stream, StreamOptions};
use pellucid::rpnn::train::trainer::StepReport;
use pellucid::rpnn::train::{Batch, SampleSource, Trainer};
use pellucid::rpnn::variant::FirstFlight;
use pellucid::rpnn::{RpnnError, Variant};
use pellucid::training::{TrainingSet, provenance, validate};
use pellucid::voxel::Control;

use super::Error;
use super::plan::{Group, Plan};

/// Time between checkpoints.
const CHECKPOINT: Duration = Duration::from_secs(180);
/// Steps between rows of the curve without validation.
const RECORD: u64 = 100;

/// Which of a variant's two runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// All steps.
    Whole,
    /// The same to half the steps, then to rest at three quarters.
    ThreeQuarters,
}

/// Where a run's state is, or its weights when they are done.
pub fn path(folder: &Path, group: Group, variant: Variant, length: Length, what: &str) -> PathBuf {
    let variant = variant.name().to_lowercase().replace('+', "");
    let length = match length {
        Length::Whole => "",
        Length::ThreeQuarters => "-three-quarters",
    };
    folder.join(format!("{}-{}-{variant}{length}.{what}.safetensors", group.shapes.name(), group.seed))
}

/// The trainer of a run as it was saved last, where there is one.
pub fn saved(
    folder: &Path,
    group: Group,
    variant: Variant,
    length: Length,
) -> Result<Option<Trainer>, Error> {
    let path = path(folder, group, variant, length, "run");
    Ok(if path.exists() { Some(Trainer::resume(&path)?) } else { None })
}

struct Run {
    length: Length,
    trainer: Trainer,
    /// Step of the last checkpoint.
    saved: Option<u64>,
}

/// Trains a group's networks to the end, from where an earlier run of the study left them.
pub fn train(
    plan: &Plan,
    group: Group,
    recipe: &Recipe,
    validation: &LabelledSet,
    folder: &Path,
    control: &Control<'_>,
) -> Result<(), Error> {
    let mut lockstep = Lockstep::open(plan, group, folder)?;
    if lockstep.runs.iter().all(|run| run.trainer.finished()) && lockstep.runs.len() == 2 * Variant::ALL.len()
    {
        return Ok(());
    }
    let header = plan.training_set(recipe, group)?;
    let set = TrainingSet::of_recipe(header.recipe.clone(), &header.split, header.materials.clone())?;
    let batch = plan.settings(group, Variant::Baseline).batch;
    let options = set.options(batch, group.seed)?;
    let mut stream = set.into_stream(options.clone())?;
    let mut replay = Replay::new(batch);
    let mut since = Instant::now();
    while let Some(step) = lockstep.next_step() {
        control.check()?;
        replay.load(step, &mut stream, control)?;
        for run in
            lockstep.runs.iter_mut().filter(|r| r.trainer.steps_done() == step && !r.trainer.finished())
        {
            run.step(&mut replay, plan, group, validation, control)?;
        }
        lockstep.branch()?;
        if since.elapsed() >= CHECKPOINT || lockstep.next_step().is_none() {
            lockstep.save(&header, &options)?;
            since = Instant::now();
        }
    }
    Ok(())
}

impl Run {
    fn step(
        &mut self,
        replay: &mut Replay,
        plan: &Plan,
        group: Group,
        validation: &LabelledSet,
        control: &Control<'_>,
    ) -> Result<(), Error> {
        let mut done: Option<StepReport> = None;
        // One step at a time; the trainer counts its own seconds.
        self.trainer.run(replay, |_, report| {
            done = Some(*report);
            Ok::<_, RpnnError>(ControlFlow::Break(()))
        })?;
        let Some(report) = done else { return Ok(()) };
        let validates = report.step.is_multiple_of(plan.validate_every) || self.trainer.finished();
        if validates {
            let score = validate(&self.trainer, validation, control)?;
            self.trainer.record(&report, Some(score));
            println!(
                "{} {} {} {:?}: step {}, rmse {:.4}, bias {:+.4}, {:.1} ms a step",
                group.shapes.name(),
                group.seed,
                self.trainer.settings().variant.name(),
                self.length,
                report.step,
                score.rmse,
                score.bias,
                1e3 * self.trainer.seconds() / report.step as f64
            );
        } else if report.step.is_multiple_of(RECORD) {
            self.trainer.record(&report, None);
        }
        Ok(())
    }
}

/// The runs of a group.
struct Lockstep<'a> {
    half: u64,
    three_quarters: u64,
    group: Group,
    folder: &'a Path,
    runs: Vec<Run>,
}

impl<'a> Lockstep<'a> {
    fn open(plan: &Plan, group: Group, folder: &'a Path) -> Result<Self, Error> {
        let mut runs = Vec::new();
        for variant in Variant::ALL {
            let saved = |length| saved(folder, group, variant, length);
            let at = |trainer: Trainer, length| Run { length, saved: Some(trainer.steps_done()), trainer };
            runs.push(match saved(Length::Whole)? {
                Some(trainer) => at(trainer, Length::Whole),
                None => Run {
                    length: Length::Whole,
                    trainer: Trainer::new(plan.settings(group, variant))?,
                    saved: None,
                },
            });
            runs.extend(saved(Length::ThreeQuarters)?.map(|trainer| at(trainer, Length::ThreeQuarters)));
        }
        let (half, three_quarters) = (plan.half(), plan.three_quarters());
        let mut lockstep = Self { half, three_quarters, group, folder, runs };
        lockstep.branch()?;
        Ok(lockstep)
    }

    /// The step of the runs that lag most: after an end between two checkpoints some are ahead, and wait.
    fn next_step(&self) -> Option<u64> {
        self.runs.iter().filter(|r| !r.trainer.finished()).map(|r| r.trainer.steps_done()).min()
    }

    /// Starts the shorter run of every variant that has come to half its steps. It is saved at once, before its origin
    /// can be saved further on.
    fn branch(&mut self) -> Result<(), Error> {
        for variant in Variant::ALL {
            let of = |r: &&Run, length| r.length == length && r.trainer.settings().variant == variant;
            let Some(whole) = self.runs.iter().find(|r| of(r, Length::Whole)) else { continue };
            let known = self.runs.iter().any(|r| of(&r, Length::ThreeQuarters));
            if known || whole.trainer.steps_done() != self.half {
                continue;
            }
            let mut trainer = whole.trainer.clone();
            trainer.set_steps(self.three_quarters)?;
            trainer.save(&path(self.folder, self.group, variant, Length::ThreeQuarters, "run"))?;
            self.runs.push(Run { length: Length::ThreeQuarters, trainer, saved: Some(self.half) });
        }
        Ok(())
    }

    /// Writes the states that have changed, and the weights of those that are done.
    fn save(&mut self, header: &SetHeader, options: &StreamOptions) -> Result<(), Error> {
        for run in &mut self.runs {
            let trainer = &run.trainer;
            if run.saved == Some(trainer.steps_done()) {
                continue;
            }
            let path =
                |what: &str| path(self.folder, self.group, trainer.settings().variant, run.length, what);
            if trainer.finished() {
                let provenance = provenance(trainer, header, options, "study generalisation")?;
                pellucid::rpnn::file::save(&path("weights"), &trainer.averaged()?, &provenance)?;
            }
            trainer.save(&path("run"))?;
            run.saved = Some(trainer.steps_done());
        }
        Ok(())
    }
}

/// One batch, given to several trainers.
pub struct Replay {
    /// Number of the batch in its stream; `None` stands for all.
    index: Option<u64>,
    stencils: Vec<f32>,
    flights: Vec<FirstFlight>,
    radiance: Vec<f32>,
}

impl Replay {
    fn new(batch: usize) -> Self {
        Self {
            index: None,
            stencils: vec![0.0; batch * STENCIL_VALUES],
            flights: vec![FirstFlight::default(); batch],
            radiance: vec![0.0; batch],
        }
    }

    /// The first samples of a set as every batch.
    pub fn of_set(set: &LabelledSet, batch: usize) -> Self {
        let mut replay = Self::new(batch);
        set.stencils(0, &mut replay.stencils);
        replay.flights.copy_from_slice(&set.flights()[..batch]);
        replay.radiance.copy_from_slice(&set.radiance()[..batch]);
        replay
    }

    fn load(&mut self, index: u64, stream: &mut Stream, control: &Control<'_>) -> Result<(), Error> {
        stream.batch(index, &mut self.stencils, &mut self.flights, &mut self.radiance, control)?;
        self.index = Some(index);
        Ok(())
    }
}

impl SampleSource for Replay {
    fn batch(
        &mut self,
        index: u64,
        batch: Batch<'_>,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        if self.index.is_some_and(|there| there != index) {
            return Err(format!("batch {index} is not the one at hand").into());
        }
        batch.stencils.copy_from_slice(&self.stencils);
        batch.flights.copy_from_slice(&self.flights);
        batch.radiance.copy_from_slice(&self.radiance);
        Ok(())
    }
}
