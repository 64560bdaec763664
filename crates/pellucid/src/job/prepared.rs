//! The finished print, and its files.

use std::path::Path;

use pellucid_core::FileError;
use pellucid_core::files::write_whole_bytes;
use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_slice::{ExportSettings, Recorded, write_stack};

use crate::job::{Aimed, Judged, Refined};
use crate::stage::Stage;
use crate::{Choice, Monitor, PrintError, Record, Report};

/// The report, in a print's folder.
pub(super) const REPORT_FILE: &str = "report.json";

/// What a prepared print consists of; only a folder of these is ever replaced.
pub fn own_files() -> OwnFiles {
    pellucid_slice::own_files().and([REPORT_FILE, "proof.png", "proof.exr", "error.png"])
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
            refinement: self.refined.report.clone(),
            evaluation: self.judged.evaluation.clone(),
            choice: self.choice.clone(),
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
        let report = self.report(monitor);
        write_report(&report, staged.path())?;
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
