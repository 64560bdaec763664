//! The third artefact: the labels to print.

use std::time::{Duration, Instant};

use pellucid_predict::Predictor;
use pellucid_refine::{Problem, RefineError, RefineReport, Refinement, Saved, Strategy, SurfaceColor};
use pellucid_voxel::LabelGrid;

use crate::job::Aimed;
use crate::stage::Stage;
use crate::workspace::REFINEMENT;
use crate::{Monitor, PredictorKind, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};

/// A refinement's checkpoint that cannot be read.
fn unusable(workspace: &Workspace, error: RefineError) -> PrintError {
    match error {
        RefineError::Invalid(fault) | RefineError::Unsupported(fault) => {
            workspace.unusable(REFINEMENT, &fault.reason)
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

    fn refine_by<S: Strategy>(
        &self,
        strategy: S,
        predictor: &dyn Predictor,
        aimed: &Aimed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
        colors: impl Fn(&Refinement<'_, S>) -> Option<Vec<[f32; 3]>>,
    ) -> Result<Refined, PrintError> {
        let settings = self.settings.refine.clone();
        let further = aimed.further_aims();
        let problem = Problem { further: &further, ..aimed.problem() };
        let mut labels = aimed.solid.clone();
        let (refined, colors) = monitor.run(Stage::Refine, |control| {
            let mut bound = predictor.bind(aimed.object.clone())?;
            let saved = workspace.load_with(REFINEMENT, |input, length| {
                Saved::read_from(input, length).map_err(|e| unusable(workspace, e))
            })?;
            let mut refinement = match saved {
                Some(saved) => Refinement::resume(problem, strategy, settings, saved, control)?,
                None => Refinement::new(problem, strategy, settings, control)?,
            };
            let mut pace = Pace::default();
            let steps = u64::from(refinement.iterations()) + 1;
            while !refinement.is_finished() {
                let before = u64::from(refinement.iteration());
                let progress = |done: u64, total: u64| {
                    control.report(before * total.max(1) + done, steps * total.max(1));
                };
                refinement.step(&mut labels, &mut *bound, &control.silent().with_progress(&progress))?;
                if refinement.is_finished() || pace.is_due() {
                    pace.keep(|| workspace.save_with(REFINEMENT, |out| refinement.kept().write_to(out)))?;
                }
            }
            let colors = colors(&refinement);
            Ok::<_, PrintError>((refinement.finish(&mut labels, &control.silent())?, colors))
        })?;
        let outside = refined.report.iterations.last().map_or(0, |last| last.outside_training);
        if outside > 0 {
            monitor.warn(&format!(
                "{outside} predictions have coefficients around them that the network was not trained for"
            ));
        }
        Ok(Refined { labels, unrefined: refined.unrefined, report: refined.report, colors })
    }
}
