//! A training run: validation, checkpoints, and a length fitted to the time there is.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use crate::{LabelledSet, Stream};
use pellucid_core::{Control, FileError};
use pellucid_rpnn::file::{Provenance, save};
use pellucid_rpnn::train::trainer::StepReport;
use pellucid_rpnn::train::{Batch, SampleSource, Score, Trainer};

use super::TrainingError;

/// The state to go on from, in a run's folder.
pub const STATE_FILE: &str = "run.safetensors";
/// The weights, in a run's folder.
pub const WEIGHTS_FILE: &str = "weights.safetensors";
/// The loss curve, in a run's folder.
pub const CURVE_FILE: &str = "curve.csv";
/// Steps of a run whose length is fitted to [`RunSettings::minutes`], until its speed is known.
pub const UNPLANNED_STEPS: u64 = 1 << 20;

/// Steps between rows of the loss curve.
const RECORD: u64 = 100;
/// Steps between validations at the start of a run; later every checkpoint validates.
const FIRST_VALIDATIONS: [u64; 4] = [250, 500, 1000, 2000];
/// Samples that a validation predicts at a time: 10 MB of stencils.
const CHUNK: usize = 1024;

/// Where a run is kept and how long it takes.
#[derive(Clone, Debug, PartialEq)]
pub struct RunSettings {
    /// Folder for [`WEIGHTS_FILE`], [`STATE_FILE`] and [`CURVE_FILE`]; made where there is none.
    pub folder: PathBuf,
    /// Time between checkpoints.
    pub checkpoint: Duration,
    /// Minutes that the run takes from now on; its number of steps is fitted to them at every checkpoint until two
    /// thirds have passed. The trainer's own number of steps without it.
    pub minutes: Option<f64>,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All steps are done.
    Finished,
    /// The caller asked it to stop; the folder holds the state after the last whole step.
    Stopped,
}

/// Trains to the end, or until `control` is cancelled, and writes the folder at every checkpoint and at the end.
///
/// `provenance` says what the weights are trained for when they are written; `watch` is told every validation's score
/// with the mean number of steps a second so far. Progress counts steps.
///
/// # Errors
/// [`TrainingError`] of the stream, the trainer, the validation or a file; never [`TrainingError::Cancelled`].
pub fn run(
    trainer: &mut Trainer,
    stream: Stream,
    validation: Option<&LabelledSet>,
    settings: &RunSettings,
    provenance: &dyn Fn(&Trainer) -> Result<Provenance, TrainingError>,
    watch: &mut dyn FnMut(&Trainer, &Score, f64),
    control: &Control<'_>,
) -> Result<Outcome, TrainingError> {
    let folder = &settings.folder;
    std::fs::create_dir_all(folder).map_err(FileError::at("create", folder))?;
    let mut run = Run {
        settings,
        validation,
        provenance,
        watch,
        control,
        start: Instant::now(),
        saved: Instant::now(),
        first_step: trainer.steps_done(),
    };
    let mut failure = None;
    let mut source = Source { stream, control: control.silent() };
    let done = trainer.run(&mut source, |trainer, report| match run.after_step(trainer, report) {
        Ok(flow) => Ok(flow),
        Err(error) => {
            failure = Some(error);
            Ok(ControlFlow::Break(()))
        }
    });
    if control.cancelled() {
        run.write(trainer)?;
        return Ok(Outcome::Stopped);
    }
    if let Some(failure) = failure {
        return Err(failure);
    }
    done?;
    Ok(Outcome::Finished)
}

/// Trains to the end as one of the other members of a team ([`Trainer::with_team`]), whose first one is in [`run`]: that one
/// keeps the run and validates.
///
/// # Errors
/// [`TrainingError`] of the stream or the trainer.
pub fn follow(trainer: &mut Trainer, stream: Stream, control: &Control<'_>) -> Result<(), TrainingError> {
    let mut source = Source { stream, control: control.silent() };
    Ok(trainer.run(&mut source, |_, _| Ok(ControlFlow::Continue(())))?)
}

/// Error of a trainer's averaged weights on a labelled set.
///
/// # Errors
/// [`TrainingError::Rpnn`], [`TrainingError::Cancelled`].
pub fn validate(
    trainer: &Trainer,
    labels: &LabelledSet,
    control: &Control<'_>,
) -> Result<Score, TrainingError> {
    let mut inference = trainer.inference()?;
    let predicted = labels.predictions(CHUNK, &control.silent(), |stencils, flights, out| {
        Ok::<_, TrainingError>(inference.radiance(stencils, flights, out)?)
    })?;
    Ok(Score::new(&predicted, labels.radiance(), labels.std_error())?)
}

