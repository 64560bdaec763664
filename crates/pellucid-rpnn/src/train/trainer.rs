//! The state of a training run and its steps.

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

use pellucid_core::Team;
use pellucid_core::team::Alone;

use super::augment::Augment;
use super::engine::Passes;
use super::{Batch, Curve, CurvePoint, Engine, SampleSource, Score, TrainSettings};
use crate::adamw::AdamW;
use crate::variant::{FirstFlight, INPUTS};
use crate::{Inference, RpnnError, Weights};

/// A training run: weights, optimiser and curve. One step after another is a pure function of the
/// settings, the source and the engine, so a run that was stopped goes on as if it had not been.
///
/// ```
/// use pellucid_rpnn::train::{Batch, SampleSource, TrainSettings, Trainer};
/// use pellucid_rpnn::variant::FirstFlight;
/// struct Glow;
/// impl SampleSource for Glow {
///     fn batch(
///         &mut self,
///         index: u64,
///         batch: Batch<'_>,
///     ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
///         batch.stencils.fill(0.1 * index as f32);
///         batch.flights.fill(FirstFlight { masses: [0.2, 0.5, 0.2], ..FirstFlight::default() });
///         batch.radiance.fill(0.5);
///         Ok(())
///     }
/// }
/// let settings = TrainSettings { steps: 3, warm_up: 1, batch: 2, ..Default::default() };
/// let mut trainer = Trainer::new(settings).unwrap();
/// while !trainer.finished() {
///     trainer.step(&mut Glow).unwrap();
/// }
/// assert_eq!(trainer.steps_done(), 3);
/// ```
#[derive(Clone, Debug)]
pub struct Trainer {
    settings: TrainSettings,
    weights: Weights,
    optimiser: AdamW,
    curve: Curve,
    /// Squared errors since the curve's last row, and their batches.
    pending: (f64, u64),
    /// Seconds spent in [`Trainer::run`].
    seconds: f64,
    engine: Engine,
    augment: Augment,
    /// Made by the first step: it takes memory for a whole batch, and a checkpoint's word is not enough for that.
    work: Option<Box<Work>>,
    team: Arc<dyn Team>,
}

/// What a step works with.
#[derive(Clone, Debug)]
struct Work {
    passes: Passes,
    buffers: Buffers,
}

#[derive(Clone, Debug)]
struct Buffers {
    inputs: Vec<f32>,
    flights: Vec<FirstFlight>,
    labels: Vec<f32>,
    outputs: Vec<f32>,
    radiance: Vec<f32>,
    d_radiance: Vec<f32>,
    d_outputs: Vec<f32>,
    gradient: Vec<f32>,
}

impl Work {
    fn new(engine: Engine, settings: &TrainSettings, parameters: usize) -> Result<Self, RpnnError> {
        let (batch, outputs) = (settings.batch, settings.batch * settings.head.outputs());
        let buffers = Buffers {
            inputs: vec![0.0; batch * INPUTS],
            flights: vec![FirstFlight::default(); batch],
            labels: vec![0.0; batch],
            outputs: vec![0.0; outputs],
            radiance: vec![0.0; batch],
            d_radiance: vec![0.0; batch],
            d_outputs: vec![0.0; outputs],
            gradient: vec![0.0; parameters],
        };
        Ok(Self { passes: Passes::new(engine, settings)?, buffers })
    }
}

/// Makes a member's gradient the team's, added up in the order of ranks, and so the squared errors, which go along.
fn all_squares(team: &dyn Team, gradient: &mut [f32], squares: f64) -> f64 {
    if team.size() == 1 {
        return squares;
    }
    let bits = squares.to_bits();
    let halves = [bits as u32, (bits >> 32) as u32].map(f32::from_bits);
    let own = [&*gradient, &halves].concat();
    let mut all = vec![0.0; team.size() * own.len()];
    team.gather(&own, &vec![own.len(); team.size()], &mut all);
    gradient.fill(0.0);
    let mut sum = 0.0;
    for of_member in all.chunks_exact(own.len()) {
        let (values, halves) = of_member.split_at(gradient.len());
        gradient.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        sum += f64::from_bits(u64::from(halves[0].to_bits()) | u64::from(halves[1].to_bits()) << 32);
    }
    sum
}

/// What a checkpoint keeps beside the settings.
pub(super) struct State {
    pub weights: Weights,
    pub optimiser: AdamW,
    pub curve: Curve,
    pub pending: (f64, u64),
    pub seconds: f64,
}

