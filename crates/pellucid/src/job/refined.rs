//! The third artefact: the labels to print.

use std::time::{Duration, Instant};

use pellucid_core::Control;
use pellucid_predict::Predictor;
use pellucid_refine::{
    Problem, RefineError, RefineReport, RefineSettings, Refinement, Saved, Strategy, SurfaceColor,
};
use pellucid_voxel::LabelGrid;

use crate::job::Aimed;
use crate::job::sections::Section;
use crate::stage::Stage;
use crate::workspace::{REFINEMENT, section_of_refinement};
use crate::{Monitor, PredictorKind, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};

/// A refinement's checkpoint that cannot be read.
fn unusable(workspace: &Workspace, name: &str, error: RefineError) -> PrintError {
    match error {
        RefineError::Invalid(fault) | RefineError::Unsupported(fault) => {
            workspace.unusable(name, &fault.reason)
        }
        other => other.into(),
    }
}

/// Refined labels.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Refined {
    /// The labels to print.
    pub labels: LabelGrid,
    /// The halftone before refinement.
    pub unrefined: LabelGrid,
    /// What happened.
    pub report: RefineReport,
    /// The colours asked of the printer, linear RGB relative to its white, one a surface voxel: of
    /// [`StrategyKind::SurfaceColor`] alone.
    pub colors: Option<Vec<[f32; 3]>>,
}

/// A twentieth of the time at most goes into keeping what is done.
const KEEPING: u32 = 20;

/// When it is time to keep what is done.
#[derive(Default)]
struct Pace {
    /// When it was last kept, and how long that took.
    last: Option<(Instant, Duration)>,
}

impl Pace {
    fn is_due(&self) -> bool {
        self.last.is_none_or(|(at, took)| at.elapsed() >= KEEPING * took)
    }

    fn keep<E>(&mut self, keep: impl FnOnce() -> Result<(), E>) -> Result<(), E> {
        let start = Instant::now();
        keep()?;
        self.last = Some((Instant::now(), start.elapsed()));
        Ok(())
    }
}

