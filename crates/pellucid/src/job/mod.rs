//! The main job: from a model to a prepared print, in four artefacts that a tool may make, keep or replace one by one.

mod aimed;
mod appearance;
mod clear;
mod judged;
#[cfg(feature = "glb")]
mod model;
#[cfg(feature = "html")]
mod page;
mod placed;
mod prepared;
mod preview;
mod proof_files;
mod refined;
pub(crate) mod sections;
mod slices_proof;
mod spectral;
mod textured;

use std::path::Path;
use std::sync::Arc;

use pellucid_core::team::Alone;
use pellucid_core::{Team, staging};
use pellucid_mesh::Model;
use pellucid_predict::{Identity, InstructionSet, Predictor};
use pellucid_refine::Strategy;
use pellucid_voxel::{LabelGrid, MaterialTable};

use crate::stage::Stage;
use crate::workspace::CHOICE;
use crate::{Monitor, PredictorKind, PrintError, PrintSettings, Record, StrategyKind, Workspace, predictors};

pub(crate) use appearance::MOST_BY_NETWORK;

pub use aimed::{Aimed, FurtherAim, SharedInk};
pub use clear::{ClearParts, ClearReport};
pub use judged::{Judged, LightLook};
pub use placed::Placed;
pub use prepared::{Prepared, own_files};
pub use preview::{Preview, PreviewDetail, PreviewReport};
pub use proof_files::ProofFiles;
pub use refined::Refined;
pub use slices_proof::{SlicesProof, SlicesReport};
pub use textured::{TextureReport, own_texture_files};

/// Prepares prints: settings that were checked once.
///
/// [`PrintJob::prepare`] is [`place`](PrintJob::place), [`aim`](PrintJob::aim), [`refine`](PrintJob::refine) and
/// [`judge`](PrintJob::judge) in a row.
///
/// ```no_run
/// use std::path::Path;
/// use pellucid::{Monitor, PrintJob, PrintSettings, Workspace, mesh};
/// let model = mesh::import_path("model.glb", &mesh::ImportLimits::default())?;
/// let job = PrintJob::new(PrintSettings::default())?;
/// let monitor = Monitor::silent();
/// let prepared = job.prepare(&model, &Workspace::none(), &monitor)?;
/// let report = prepared.write(Path::new("print"), false, &monitor)?;
/// println!("mean dE2000 {:.2}", report.evaluation.refined.voxel.printable.mean);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct PrintJob {
    settings: PrintSettings,
    white: u8,
    /// The label of clear resin, where see-through parts are printed in it.
    clear: Option<u8>,
    /// The materials that colours are made of.
    inks: MaterialTable,
    predictor: Arc<dyn Predictor>,
    /// Who shares out the predictions.
    team: Arc<dyn Team>,
}

impl PrintJob {
    /// Checks settings, and that the printer can print the materials.
    ///
    /// # Errors
    /// [`PrintError`] naming the setting that is out of range, the material that the printer lacks, how many it takes, a
    /// format that cannot be written, or what the predictor was not made for.
    pub fn new(mut settings: PrintSettings) -> Result<Self, PrintError> {
        if settings.clear_from_alpha {
            settings.materials = clear::with_clear(&settings.materials)?;
        }
        let white = settings.check()?;
        let (clear, inks) = match settings.clear_from_alpha {
            true => (settings.materials.label_of(clear::CLEAR), clear::without_clear(&settings.materials)?),
            false => (None, settings.materials.clone()),
        };
        settings.refine.seed = settings.seed;
        if settings.predictor != PredictorKind::Auto {
            settings.spp.get_or_insert(settings.strategy.spp());
        }
        let iterations = match settings.strategy {
            StrategyKind::SurfaceFirst => settings.surface_first.iterations(),
            StrategyKind::Descent => settings.descent.iterations(),
            StrategyKind::SurfaceColor => settings.surface_color.iterations(),
        };
        settings.refine.iterations.get_or_insert(iterations);
        pellucid_slice::check_materials(
            &settings.printer,
            &settings.materials,
            1..=settings.materials.len() as u8,
        )?;
        settings.format.check(&settings.printer)?;
        let team: Arc<dyn Team> = Arc::new(Alone);
        let predictor = predictors::predictor(&settings, &team)?;
        Ok(Self { settings, white, clear, inks, predictor, team })
    }

    /// The same as a member of a team, each of whom does the job with the same settings and model and calls the same
    /// methods in the same order: predictions and gradients are shared out, the rest is done by everyone. Each comes to the
    /// bytes of a job that is done alone. Checkpoints are the first member's: see [`Workspace::of_team`].
    ///
    /// # Errors
    /// None that [`PrintJob::new`] lets through.
    pub fn with_team(mut self, team: Arc<dyn Team>) -> Result<Self, PrintError> {
        self.predictor = predictors::predictor(&self.settings, &team)?;
        self.team = team;
        Ok(self)
    }

