//! The finished print, and its files.

use std::path::Path;

use pellucid_core::FileError;
#[cfg(feature = "html")]
use pellucid_core::files::read_text_bounded;
use pellucid_core::files::write_whole_bytes;
use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_slice::{ExportSettings, Recorded, write_stack};

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
        let (aimed, labels) = (&self.aimed, &self.refined.labels);
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
            resins: Resins::of(labels, &self.record.settings.materials),
            refinement: self.refined.report.clone(),
            evaluation: self.judged.evaluation.clone(),
            error_histogram: self.judged.error_histogram(),
            picture: self.judged.picture,
            choice: self.choice.clone(),
            lights: self.judged.lights.clone(),
            prediction: self.judged.prediction,
            texture: None,
            stages: monitor.times(),
            peak_memory_bytes: monitor.peak_memory_bytes(),
        }
    }

    /// Writes `slices/` (or the file of another format), `manifest.json`, `report.json`, `proof.png`, `proof.exr` and `error.png` into the folder `dir`,
    /// which appears complete or not at all, and returns the report.
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
            write_stack(&self.refined.labels, materials, printer, &settings, staged.path(), c)
        })?;
        self.write_proof(staged.path(), monitor)?;
        #[cfg(feature = "glb")]
        if files.glb {
            monitor.run(Stage::Proof, |c| super::model::write_model(self, staged.path(), c))?;
        }
        let page = Page::pack(self, files, monitor)?;
        let report = self.report(monitor);
        write_report(&report, staged.path())?;
        page.write(staged.path(), &report.record.model.name)?;
        staged.commit()?;
        Ok(report)
    }

    pub(super) fn write_proof(&self, folder: &Path, monitor: &Monitor<'_>) -> Result<(), PrintError> {
        monitor.run(Stage::Proof, |c| {
            self.judged.proof.write_png(folder.join("proof.png"), c)?;
            self.judged.proof.write_exr(folder.join("proof.exr"), c)?;
            self.judged.proof.write_error_png(folder.join("error.png"), c)
        })?;
        Ok(())
    }
}

pub(super) fn write_report(report: &Report, folder: &Path) -> Result<(), PrintError> {
    let path = folder.join(REPORT_FILE);
    let mut text = serde_json::to_vec_pretty(report)
        .map_err(|e| FileError::at("write", &path)(std::io::Error::other(e)))?;
    text.push(b'\n');
    Ok(write_whole_bytes(&path, &text)?)
}

/// The proof page, where one is wanted and this build has it.
struct Page {
    #[cfg(feature = "html")]
    page: Option<pellucid_proof::page::ProofPage>,
}

#[cfg(feature = "html")]
impl Page {
    /// Packs what is to be seen; the report's figures come once it is finished.
    fn pack(prepared: &Prepared, files: ProofFiles, monitor: &Monitor<'_>) -> Result<Self, PrintError> {
        let page = || monitor.run(Stage::Proof, |c| super::page::page_of(prepared, c));
        Ok(Self { page: files.html.then(page).transpose()? })
    }

    /// Writes it with the figures of the files in the folder, to the last digit.
    fn write(&self, dir: &Path, title: &str) -> Result<(), PrintError> {
        let Some(page) = &self.page else { return Ok(()) };
        let read = |name: &str| {
            let text = read_text_bounded(dir.join(name), u64::MAX)?;
            serde_json::from_str(&text).map_err(|e| PrintError::invalid(name, pellucid_core::json::plain(&e)))
        };
        Ok(page.write(dir.join("proof.html"), title, &read(REPORT_FILE)?, &read("manifest.json")?)?)
    }
}

#[cfg(not(feature = "html"))]
impl Page {
    fn pack(_: &Prepared, _: ProofFiles, _: &Monitor<'_>) -> Result<Self, PrintError> {
        Ok(Self {})
    }

    fn write(&self, _: &Path, _: &str) -> Result<(), PrintError> {
        Ok(())
    }
}