/// What one step did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport {
    /// Steps done, this one included.
    pub step: u64,
    /// Mean squared error of the batch before the step.
    pub loss: f64,
    /// Norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Learning rate.
    pub rate: f64,
}

impl Trainer {
    /// A run from random weights.
    ///
    /// # Errors
    /// As [`TrainSettings::check`].
    pub fn new(settings: TrainSettings) -> Result<Self, RpnnError> {
        settings.check()?;
        let weights = Weights::initial(settings.variant, settings.head, settings.seed, settings.mean_output);
        let optimiser = AdamW::new(settings.optimiser, weights.values());
        let state = State { weights, optimiser, curve: Curve::default(), pending: (0.0, 0), seconds: 0.0 };
        Self::from_state(settings, state)
    }

    pub(super) fn from_state(settings: TrainSettings, state: State) -> Result<Self, RpnnError> {
        settings.check()?;
        let augment = Augment::new(settings.form, settings.mirror, settings.seed);
        let State { weights, optimiser, curve, pending, seconds } = state;
        let trainer = Self {
            settings,
            weights,
            optimiser,
            curve,
            pending,
            seconds,
            engine: Engine::Own,
            augment,
            work: None,
            team: Arc::new(Alone),
        };
        trainer.with_engine(Engine::Own)
    }

    /// The same run as a member of a team, each of whom makes the same steps on its own part of every batch: its source
    /// gives [`Trainer::samples_a_step`] samples, other ones than the other members' do. Gradients are added up in the order
    /// of ranks, so the members' weights stay the same, and a team of as many members comes to the same bytes. The
    /// settings, a checkpoint too, are those of the whole.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when a batch cannot be shared out evenly.
    pub fn with_team(mut self, team: Arc<dyn Team>) -> Result<Self, RpnnError> {
        if !self.settings.batch.is_multiple_of(team.size()) {
            let reason = format!("{} samples cannot be shared by {}", self.settings.batch, team.size());
            return Err(RpnnError::invalid("batch", reason));
        }
        (self.team, self.work) = (team, None);
        Ok(self)
    }

    /// Samples that this member's source gives a step: all of a batch, unless there is a team.
    pub fn samples_a_step(&self) -> usize {
        self.settings.batch / self.team.size()
    }

    /// The same run on another engine. Checkpoints do not name it: a run may be resumed on either.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the engine does not have the settings' precision.
    pub fn with_engine(mut self, engine: Engine) -> Result<Self, RpnnError> {
        Passes::new(engine, &TrainSettings { batch: 1, ..self.settings.clone() })?;
        (self.engine, self.work) = (engine, None);
        Ok(self)
    }

    /// Who computes outputs and gradients; [`Engine::Own`] unless [`Trainer::with_engine`] chose another.
    pub fn engine(&self) -> Engine {
        self.engine
    }

    /// The settings.
    pub fn settings(&self) -> &TrainSettings {
        &self.settings
    }

    /// Changes the run's length; the learning rate follows the new schedule from the next step on.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the warm-up does not fit.
    pub fn set_steps(&mut self, steps: u64) -> Result<(), RpnnError> {
        let settings = TrainSettings { steps, ..self.settings.clone() };
        settings.check()?;
        self.settings = settings;
        Ok(())
    }

    /// Steps done.
    pub fn steps_done(&self) -> u64 {
        self.optimiser.step
    }

    /// True once all steps are done.
    pub fn finished(&self) -> bool {
        self.steps_done() >= self.settings.steps
    }

    /// The weights as they are.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The moving average of the weights: what to predict with.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when training has diverged.
    pub fn averaged(&self) -> Result<Weights, RpnnError> {
        Weights::new(self.settings.variant, self.settings.head, self.optimiser.average.clone())
    }

    /// The optimiser's state.
    pub fn optimiser(&self) -> &AdamW {
        &self.optimiser
    }

    /// Loss and validation so far.
    pub fn curve(&self) -> &Curve {
        &self.curve
    }

