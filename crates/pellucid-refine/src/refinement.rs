//! The loop: halftone, predict, compare, correct (Rittig et al. 2021, Figure 3), a step at a time.

use std::time::Instant;

use pellucid_core::{Control, ErrorStats};
use pellucid_halftone::BlueNoiseMask;
use pellucid_predict::{BoundPredictor, Changed, Diagnostics, Draw, Learned, Pass};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;

use crate::difference::{differences, lab_of, out_of_gamut};
use crate::halftone::{Changes, halftone};
use crate::layers::Layers;
use crate::problem::shown_in;
use crate::{
    IterationReport, Planned, Problem, RefineError, RefineReport, RefineSettings, Saved, Seen, Setup,
    Strategy, SurfaceSmoother,
};

/// A finished refinement.
#[derive(Debug)]
#[non_exhaustive]
pub struct Refined {
    /// The halftone before the first correction.
    pub unrefined: LabelGrid,
    /// What happened.
    pub report: RefineReport,
}

/// A refinement in progress: made by [`Refinement::new`] or [`Refinement::resume`], moved by [`Refinement::step`],
/// ended by [`Refinement::finish`]; between steps [`Refinement::save`] gives what a later process resumes from.
///
/// Labels follow from the strategy's state, so the value holds none: the caller's labels, solid where the object is,
/// are halftoned anew in each step. A job that was saved and resumed after any step ends with the same labels and
/// errors as one that was not, and neither depends on the number of threads.
pub struct Refinement<'a, S: Strategy> {
    setup: Setup<'a>,
    strategy: S,
    /// With its iterations.
    settings: RefineSettings,
    iterations: u32,
    mask: BlueNoiseMask,
    smoother: SurfaceSmoother,
    target_lab: Vec<[f32; 3]>,
    printable_lab: Vec<[f32; 3]>,
    /// The next iteration, or one past the last.
    iteration: u32,
    /// Of the next iteration; of the last one once all are done.
    state: S::State,
    /// Of the best iteration so far, without history.
    best: Option<S::State>,
    report: RefineReport,
    memory: Learned,
    /// The iteration whose labels the caller and the predictor have, when nothing failed since.
    held: Option<u32>,
    /// Made with the first update.
    tools: Option<S::Tools>,
}

/// What a prediction says of an iterate.
struct Shown {
    radiance: Vec<f32>,
    shown: Vec<[f32; 3]>,
    smoothed: Vec<[f32; 3]>,
    /// Mean of the smoothed differences in each further viewing.
    further: Vec<f64>,
}

impl<'a, S: Strategy> Refinement<'a, S> {
    /// Checks everything and prepares layers, mask and smoothing.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when a setting is out of range or the problem's parts do not fit together;
    /// [`RefineError::Cancelled`].
    pub fn new(
        problem: Problem<'a>,
        strategy: S,
        mut settings: RefineSettings,
        control: &Control<'_>,
    ) -> Result<Self, RefineError> {
        settings.check()?;
        strategy.check()?;
        let iterations = *settings.iterations.get_or_insert_with(|| strategy.iterations());
        problem.check(settings.coloured_depth_mm)?;
        let surface = problem.object.surface();
        let control = &control.silent();
        let layers =
            Layers::find(settings.coloured_depth_mm, settings.layers, surface, problem.nearest, control)?;
        let mask = BlueNoiseMask::new(surface.frame().pitch(), settings.seed, control)?;
        let smoother = SurfaceSmoother::new(surface, settings.residual_blur_mm, control)?;
        let (target_lab, printable_lab) = (lab_of(problem.target), lab_of(problem.printable_target));
        let report = RefineReport {
            strategy: strategy.name().to_owned(),
            surface_voxels: surface.len() as u64,
            out_of_gamut: out_of_gamut(&target_lab, &printable_lab),
            ..RefineReport::default()
        };
        let points = problem.object.points();
        let setup = Setup { problem, layers, points, seed: settings.seed, iterations };
        let state = strategy.start(&setup);
        Ok(Self {
            setup,
            strategy,
            settings,
            iterations,
            mask,
            smoother,
            target_lab,
            printable_lab,
            iteration: 0,
            state,
            best: None,
            report,
            memory: Learned::default(),
            held: None,
            tools: None,
        })
    }

