//! What slices will look like, whatever made them: a proof from labels alone.

use std::path::Path;
use std::sync::Arc;

use pellucid_color::Viewing;
use pellucid_core::staging::{self, OwnFiles, StagedDir};
use pellucid_predict::Object;
use pellucid_proof::{Proof, View};
use pellucid_slice::Manifest;
use pellucid_voxel::{LabelGrid, Surface, SurfaceOptions, local_thickness_mm};
use serde::{Deserialize, Serialize};

use crate::job::ProofFiles;
use crate::job::appearance::{Appearance, pictured};
use crate::job::clear::{CLEAR, without_label};
use crate::job::placed::THICK_MM;
use crate::job::prepared::{REPORT_FILE, write_report};
use crate::picture_error::PictureError;
use crate::report::{Resins, StageTime, Thinness};
use crate::stage::Stage;
use crate::{Monitor, PrintError, PrintJob, PrintSettings};

/// Labels and what they look like.
#[non_exhaustive]
pub struct SlicesProof {
    /// A name for people.
    pub name: String,
    /// Settings of the job; those that concern refinement were not used.
    pub settings: PrintSettings,
    /// Pitch, colours and orientation of the slices.
    pub manifest: Manifest,
    /// The labels.
    pub labels: LabelGrid,
    /// The labels without clear resin, where there is any.
    opaque: Option<LabelGrid>,
    /// Surface, materials and boundary of what is not clear.
    pub object: Arc<Object>,
    /// Appearance of every surface voxel, linear RGB relative to the print's white; noise was taken out.
    pub colors: Vec<[f32; 3]>,
    /// Thickness in mm below each surface voxel, along its normal; at most 10.
    pub thickness_mm: Vec<f32>,
    /// How far off the appearance is.
    pub picture: PictureError,
    viewing: Viewing,
}

/// What a proof from slices reports, written as `report.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SlicesReport {
    /// Version of this library.
    pub version: String,
    /// The slices' name.
    pub name: String,
    /// Materials, boundary and effort that the appearance was predicted with.
    pub settings: PrintSettings,
    /// Linear RGB radiance that media-relative 1 stands for.
    pub media_white: [f32; 3],
    /// Size `[x, y, z]` of the box around all material that is not clear, in mm.
    pub extent_mm: [f64; 3],
    /// Solid voxels.
    pub solid_voxels: u64,
    /// Surface voxels.
    pub surface_voxels: u64,
    /// Thin places.
    pub thin: Thinness,
    /// Volume and mass of the resins.
    pub resins: Resins,
    /// Error of the appearance that is shown.
    pub picture: PictureError,
    /// Wall times in order.
    pub stages: Vec<StageTime>,
}

/// What a proof from slices consists of; only a folder of these is ever replaced.
fn own_files() -> OwnFiles {
    OwnFiles::new([REPORT_FILE, "proof.png", "proof.exr", "proof.html", "proof.glb"])
}

impl PrintJob {
    /// Predicts what labels look like when they are printed in the job's materials, whatever made them, by
    /// [`PrintSettings::judge_spp`] paths twice, whose noise is then taken out, with the network's help where it was trained
    /// for such prints. A material `clear` is looked through, as air is.
    ///
    /// ```
    /// use pellucid::slice::{ExportSettings, check};
    /// use pellucid::voxel::{Frame, LabelGrid};
    /// use pellucid::{Monitor, PrintJob, PrintSettings};
    /// let job = PrintJob::new(PrintSettings { judge_point_spp: 16, ..PrintSettings::default() })?;
    /// let (printer, materials) = (&job.settings().printer, &job.settings().materials);
    /// let frame = Frame::new([0.0; 3], printer.pitch(), [12, 6, 18])?;
    /// let labels = LabelGrid::from_fn(frame, |[x, ..]| if x < 6 { 1 } else { 5 });
    /// let manifest = check(&labels, materials, printer, &ExportSettings::default())?;
    /// let proof = job.prove("cyan and white", labels, manifest, &Monitor::silent())?;
    /// assert!(proof.colors[0][0] < 0.5 && proof.picture.points > 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`PrintError::Invalid`] when nothing is solid or a label is no material, [`PrintError::Predict`],
    /// [`PrintError::Cancelled`].
    pub fn prove(
        &self,
        name: &str,
        labels: LabelGrid,
        manifest: Manifest,
        monitor: &Monitor<'_>,
    ) -> Result<SlicesProof, PrintError> {
        let s = &self.settings;
        let unknown = (1..=255u8).filter(|&l| usize::from(l) > s.materials.len());
        let counts = labels.histogram();
        if let Some(label) = unknown.into_iter().find(|&l| counts[usize::from(l)] > 0) {
            let reason = format!("label {label} is none of the {} materials", s.materials.len());
            return Err(PrintError::invalid("slices", reason));
        }
        let clear = s.materials.label_of(CLEAR).filter(|&l| counts[usize::from(l)] > 0);
        let opaque = clear.map(|label| without_label(&labels, label));
        let seen = opaque.as_ref().unwrap_or(&labels);
        let surface =
            monitor.run(Stage::Surface, |c| Surface::extract(seen, &SurfaceOptions::default(), c))?;
        if surface.is_empty() {
            let what = if opaque.is_some() { "no voxel is opaque" } else { "no voxel is solid" };
            return Err(PrintError::invalid("slices", what));
        }
        let thickness_mm =
            monitor.run(Stage::Thickness, |c| local_thickness_mm(seen, &surface, THICK_MM, c))?;
        let viewing = Viewing::of_print(&s.materials, "white", s.refractive_index, s.illuminant)?;
        let object = Arc::new(Object::new(surface, s.materials.clone(), s.refractive_index)?);
        let Appearance { colors, picture, .. } =
            monitor.run(Stage::Predict, |c| self.appearance_by_paths(seen, &object, &viewing, c))?;
        Ok(SlicesProof {
            name: name.to_owned(),
            settings: s.clone(),
            manifest,
            labels,
            opaque,
            object,
            colors,
            thickness_mm,
            picture,
            viewing,
        })
    }
}

