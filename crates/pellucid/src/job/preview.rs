//! What a model will look like before anything is refined, within seconds.

use std::path::Path;

use pellucid_core::staging::{self, OwnFiles, StagedDir};
use pellucid_core::{Control, ErrorStats};
use pellucid_mesh::{MeshReport, Model, Placement};
use pellucid_proof::{Proof, View};
use pellucid_refine::{ErrorShares, Judge, JudgeInput};
use pellucid_voxel::{LabelGrid, Pitch};
use serde::{Deserialize, Serialize};

use crate::job::aimed::ColorTables;
use crate::job::appearance::{Appearance, pictured};
use crate::job::prepared::write_json;
use crate::job::{Aimed, ProofFiles};
use crate::report::{PictureError, StageTime, Thinness};
use crate::stage::Stage;
use crate::{Monitor, PrintError, PrintJob, PrintSettings, Record};

/// The report, in a preview's folder.
pub(super) const PREVIEW_FILE: &str = "preview.json";
/// Edges of the first, coarse voxels are the least multiples of the printer's that are at least so long, in mm.
const COARSE_MM: f64 = 0.16;
/// Prints whose box has fewer voxels are done before a coarse one would be of use.
const SMALL_VOXELS: f64 = 4e6;
/// Surface voxels at which the shown colours are compared with many paths, and how many: a third of a second.
const COMPARED: u32 = 200;
const COMPARED_SPP: u32 = 128;

/// How exact a preview is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PreviewDetail {
    /// By voxels several times the printer's.
    Coarse,
    /// By the printer's own voxels.
    Full,
}

/// A model as it would look without refinement. Colours are linear RGB relative to the print's white.
#[non_exhaustive]
pub struct Preview {
    /// Settings, model and predictor.
    pub record: Record,
    /// How exact it is.
    pub detail: PreviewDetail,
    /// Object and targets, in voxels of `detail`.
    pub aimed: Aimed,
    /// The halftone of the texture as it is.
    pub unrefined: LabelGrid,
    /// What that looks like, at each surface voxel.
    pub appearance: Vec<[f32; 3]>,
    /// How far that is off what many paths say.
    pub picture: PictureError,
    /// Where it is off the target as given, over 0.1 mm: CIEDE2000 in parts, out of gamut, too thin, cross-talk.
    pub error_parts: Vec<[f32; 3]>,
    /// Share of the surface whose colour cannot be printed there.
    pub out_of_gamut: f64,
}

/// What a preview reports, written as `preview.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct PreviewReport {
    /// Settings, model and predictor.
    pub record: Record,
    /// How exact it is.
    pub detail: PreviewDetail,
    /// Edges of its voxels in mm.
    pub pitch_mm: [f64; 3],
    /// Linear RGB radiance that media-relative 1 stands for.
    pub media_white: [f32; 3],
    /// Object size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// Surface voxels.
    pub surface_voxels: u64,
    /// The model's mesh.
    pub mesh: Option<MeshReport>,
    /// Thin places.
    pub thin: Thinness,
    /// Share of the surface whose colour cannot be printed there.
    pub out_of_gamut: f64,
    /// Unrefined error to the target as given, CIEDE2000 over 0.1 mm.
    pub error: ErrorStats,
    /// Where it sits.
    pub shares: ErrorShares,
    /// Error of the appearance that is shown.
    pub picture: PictureError,
    /// Wall times in order.
    pub stages: Vec<StageTime>,
}

/// What a preview consists of; only a folder of these is ever replaced.
fn own_files() -> OwnFiles {
    OwnFiles::new([PREVIEW_FILE, "preview.png", "preview.html", "preview.glb"])
}