    /// Goes on where [`Refinement::save`] was called, with a solid grid of any labels and a newly bound predictor.
    ///
    /// # Errors
    /// As [`Refinement::new`]; [`RefineError::Invalid`] naming the difference when the saved value is of another object,
    /// other targets, viewing or inks, another strategy or other settings, or damaged.
    pub fn resume(
        problem: Problem<'a>,
        strategy: S,
        settings: RefineSettings,
        saved: Saved<S::State>,
        control: &Control<'_>,
    ) -> Result<Self, RefineError> {
        let mut refinement = Self::new(problem, strategy, settings, control)?;
        refinement.check_saved(&saved)?;
        refinement.iteration = saved.iteration;
        refinement.state = saved.state;
        refinement.best = saved.best;
        refinement.report = saved.report;
        refinement.memory = saved.memory;
        Ok(refinement)
    }

    /// The same for a part of a print that begins at its layer `first`: with the halftone's thresholds as the whole print
    /// has them there.
    pub fn from_layer(self, first: u32) -> Self {
        Self { mask: self.mask.from_layer(first), ..self }
    }

    /// The next iteration; one more than [`RefineSettings::iterations`] when all are done.
    pub fn iteration(&self) -> u32 {
        self.iteration
    }

    /// How many iterations there are at most after the unrefined halftone.
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// True when all iterations are done, or the strategy has settled.
    pub fn is_finished(&self) -> bool {
        self.iteration > self.iterations || self.report.settled
    }

    /// What happened so far.
    pub fn report(&self) -> &RefineReport {
        &self.report
    }

