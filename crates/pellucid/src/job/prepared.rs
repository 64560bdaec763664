//! The finished print, and its files.

use std::path::Path;

#[cfg(feature = "html")]
use pellucid_core::files::read_text_bounded;
use pellucid_core::files::write_whole_bytes;
use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_core::{Control, FileError};
use pellucid_slice::{ExportSettings, Recorded, write_stack};
use serde::Serialize;

use crate::job::{Aimed, Judged, ProofFiles, Refined};
use crate::report::Resins;
use crate::stage::Stage;
use crate::{Choice, Monitor, PrintError, Record, Report};

/// The report, in a print's folder.
pub(super) const REPORT_FILE: &str = "report.json";

/// What a prepared print consists of; only a folder of these is ever replaced.
pub fn own_files() -> OwnFiles {
    pellucid_slice::own_files().and([
        REPORT_FILE,
        "proof.png",
        "proof.exr",
        "error.png",
        "proof.html",
        "proof.glb",
    ])
}

/// A prepared print in memory.
#[non_exhaustive]
pub struct Prepared {
    /// Settings, model and predictor.
    pub record: Record,
    /// What was tried, where the settings left the predictor open.
    pub choice: Option<Choice>,
    /// Object and targets.
    pub aimed: Aimed,
    /// The labels to print.
    pub refined: Refined,
    /// Errors and appearance.
    pub judged: Judged,
}

impl Prepared {
    /// The report, with the times that `monitor` has seen.
    pub fn report(&self, monitor: &Monitor<'_>) -> Report {
        let aimed = &self.aimed;
        let labels = aimed.with_clear(&self.refined.labels);
        let counts = labels.histogram();
        Report {
            record: self.record.clone(),
            media_white: aimed.viewing.media_white(),
            extent_mm: aimed.extent_mm,
            layers: labels.size()[2],
            solid_voxels: counts[1..].iter().sum(),
            surface_voxels: aimed.object.surface().len() as u64,
            mesh: aimed.mesh.clone(),
            thin: aimed.thin,
            resins: Resins::of(&labels, &self.record.settings.materials),
            refinement: self.refined.report.clone(),
            evaluation: self.judged.evaluation.clone(),
            error_histogram: self.judged.error_histogram(),
            picture: self.judged.picture,
            choice: self.choice.clone(),
            clear: aimed.clear.as_ref().map(|parts| parts.report),
            lights: self.judged.lights.clone(),
            prediction: self.judged.prediction,
            texture: None,
            stages: monitor.times(),
            peak_memory_bytes: monitor.peak_memory_bytes(),
        }
    }

    /// Writes `slices/` (or the file of another format), `manifest.json`, `report.json`, `proof.png`, `proof.exr` and
    /// `error.png` into the folder `dir`, which appears complete or not at all, and returns the report.
    ///
    /// # Errors
    /// [`PrintError::Staging`] when `dir` exists and `force` does not allow its replacement or it holds other files,
    /// [`PrintError::Slice`], [`PrintError::Proof`], [`PrintError::Io`]; nothing is left behind then.
    pub fn write(&self, dir: &Path, force: bool, monitor: &Monitor<'_>) -> Result<Report, PrintError> {
        self.write_with(ProofFiles::default(), dir, force, monitor)
    }

    /// [`Prepared::write`] with further files of the proof.
    ///
    /// # Errors
    /// As there, and as [`ProofFiles::check`].
    pub fn write_with(
        &self,
        files: ProofFiles,
        dir: &Path,
        force: bool,
        monitor: &Monitor<'_>,
    ) -> Result<Report, PrintError> {
        files.check()?;
        let staged = StagedDir::begin(dir, force, &own_files())?;
        let settings = ExportSettings {
            force,
            format: self.record.settings.format,
            seed: self.record.settings.seed,
            generator: concat!("pellucid ", env!("CARGO_PKG_VERSION")).into(),
            settings: Recorded::of(&self.record)?,
        };
        let (materials, printer) = (&self.record.settings.materials, &self.record.settings.printer);
        monitor.run(Stage::Slices, |c| {
            write_stack(
                &self.aimed.with_clear(&self.refined.labels),
                materials,
                printer,
                &settings,
                staged.path(),
                c,
            )
        })?;
        let page = monitor.run(Stage::Proof, |c| {
            self.write_pictures(staged.path(), c)?;
            #[cfg(feature = "glb")]
            if files.glb {
                super::model::write_model(self, staged.path(), c)?;
            }
            Page::pack(self, files, c)
        })?;
        let report = self.report(monitor);
        write_report(&report, staged.path())?;
        page.write(staged.path(), &report.record.model.name)?;
        staged.commit()?;
        Ok(report)
    }

    pub(super) fn write_pictures(&self, folder: &Path, control: &Control<'_>) -> Result<(), PrintError> {
        let proof = &self.judged.proof;
        proof.write_png(folder.join("proof.png"), control)?;
        proof.write_exr(folder.join("proof.exr"), control)?;
        Ok(proof.write_error_png(folder.join("error.png"), control)?)
    }
}

/// Writes a report, as JSON for people and programs.
pub(super) fn write_report(report: &impl Serialize, folder: &Path) -> Result<(), PrintError> {
    write_json(report, &folder.join(REPORT_FILE))
}

/// Writes a value as JSON for people and programs.
pub(super) fn write_json(value: &impl Serialize, path: &Path) -> Result<(), PrintError> {
    let mut text = serde_json::to_vec_pretty(value)
        .map_err(|e| FileError::at("write", path)(std::io::Error::other(e)))?;
    text.push(b'\n');
    Ok(write_whole_bytes(path, &text)?)
}

/// Figures as a file of the folder has them, to the last digit.
#[cfg(feature = "html")]
pub(super) fn read_back(folder: &Path, name: &str) -> Result<serde_json::Value, PrintError> {
    let text = read_text_bounded(folder.join(name), u64::MAX)?;
    serde_json::from_str(&text).map_err(|e| PrintError::invalid(name, pellucid_core::json::plain(&e)))
}

/// The proof page, where one is wanted and this build has it.
struct Page {
    #[cfg(feature = "html")]
    page: Option<pellucid_proof::page::ProofPage>,
}

#[cfg(feature = "html")]
impl Page {
    /// Packs what is to be seen; the report's figures come once it is finished.
    fn pack(prepared: &Prepared, files: ProofFiles, control: &Control<'_>) -> Result<Self, PrintError> {
        let page = || super::page::page_of(prepared, control);
        Ok(Self { page: files.html.then(page).transpose()? })
    }

    /// Writes it with the figures of the files in the folder, to the last digit.
    fn write(&self, dir: &Path, title: &str) -> Result<(), PrintError> {
        let Some(page) = &self.page else { return Ok(()) };
        let [report, manifest] = [read_back(dir, REPORT_FILE)?, read_back(dir, "manifest.json")?];
        Ok(page.write(dir.join("proof.html"), title, &report, &manifest)?)
    }
}

#[cfg(not(feature = "html"))]
impl Page {
    fn pack(_: &Prepared, _: ProofFiles, _: &Control<'_>) -> Result<Self, PrintError> {
        Ok(Self {})
    }

    fn write(&self, _: &Path, _: &str) -> Result<(), PrintError> {
        Ok(())
    }
}