    /// Seconds spent in [`Trainer::run`], checkpoints resumed from included.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    pub(super) fn pending(&self) -> (f64, u64) {
        self.pending
    }

    /// One step on the batch whose index is the number of steps done.
    ///
    /// # Errors
    /// [`RpnnError::Source`] when there is no batch, [`RpnnError::Invalid`] when a sample or the gradient is
    /// not finite; the state is as before then.
    pub fn step(&mut self, source: &mut dyn SampleSource) -> Result<StepReport, RpnnError> {
        let mut work = match self.work.take() {
            Some(work) => work,
            None => {
                let own = TrainSettings { batch: self.samples_a_step(), ..self.settings.clone() };
                Box::new(Work::new(self.engine, &own, self.weights.values().len())?)
            }
        };
        let report = self.step_with(&mut work, source);
        self.work = Some(work);
        report
    }

    fn step_with(&mut self, work: &mut Work, source: &mut dyn SampleSource) -> Result<StepReport, RpnnError> {
        let index = self.optimiser.step;
        let Work { passes, buffers: b } = work;
        let (head, radiance) = (self.settings.head, &mut b.labels);
        source
            .batch(index, Batch { stencils: &mut b.inputs, flights: &mut b.flights, radiance })
            .map_err(|source| RpnnError::Source { batch: index, source })?;
        let first = self.team.rank() * b.labels.len();
        self.augment.apply(index, first, &mut b.inputs);
        passes.forward(&self.weights, &b.inputs, &mut b.outputs)?;
        head.radiance(&b.outputs, &b.flights, &mut b.radiance);
        let scale = 2.0 / self.settings.batch as f32;
        let mut squares = 0.0;
        for ((d, out), label) in b.d_radiance.iter_mut().zip(&b.radiance).zip(&b.labels) {
            let difference = out - label;
            squares += f64::from(difference).powi(2);
            *d = scale * difference;
        }
        if !squares.is_finite() {
            return Err(RpnnError::invalid(format!("batch {index}"), "a radiance is not finite"));
        }
        head.derivatives(&b.radiance, &b.d_radiance, &b.flights, &mut b.d_outputs);
        b.gradient.fill(0.0);
        passes.backward(&b.d_outputs, &mut b.gradient)?;
        let loss = all_squares(&*self.team, &mut b.gradient, squares) / self.settings.batch as f64;
        let rate = self.settings.rate(index);
        let gradient_norm = self.optimiser.step(self.weights.values_mut(), &b.gradient, rate)?;
        self.pending = (self.pending.0 + loss, self.pending.1 + 1);
        Ok(StepReport { step: index + 1, loss, gradient_norm, rate })
    }

    /// Adds a row to the curve after the step of `report`.
    pub fn record(&mut self, report: &StepReport, validation: Option<Score>) {
        let (sum, batches) = std::mem::take(&mut self.pending);
        self.curve.points.push(CurvePoint {
            step: report.step,
            samples: report.step * self.settings.batch as u64,
            loss: sum / batches.max(1) as f64,
            rate: report.rate,
            gradient_norm: report.gradient_norm,
            validation,
        });
    }

    /// Error of the averaged weights on raw stencils and first flights (as [`Inference::radiance`] takes them),
    /// predicted by [`Inference`] on either engine.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when lengths do not agree.
    pub fn validate(
        &self,
        stencils: &[f32],
        flights: &[FirstFlight],
        labels: &[f32],
        standard_error: &[f32],
    ) -> Result<Score, RpnnError> {
        let mut out = vec![0.0; labels.len()];
        self.inference()?.radiance(stencils, flights, &mut out)?;
        Score::new(&out, labels, standard_error)
    }

    /// The averaged weights ready to predict, in the run's precision and on its instruction set.
    ///
    /// # Errors
    /// As [`Trainer::averaged`].
    pub fn inference(&self) -> Result<Inference, RpnnError> {
        let s = &self.settings;
        let inference = Inference::new(&self.averaged()?, s.form, s.precision)?;
        match s.instruction_set {
            Some(set) => inference.with_instruction_set(set),
            None => Ok(inference),
        }
    }

    /// Steps until the end or until `after_step` breaks. It is called after every step and may record,
    /// validate and write checkpoints.
    ///
    /// # Errors
    /// As [`Trainer::step`], and what `after_step` returns.
    pub fn run(
        &mut self,
        source: &mut dyn SampleSource,
        mut after_step: impl FnMut(&mut Self, &StepReport) -> Result<ControlFlow<()>, RpnnError>,
    ) -> Result<(), RpnnError> {
        let mut last = Instant::now();
        while !self.finished() {
            let report = self.step(source)?;
            let now = Instant::now();
            self.seconds += (now - last).as_secs_f64();
            last = now;
            if after_step(self, &report)?.is_break() {
                break;
            }
        }
        Ok(())
    }
}