    /// What stays: problem, layers, points.
    pub fn setup(&self) -> &Setup<'a> {
        &self.setup
    }

    /// The state of the next iteration.
    pub fn state(&self) -> &S::State {
        &self.state
    }

    /// The state of the best iteration so far, [without history](Strategy::without_history); `None` before the first.
    pub fn best_state(&self) -> Option<&S::State> {
        self.best.as_ref()
    }

    /// What [`Refinement::resume`] needs.
    pub fn save(&self) -> Saved<S::State> {
        self.kept().map(S::State::clone)
    }

    /// The same without a copy of the states, to be written.
    pub fn kept(&self) -> Saved<&S::State> {
        let settings = self.strategy.settings();
        Saved {
            strategy: self.strategy.name().to_owned(),
            strategy_settings: settings.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
            settings: self.settings.clone(),
            object: self.setup.problem.object.id().0,
            colors: self.setup.problem.colors_digest(),
            iteration: self.iteration,
            state: &self.state,
            best: self.best.as_ref(),
            report: self.report.clone(),
            memory: self.memory.clone(),
        }
    }

    /// One iteration: halftones `labels`, predicts every surface voxel, and, unless it is the last iteration, moves the
    /// state. Iteration 0 is the unrefined halftone. Progress counts over all iterations.
    ///
    /// `labels` are solid where the object is; those within the coloured depth are replaced, deeper ones stay. Hand over
    /// the same labels and the same predictor in each step: the predictor is told which tiles changed since the last.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when all iterations are done, the labels lie in another frame, or a prediction is not
    /// finite; [`RefineError::Predict`]; [`RefineError::Cancelled`]. The refinement is then as it was before the step,
    /// which may be repeated with the same result. The labels may be a mixture by tiles of what they were and of this
    /// iteration's halftone: printable, but of no one iterate. The next step, or [`Refinement::finish`], halftones them
    /// anew.
    pub fn step(
        &mut self,
        labels: &mut LabelGrid,
        bound: &mut dyn BoundPredictor,
        control: &Control<'_>,
    ) -> Result<&IterationReport, RefineError> {
        if self.is_finished() {
            return Err(RefineError::invalid("step", "all iterations are done; finish the refinement"));
        }
        self.check_labels(labels)?;
        let held = self.held.take();
        let (iteration, draw) = (self.iteration, self.draw(self.iteration));

        let start = Instant::now();
        let Planned { mixtures, overflow } =
            self.strategy.mixtures(&self.setup, &self.state, &control.silent())?;
        let changes = halftone(labels, mixtures.as_ref(), &self.setup, &self.mask, control)?;
        drop(mixtures);
        let halftone_seconds = start.elapsed().as_secs_f64();

        let start = Instant::now();
        let changed = held.map_or(Changed::Unknown, |_| Changed::Tiles(&changes.tiles));
        let (radiance, diagnostics) = self.predict(labels, changed, bound, control)?;
        let predict_seconds = start.elapsed().as_secs_f64();
        let shown = self.compare(radiance, &control.silent())?;
        let mut report = self.errors(&shown);
        (report.halftone_seconds, report.predict_seconds) = (halftone_seconds, predict_seconds);
        report.count(&changes, &diagnostics);

        let start = Instant::now();
        let planned = if iteration < self.iterations {
            let control = &control.silent();
            let tools = match &mut self.tools {
                Some(tools) => &*tools,
                none => none.insert(self.strategy.tools(&self.setup, &self.smoother, control)?),
            };
            let seen = Seen {
                iteration,
                radiance: &shown.radiance,
                shown: &shown.shown,
                smoothed: &shown.smoothed,
                smoother: &self.smoother,
                overflow: &overflow,
                labels,
                bound: &*bound,
                draw,
            };
            Some(self.strategy.plan(&self.setup, tools, &self.state, &seen, control)?)
        } else {
            None
        };
        // The last that can fail: a pass is taken in once, and what follows completes the step.
        bound.absorb(&diagnostics.learned).map_err(|e| RefineError::predict(iteration, e))?;
        self.memory = bound.memory();
        let better = self.report.best_iteration().is_none_or(|best| report.off() < best.off());
        if better {
            self.report.best = iteration;
            self.best = Some(self.strategy.without_history(&self.state));
        }
        if let (Some(step), Some(tools)) = (planned, &self.tools) {
            let moved = self.strategy.take(&self.setup, tools, &mut self.state, step);
            (report.loss, report.noise, report.step) = (moved.loss, moved.noise, moved.step);
            self.report.settled = moved.settled;
        }
        report.update_seconds = start.elapsed().as_secs_f64();
        self.held = Some(iteration);
        self.iteration += 1;
        self.report.iterations.push(report);
        Ok(&self.report.iterations[iteration as usize])
    }

    /// Ends the refinement: `labels`, those of the last step or any solid ones, become the best iterate's. May be called
    /// after any step.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] before the first step or when the labels lie in another frame;
    /// [`RefineError::Cancelled`]: the labels may then be a mixture by tiles of two iterates.
    pub fn finish(self, labels: &mut LabelGrid, control: &Control<'_>) -> Result<Refined, RefineError> {
        self.check_labels(labels)?;
        let Some(best) = &self.best else {
            return Err(RefineError::invalid("finish", "no iteration is done yet"));
        };
        // The last prediction judged the last labels; an earlier best is halftoned again.
        if self.held != Some(self.report.best) {
            self.halftone(best, labels, control)?;
        }
        let unrefined = self.unrefined(labels, control)?;
        Ok(Refined { unrefined, report: self.report })
    }

    /// The halftone before the first correction: the labels of iteration 0, on top of `labels`.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when the labels lie in another frame; [`RefineError::Cancelled`].
    pub fn unrefined(&self, labels: &LabelGrid, control: &Control<'_>) -> Result<LabelGrid, RefineError> {
        self.check_labels(labels)?;
        let mut unrefined = labels.clone();
        self.halftone(&self.strategy.start(&self.setup), &mut unrefined, control)?;
        Ok(unrefined)
    }

    fn halftone(
        &self,
        state: &S::State,
        labels: &mut LabelGrid,
        control: &Control<'_>,
    ) -> Result<(), RefineError> {
        let control = &control.silent();
        let planned = self.strategy.mixtures(&self.setup, state, control)?;
        halftone(labels, planned.mixtures.as_ref(), &self.setup, &self.mask, control)?;
        Ok(())
    }

    fn draw(&self, iteration: u32) -> Draw {
        Draw::new(self.settings.seed, Pass::Loop(iteration)).with_effort(self.strategy.effort(&self.state))
    }

    fn predict(
        &self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        bound: &mut dyn BoundPredictor,
        control: &Control<'_>,
    ) -> Result<(Vec<f32>, Diagnostics), RefineError> {
        let iteration = self.iteration;
        let failed = |e| RefineError::predict(iteration, e);
        let (done, steps) = (u64::from(iteration), u64::from(self.iterations) + 1);
        let progress =
            |part: u64, total: u64| control.report(done * total.max(1) + part, steps * total.max(1));
        if !self.memory.is_empty() {
            bound.absorb(&self.memory).map_err(failed)?;
        }
        bound.update(labels, changed, &control.silent()).map_err(failed)?;
        let mut radiance = vec![0.0f32; self.setup.points.len() * self.setup.problem.viewing.channels()];
        let control = control.silent().with_progress(&progress);
        let diagnostics = bound
            .predict(&self.setup.points, self.draw(iteration), &mut radiance, &control)
            .map_err(failed)?;
        if radiance.par_iter().any(|v| !v.is_finite()) {
            return Err(RefineError::invalid("prediction", "a radiance is not finite"));
        }
        Ok((radiance, diagnostics))
    }

    fn compare(&self, radiance: Vec<f32>, control: &Control<'_>) -> Result<Shown, RefineError> {
        let Problem { viewing, printable_target, further, .. } = self.setup.problem;
        let shown = shown_in(viewing, &radiance);
        let smoothed = self.smoothed(printable_target, &shown, control)?;
        let further = further.iter().map(|aim| {
            let smoothed = self.smoothed(aim.printable_target, &shown_in(aim.viewing, &radiance), control)?;
            let off = differences(&lab_of(&smoothed), &lab_of(aim.printable_target));
            Ok(ErrorStats::of(off).mean)
        });
        let further = further.collect::<Result<_, RefineError>>()?;
        Ok(Shown { radiance, shown, smoothed, further })
    }

    /// A target less what is lacking of it, smoothed: as light adds up, since the cube root of a few paths' mean is biased
    /// far down.
    fn smoothed(
        &self,
        target: &[[f32; 3]],
        shown: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, RefineError> {
        let shortfall = target.par_iter().zip(shown);
        let shortfall = shortfall.map(|(t, s)| std::array::from_fn(|c| t[c] - s[c])).collect();
        let mut smoothed = self.smoother.smooth(shortfall, control)?;
        smoothed.par_iter_mut().zip(target).for_each(|(s, t)| {
            *s = std::array::from_fn(|c| (t[c] - s[c]).max(0.0));
        });
        Ok(smoothed)
    }

    fn errors(&self, shown: &Shown) -> IterationReport {
        let lab = lab_of(&shown.shown);
        let against = |lab: &[[f32; 3]], to: &[[f32; 3]]| ErrorStats::of(differences(lab, to));
        IterationReport {
            iteration: self.iteration,
            target: against(&lab, &self.target_lab),
            printable_target: against(&lab, &self.printable_lab),
            smoothed: against(&lab_of(&shown.smoothed), &self.printable_lab),
            further: shown.further.clone(),
            ..IterationReport::default()
        }
    }

    fn check_labels(&self, labels: &LabelGrid) -> Result<(), RefineError> {
        if labels.frame() == self.setup.problem.object.frame() {
            return Ok(());
        }
        Err(RefineError::invalid("labels", "lie in another frame than the object's surface"))
    }

    fn check_saved(&self, saved: &Saved<S::State>) -> Result<(), RefineError> {
        let differs = |what: &str| {
            Err(RefineError::invalid(
                "checkpoint",
                format!("is of {what}; resume with its own, or begin anew"),
            ))
        };
        let own = self.kept();
        if saved.strategy != own.strategy {
            return differs(&format!("the strategy {:?}, not {:?}", saved.strategy, own.strategy));
        }
        if saved.strategy_settings != own.strategy_settings {
            let (there, here) = (&saved.strategy_settings, &own.strategy_settings);
            return differs(&format!("other settings of the strategy, {there:?} instead of {here:?}"));
        }
        if saved.settings != own.settings {
            return differs(&format!("other settings, {:?} instead of {:?}", saved.settings, own.settings));
        }
        if saved.object != own.object {
            return differs("another object or other materials");
        }
        if saved.colors != own.colors {
            return differs("other targets, viewing or inks");
        }
        let iterations = &saved.report.iterations;
        let whole = saved.iteration <= self.iterations + 1
            && iterations.len() == saved.iteration as usize
            && iterations.iter().zip(0..).all(|(report, i)| report.iteration == i)
            && saved.best.is_some() == (saved.iteration > 0)
            && (saved.iteration == 0 || saved.report.best < saved.iteration);
        if !whole {
            return Err(RefineError::invalid("checkpoint", "its iterations contradict each other"));
        }
        self.strategy.check_state(&self.setup, &saved.state)?;
        saved.best.iter().try_for_each(|state| self.strategy.check_best(&self.setup, state))
    }
}

impl IterationReport {
    fn count(&mut self, changes: &Changes, diagnostics: &Diagnostics) {
        self.label_flips = changes.voxels;
        self.changed_tiles = changes.tiles.len() as u64;
        self.outside_training = diagnostics.outside_training;
        self.paths = diagnostics.paths;
    }
}

/// Rearranges the materials of `labels` until their predicted appearance comes close to the printable target: all steps
/// of a [`Refinement`] in a row. On success `labels` hold the iterate with the least smoothed mean CIEDE2000.
///
/// # Errors
/// As [`Refinement::new`], [`Refinement::step`] and [`Refinement::finish`]; what `labels` hold then is said there.
pub fn refine<S: Strategy>(
    labels: &mut LabelGrid,
    problem: Problem<'_>,
    strategy: S,
    settings: RefineSettings,
    bound: &mut dyn BoundPredictor,
    control: &Control<'_>,
) -> Result<Refined, RefineError> {
    let mut refinement = Refinement::new(problem, strategy, settings, control)?;
    while !refinement.is_finished() {
        refinement.step(labels, bound, control)?;
    }
    refinement.finish(labels, control)
}