impl SlicesProof {
    /// The labels that are seen: those that are not clear.
    pub(super) fn opaque(&self) -> &LabelGrid {
        self.opaque.as_ref().unwrap_or(&self.labels)
    }

    /// The report, with the times that `monitor` has seen.
    pub fn report(&self, monitor: &Monitor<'_>) -> SlicesReport {
        let surface = self.object.surface();
        let pitch = self.labels.frame().pitch().mm();
        let extent = |axis: usize| {
            let places = surface.voxels().iter().map(|v| v[axis]);
            let (least, most) = places.fold((u32::MAX, 0), |(low, high), v| (low.min(v), high.max(v)));
            f64::from(most - least + 1) * pitch[axis]
        };
        SlicesReport {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            name: self.name.clone(),
            settings: self.settings.clone(),
            media_white: self.viewing.media_white(),
            extent_mm: [0, 1, 2].map(extent),
            solid_voxels: self.labels.solid_count(),
            surface_voxels: surface.len() as u64,
            thin: Thinness::of(&self.thickness_mm),
            resins: Resins::of(&self.labels, &self.settings.materials),
            picture: self.picture,
            stages: monitor.times(),
        }
    }

    /// Tells before any work whether [`SlicesProof::write`] would refuse the output folder. Changes nothing.
    ///
    /// # Errors
    /// [`PrintError::Staging`] when the folder exists and may not be replaced.
    pub fn check_output(dir: &Path, force: bool) -> Result<(), PrintError> {
        Ok(staging::check(dir, force, &own_files())?)
    }

    /// Writes `report.json`, `proof.png`, `proof.exr` and what `files` says into the folder `dir`, which appears complete or
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
    ) -> Result<SlicesReport, PrintError> {
        files.check()?;
        let staged = StagedDir::begin(dir, force, &own_files())?;
        let surface = self.object.surface();
        let colors = pictured(&self.colors, self.settings.proof_intent, &self.viewing);
        let states = [("print", &colors[..])];
        monitor.run(Stage::Proof, |c| {
            let views = View::front_and_back();
            let proof = Proof::draw(self.opaque(), surface, &views, self.settings.proof_edge, &states, c)?;
            proof.write_png(staged.path().join("proof.png"), c)?;
            proof.write_exr(staged.path().join("proof.exr"), c)?;
            #[cfg(feature = "glb")]
            if files.glb {
                let look = pellucid_proof::glb::Look { name: "print", colors: &self.colors };
                let glb = pellucid_proof::glb::Glb::of(self.opaque(), surface, &[look], c)?;
                glb.write(staged.path().join("proof.glb"))?;
            }
            Ok::<_, PrintError>(())
        })?;
        #[cfg(feature = "html")]
        let page = match files.html {
            true => Some(monitor.run(Stage::Proof, |c| super::page::page_of_slices(self, c))?),
            false => None,
        };
        let report = self.report(monitor);
        write_report(&report, staged.path())?;
        #[cfg(feature = "html")]
        if let Some(page) = page {
            let json = |e: serde_json::Error| PrintError::invalid("report", pellucid_core::json::plain(&e));
            let figures = super::prepared::read_back(staged.path(), REPORT_FILE)?;
            let manifest = serde_json::to_value(&self.manifest).map_err(json)?;
            page.write(staged.path().join("proof.html"), &self.name, &figures, &manifest)?;
        }
        staged.commit()?;
        Ok(report)
    }
}