struct Run<'a> {
    settings: &'a RunSettings,
    validation: Option<&'a LabelledSet>,
    provenance: &'a dyn Fn(&Trainer) -> Result<Provenance, TrainingError>,
    watch: &'a mut dyn FnMut(&Trainer, &Score, f64),
    control: &'a Control<'a>,
    start: Instant,
    saved: Instant,
    first_step: u64,
}

impl Run<'_> {
    fn after_step(
        &mut self,
        trainer: &mut Trainer,
        report: &StepReport,
    ) -> Result<ControlFlow<()>, TrainingError> {
        if self.control.cancelled() {
            return Ok(ControlFlow::Break(()));
        }
        self.control.report(report.step, trainer.settings().steps);
        let due = self.saved.elapsed() >= self.settings.checkpoint || trainer.finished();
        let validates = due || FIRST_VALIDATIONS.contains(&report.step);
        if !validates && !report.step.is_multiple_of(RECORD) {
            return Ok(ControlFlow::Continue(()));
        }
        let score = match self.validation.filter(|_| validates) {
            None => None,
            Some(set) => match validate(trainer, set, self.control) {
                Err(TrainingError::Cancelled) => return Ok(ControlFlow::Break(())),
                score => Some(score?),
            },
        };
        trainer.record(report, score);
        let (passed, steps) = (self.start.elapsed().as_secs_f64(), trainer.steps_done() - self.first_step);
        if due {
            self.saved = Instant::now();
            if let Some(minutes) = self.settings.minutes {
                let s = trainer.settings();
                let planned =
                    fitted_steps(trainer.steps_done(), steps, passed, 60.0 * minutes, s.steps, s.warm_up);
                planned.map_or(Ok(()), |planned| trainer.set_steps(planned))?;
            }
            self.write(trainer)?;
        }
        if let Some(score) = score {
            (self.watch)(trainer, &score, steps as f64 / passed);
        }
        Ok(ControlFlow::Continue(()))
    }

    fn write(&self, trainer: &Trainer) -> Result<(), TrainingError> {
        let folder = &self.settings.folder;
        trainer.save(&folder.join(STATE_FILE))?;
        trainer.curve().write_csv(&folder.join(CURVE_FILE))?;
        save(&folder.join(WEIGHTS_FILE), &trainer.averaged()?, &(self.provenance)(trainer)?)?;
        Ok(())
    }
}

/// Steps of a run of `whole` seconds that did `recent` steps, the last of them step `done`, in the `passed` seconds since
/// it started. Nothing once the run is done or in its last third, where the length stays as it is so that the learning
/// rate comes to rest.
fn fitted_steps(done: u64, recent: u64, passed: f64, whole: f64, planned: u64, warm_up: u64) -> Option<u64> {
    if done >= planned || passed > 0.67 * whole && planned < UNPLANNED_STEPS {
        return None;
    }
    let left = (whole - passed).max(0.0) * recent as f64 / passed;
    Some(done + (left as u64).max(1).max((warm_up + 1).saturating_sub(done)))
}

struct Source<'a> {
    stream: Stream,
    control: Control<'a>,
}

impl SampleSource for Source<'_> {
    fn batch(
        &mut self,
        index: u64,
        batch: Batch<'_>,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(self.stream.batch(index, batch.stencils, batch.flights, batch.radiance, &self.control)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_runs_length_follows_its_speed_and_comes_to_rest() {
        // 100 steps in a minute of ten: 900 more.
        assert_eq!(fitted_steps(100, 100, 60.0, 600.0, UNPLANNED_STEPS, 20), Some(1000));
        // Resumed at step 5000, at the same speed.
        assert_eq!(fitted_steps(5100, 100, 60.0, 600.0, UNPLANNED_STEPS, 20), Some(6000));
        assert_eq!(fitted_steps(700, 700, 420.0, 600.0, 1000, 20), None, "the last third");
        assert_eq!(fitted_steps(700, 700, 420.0, 600.0, UNPLANNED_STEPS, 20), Some(1000), "never planned");
        assert_eq!(fitted_steps(1000, 700, 60.0, 600.0, 1000, 20), None, "done");
        assert_eq!(fitted_steps(5, 5, 900.0, 600.0, UNPLANNED_STEPS, 200), Some(201), "the warm-up fits");
    }
}