impl PrintJob {
    /// Rearranges materials until the predicted appearance comes close to the target. The state is kept in
    /// `workspace` after iterations, so often that little is lost and little time spent, and taken up from there.
    ///
    /// # Errors
    /// [`PrintError::Refine`], [`PrintError::Predict`], [`PrintError::Io`] when a checkpoint cannot be written,
    /// [`PrintError::Cancelled`].
    pub fn refine(
        &self,
        aimed: &Aimed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Refined, PrintError> {
        if self.settings.predictor == PredictorKind::Auto {
            let chosen = monitor.run(Stage::Choose, |control| self.choose(aimed, control))?.chosen;
            let settings = PrintSettings { predictor: chosen, ..self.settings.clone() };
            return Self::new(settings)?.with_team(self.team.clone())?.refine(aimed, workspace, monitor);
        }
        self.refine_with(&*self.predictor, aimed, workspace, monitor)
    }

    /// [`PrintJob::refine`] with a predictor of one's own.
    ///
    /// # Errors
    /// As there.
    pub fn refine_with(
        &self,
        predictor: &dyn Predictor,
        aimed: &Aimed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Refined, PrintError> {
        match self.settings.strategy {
            StrategyKind::SurfaceFirst => {
                let strategy = self.settings.surface_first.clone();
                self.refine_by(strategy, predictor, aimed, workspace, monitor, |_| None)
            }
            StrategyKind::Descent => {
                let strategy = self.settings.descent.clone();
                self.refine_by(strategy, predictor, aimed, workspace, monitor, |_| None)
            }
            StrategyKind::SurfaceColor => {
                let strategy = self.settings.surface_color.clone();
                self.refine_by(strategy, predictor, aimed, workspace, monitor, |refinement| {
                    Some(SurfaceColor::colors(refinement.setup(), refinement.best_state()?))
                })
            }
        }
    }

    fn refine_by<S: Strategy + Clone>(
        &self,
        strategy: S,
        predictor: &dyn Predictor,
        aimed: &Aimed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
        colors: impl Fn(&Refinement<'_, S>) -> Option<Vec<[f32; 3]>>,
    ) -> Result<Refined, PrintError> {
        let run = Run { settings: &self.settings.refine, strategy, predictor, workspace, colors };
        let refined = monitor.run(Stage::Refine, |control| match self.sections(aimed) {
            None => run.part(aimed, REFINEMENT, 0, control),
            Some(sections) => run.sections(aimed, &sections, control),
        })?;
        let outside = refined.report.iterations.last().map_or(0, |last| last.outside_training);
        if outside > 0 {
            monitor.warn(&format!(
                "{outside} predictions have coefficients around them that the network was not trained for"
            ));
        }
        Ok(refined)
    }
}

/// How a print is refined, or its sections are.
struct Run<'r, S, C> {
    settings: &'r RefineSettings,
    strategy: S,
    predictor: &'r dyn Predictor,
    workspace: &'r Workspace,
    /// Colours that the strategy asks of the printer.
    colors: C,
}

impl<S: Strategy + Clone, C: Fn(&Refinement<'_, S>) -> Option<Vec<[f32; 3]>>> Run<'_, S, C> {
    /// Sections from the bottom up: what is decided on below stays, what is above comes later.
    fn sections(
        &self,
        aimed: &Aimed,
        sections: &[Section],
        control: &Control<'_>,
    ) -> Result<Refined, PrintError> {
        let all: u64 = sections.iter().map(|s| s.points.len() as u64).sum();
        let (mut labels, mut unrefined) = (aimed.solid.clone(), aimed.solid.clone());
        let (mut reports, mut colors) = (Vec::new(), None);
        let mut before = 0;
        for (i, section) in sections.iter().enumerate() {
            let count = section.points.len() as u64;
            let progress = |done: u64, total: u64| {
                let part = u128::from(count) * u128::from(done) / u128::from(total.max(1));
                control.report(before + part as u64, all);
            };
            let control = control.silent().with_progress(&progress);
            let depth_mm = self.settings.coloured_depth_mm;
            let part = aimed.section(section, depth_mm, &labels, &control.silent())?;
            let refined = self.part(&part, &section_of_refinement(i), section.z.start, &control)?;
            section.put_into(&mut labels, &refined.labels, &part.nearest);
            section.put_into(&mut unrefined, &refined.unrefined, &part.nearest);
            if let Some(own) = &refined.colors {
                colors.get_or_insert_with(Vec::new).extend_from_slice(section.kept_of(own));
            }
            reports.push(refined.report);
            before += count;
        }
        let report = RefineReport::of_sections(reports, &aimed.target, &aimed.printable_target);
        Ok(Refined { labels, unrefined, report, colors })
    }

    /// What is aimed at as a whole, from layer `first` of the print on.
    fn part(
        &self,
        aimed: &Aimed,
        checkpoint: &str,
        first: u32,
        control: &Control<'_>,
    ) -> Result<Refined, PrintError> {
        let further = aimed.further_aims();
        let problem = Problem { further: &further, ..aimed.problem() };
        let (strategy, settings) = (self.strategy.clone(), self.settings.clone());
        let mut labels = aimed.solid.clone();
        let mut bound = self.predictor.bind(aimed.object.clone())?;
        let saved = self.workspace.load_with(checkpoint, |input, length| {
            Saved::read_from(input, length).map_err(|e| unusable(self.workspace, checkpoint, e))
        })?;
        let refinement = match saved {
            Some(saved) => Refinement::resume(problem, strategy, settings, saved, control)?,
            None => Refinement::new(problem, strategy, settings, control)?,
        };
        let mut refinement = refinement.from_layer(first);
        let mut pace = Pace::default();
        let steps = u64::from(refinement.iterations()) + 1;
        while !refinement.is_finished() {
            let before = u64::from(refinement.iteration());
            let progress = |done: u64, total: u64| {
                control.report(before * total.max(1) + done, steps * total.max(1));
            };
            refinement.step(&mut labels, &mut *bound, &control.silent().with_progress(&progress))?;
            if refinement.is_finished() || pace.is_due() {
                pace.keep(|| self.workspace.save_with(checkpoint, |out| refinement.kept().write_to(out)))?;
            }
        }
        let colors = (self.colors)(&refinement);
        let pellucid_refine::Refined { unrefined, report, .. } =
            refinement.finish(&mut labels, &control.silent())?;
        Ok(Refined { labels, unrefined, report, colors })
    }
}