    /// Who shares out the predictions.
    pub(crate) fn team(&self) -> &Arc<dyn Team> {
        &self.team
    }

    /// The settings, with what was left to the strategy.
    pub fn settings(&self) -> &PrintSettings {
        &self.settings
    }

    /// What predicts in the refinement, with the derivatives that its strategy follows; the path tracer for
    /// [`PredictorKind::Auto`], which an object has to decide ([`PrintJob::choose`]).
    pub fn predictor(&self) -> &Arc<dyn Predictor> {
        &self.predictor
    }

    /// Tells before any work whether [`Prepared::write`] would refuse the output folder. Changes nothing.
    ///
    /// # Errors
    /// [`PrintError::Staging`] when the folder exists and may not be replaced.
    pub fn check_output(&self, dir: &Path, force: bool) -> Result<(), PrintError> {
        Ok(staging::check(dir, force, &own_files())?)
    }

    /// Does the whole job in memory; `workspace` keeps what is done, in case the process ends early.
    ///
    /// # Errors
    /// [`PrintError`] of the step that failed; [`PrintError::Cancelled`] once the monitor's flag is set.
    pub fn prepare(
        &self,
        model: &Model,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        self.prepare_chosen(self.place(model, monitor)?, workspace, monitor)
    }

    /// [`PrintJob::prepare`] with a predictor of one's own.
    ///
    /// # Errors
    /// As there.
    pub fn prepare_with(
        &self,
        predictor: &dyn Predictor,
        model: &Model,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        self.prepare_placed(predictor, self.place(model, monitor)?, workspace, monitor)
    }

    /// [`PrintJob::prepare`] of voxels that the caller brings: `labels` are solid where they are not air, and
    /// `color` gives the linear RGB (of the texture) of a surface voxel.
    ///
    /// # Errors
    /// As [`PrintJob::place_volume`] and [`PrintJob::prepare`].
    pub fn prepare_volume(
        &self,
        name: &str,
        labels: &LabelGrid,
        color: impl Fn([u32; 3]) -> [f32; 3] + Sync,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        let placed = self.place_volume(name, labels, color, monitor)?;
        self.prepare_chosen(placed, workspace, monitor)
    }

    /// With the settings' predictor, or the one that is ahead on the object.
    fn prepare_chosen(
        &self,
        placed: Placed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        if self.settings.predictor != PredictorKind::Auto {
            return self.prepare_placed(&*self.predictor, placed, workspace, monitor);
        }
        let undecided = Identity::new(PredictorKind::Auto.name(), InstructionSet::chosen(), false);
        workspace.begin(&Record::new(placed.model.clone(), undecided, self.settings.clone()))?;
        let aimed = self.aim(placed, monitor)?;
        let choice = match workspace.load(CHOICE)? {
            Some(bytes) => serde_json::from_slice(&bytes)
                .map_err(|e| workspace.unusable(CHOICE, &pellucid_core::json::plain(&e)))?,
            None => {
                let choice = monitor.run(Stage::Choose, |control| self.choose(&aimed, control))?;
                workspace.save(CHOICE, || Ok(serde_json::json!(choice).to_string().into()))?;
                choice
            }
        };
        let job = Self::new(PrintSettings { predictor: choice.chosen, ..self.settings.clone() })?;
        let job = job.with_team(self.team.clone())?;
        let record = Record::new(aimed.model.clone(), job.predictor.identity(), job.settings.clone());
        let prepared = job.prepare_aimed(&*job.predictor, record, aimed, workspace, monitor)?;
        Ok(Prepared { choice: Some(choice), ..prepared })
    }

    fn prepare_placed(
        &self,
        predictor: &dyn Predictor,
        placed: Placed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        let record = Record::new(placed.model.clone(), predictor.identity(), self.settings.clone());
        workspace.begin(&record)?;
        let aimed = self.aim(placed, monitor)?;
        self.prepare_aimed(predictor, record, aimed, workspace, monitor)
    }

    fn prepare_aimed(
        &self,
        predictor: &dyn Predictor,
        record: Record,
        aimed: Aimed,
        workspace: &Workspace,
        monitor: &Monitor<'_>,
    ) -> Result<Prepared, PrintError> {
        let refined = self.refine_with(predictor, &aimed, workspace, monitor)?;
        let judged = self.judge(&aimed, &refined, workspace, monitor)?;
        Ok(Prepared { record, choice: None, aimed, refined, judged })
    }
}