impl PrintJob {
    /// Shows what a model would look like without refinement, where its colours are out of reach and its parts too thin:
    /// the halftone that refinement starts from, predicted by the network where this build has it and it was trained for
    /// such prints, else by a few paths whose noise is taken out. Of all but small prints `coarse` first gets a preview by
    /// larger voxels, after about a third of the time, with a monitor of that one's times; its error ends the job.
    ///
    /// ```
    /// use pellucid::job::PreviewDetail;
    /// use pellucid::mesh::{ImportLimits, Scale, import_slice};
    /// use pellucid::{Monitor, PrintJob, PrintSettings};
    /// let gltf = br#"{ "asset": {"version": "2.0"}, "nodes": [{"mesh": 0}],
    ///     "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    ///     "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
    ///     "bufferViews": [{"buffer": 0, "byteLength": 36}],
    ///     "buffers": [{"byteLength": 36, "uri": "data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}] }"#;
    /// let model = import_slice("triangle.gltf", gltf, None, &ImportLimits::default())?;
    /// let settings = PrintSettings { scale: Scale::HeightMm(1.0), ..PrintSettings::default() };
    /// let monitor = Monitor::silent();
    /// let preview = PrintJob::new(settings)?.preview(&model, |_coarse, _monitor| Ok(()), &monitor)?;
    /// assert_eq!(preview.detail, PreviewDetail::Full);
    /// assert!(preview.report(&monitor).thin.below_1_mm > 0.9, "a sheet, one voxel thick");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`PrintError`] of the step that failed; [`PrintError::Cancelled`].
    pub fn preview(
        &self,
        model: &Model,
        coarse: impl FnOnce(&Preview, &Monitor<'_>) -> Result<(), PrintError>,
        monitor: &Monitor<'_>,
    ) -> Result<Preview, PrintError> {
        let tables = monitor.run(Stage::Color, |c| self.color_tables(c))?;
        let (pitch, extent) =
            (self.settings.printer.pitch(), Placement::new(model, self.settings.scale)?.extent_mm());
        let voxels: f64 = extent.iter().zip(pitch.mm()).map(|(extent, edge)| extent / edge).product();
        if voxels >= SMALL_VOXELS {
            let large = Pitch::new(pitch.mm().map(|edge| edge * (COARSE_MM / edge).ceil().max(1.0)))?;
            monitor.provisional(|monitor| {
                let preview = self.preview_by(PreviewDetail::Coarse, large, model, &tables, monitor)?;
                coarse(&preview, monitor)
            })?;
        }
        self.preview_by(PreviewDetail::Full, pitch, model, &tables, monitor)
    }

    /// Tells before any work whether [`Preview::write`] would refuse the output folder. Changes nothing.
    ///
    /// # Errors
    /// [`PrintError::Staging`] when the folder exists and may not be replaced.
    pub fn check_preview_output(&self, dir: &Path, force: bool) -> Result<(), PrintError> {
        Ok(staging::check(dir, force, &own_files())?)
    }

    /// A preview by voxels of a pitch.
    fn preview_by(
        &self,
        detail: PreviewDetail,
        pitch: Pitch,
        model: &Model,
        tables: &ColorTables,
        monitor: &Monitor<'_>,
    ) -> Result<Preview, PrintError> {
        let mut settings = PrintSettings {
            printer: self.settings.printer.clone().with_pitch(pitch),
            // Only refinement heeds these.
            also_under: Vec::new(),
            section_mm: None,
            judge_point_spp: COMPARED_SPP,
            ..self.settings.clone()
        };
        settings.judge.points = COMPARED;
        let job = Self { settings, ..self.clone() };
        let placed = job.place(model, monitor)?;
        let aimed = monitor.run(Stage::Color, |c| job.aim_by(tables, placed, c))?;
        let (unrefined, out_of_gamut) = monitor.run(Stage::Halftone, |c| job.halftone(&aimed, c))?;
        let Appearance { colors, picture, predictor } = monitor
            .run(Stage::Predict, |c| job.appearance_at_once(&unrefined, &aimed.object, &aimed.viewing, c))?;
        let error_parts = monitor.run(Stage::Judge, |c| job.parts(&aimed, &colors, c))?;
        let record = Record::new(aimed.model.clone(), predictor, self.settings.clone());
        Ok(Preview {
            record,
            detail,
            aimed,
            unrefined,
            appearance: colors,
            picture,
            error_parts,
            out_of_gamut,
        })
    }

    fn parts(
        &self,
        aimed: &Aimed,
        colors: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, PrintError> {
        let judge =
            Judge::new(JudgeInput::from(aimed.problem()), self.settings.judge, self.settings.seed, control)?
                .with_gamut_target(&aimed.gamut_target, control)?;
        Ok(judge.error_parts(colors, control)?)
    }
}

impl Preview {
    /// The report, with the times that `monitor` has seen.
    pub fn report(&self, monitor: &Monitor<'_>) -> PreviewReport {
        let aimed = &self.aimed;
        PreviewReport {
            record: self.record.clone(),
            detail: self.detail,
            pitch_mm: self.unrefined.frame().pitch().mm(),
            media_white: aimed.viewing.media_white(),
            extent_mm: aimed.extent_mm,
            surface_voxels: aimed.object.surface().len() as u64,
            mesh: aimed.mesh.clone(),
            thin: aimed.thin,
            out_of_gamut: self.out_of_gamut,
            error: ErrorStats::of(self.error_parts.iter().map(|parts| parts.iter().sum()).collect()),
            shares: ErrorShares::of(&self.error_parts),
            picture: self.picture,
            stages: monitor.times(),
        }
    }

    /// Writes `preview.json`, `preview.png` (rows: front and back; columns: target, printable target, unrefined; not of a
    /// coarse one) and what `files` says (`preview.html`, `preview.glb`) into the folder `dir`, which appears complete or
    /// not at all, and returns the report.
    ///
    /// # Errors
    /// As [`Prepared::write_with`](crate::Prepared::write_with); nothing is left behind then.
    pub fn write(
        &self,
        files: ProofFiles,
        dir: &Path,
        force: bool,
        monitor: &Monitor<'_>,
    ) -> Result<PreviewReport, PrintError> {
        files.check()?;
        let staged = StagedDir::begin(dir, force, &own_files())?;
        monitor.run(Stage::Proof, |c| self.write_pictures(files, staged.path(), c))?;
        #[cfg(feature = "html")]
        let page = match files.html {
            true => Some(monitor.run(Stage::Proof, |c| super::page::page_of_preview(self, c))?),
            false => None,
        };
        let report = self.report(monitor);
        write_json(&report, &staged.path().join(PREVIEW_FILE))?;
        #[cfg(feature = "html")]
        if let Some(page) = page {
            let figures = super::prepared::read_back(staged.path(), PREVIEW_FILE)?;
            let title = &report.record.model.name;
            page.write(staged.path().join("preview.html"), title, &figures, &serde_json::Value::Null)?;
        }
        staged.commit()?;
        Ok(report)
    }

    fn write_pictures(
        &self,
        files: ProofFiles,
        folder: &Path,
        control: &Control<'_>,
    ) -> Result<(), PrintError> {
        let (aimed, surface) = (&self.aimed, self.aimed.object.surface());
        let pictured = |colors| pictured(colors, self.record.settings.proof_intent, &aimed.viewing);
        let colors = [pictured(&aimed.target), pictured(&aimed.printable_target), pictured(&self.appearance)];
        let states = [("target", &colors[0][..]), ("printable", &colors[1]), ("unrefined", &colors[2])];
        let (views, edge) = (View::front_and_back(), self.record.settings.proof_edge);
        // A coarse one is soon replaced.
        if self.detail == PreviewDetail::Full {
            let proof = Proof::draw(&self.unrefined, surface, &views, edge, &states, control)?;
            proof.write_png(folder.join("preview.png"), control)?;
        }
        #[cfg(feature = "glb")]
        if files.glb {
            let look = |name, colors| pellucid_proof::glb::Look { name, colors };
            let looks = [look("unrefined", &self.appearance[..]), look("target", &aimed.target)];
            let glb = pellucid_proof::glb::Glb::of(&self.unrefined, surface, &looks, control)?;
            glb.write(folder.join("preview.glb"))?;
        }
        #[cfg(not(feature = "glb"))]
        let _ = files;
        Ok(())
    }
}
