//! Writing a prepared print.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use pellucid_core::staging::{OwnFiles, StagedDir};
use pellucid_slice::{ExportSettings, Recorded, SliceError, own_files, write_stack};
use serde_json::{Value, json};

use crate::PrintError;
use crate::clock::Clock;
use crate::job::Prepared;
use crate::proof::{contact_sheet, write_exr};
use crate::report::{Report, peak_memory_bytes};
use crate::stage::{Observer, Stage};

/// The proof's columns, as EXR layers call them.
const COLUMNS: [&str; 3] = ["target", "unrefined", "refined"];

/// All files of an output folder.
pub(crate) fn output_files() -> OwnFiles {
    own_files().and(["report.json", "proof.png", "proof.exr"])
}

impl Prepared {
    /// Writes `slices/`, `manifest.json`, `report.json`, `proof.png` and `proof.exr` into the folder `dir`,
    /// which appears complete or not at all, and returns the report.
    ///
    /// # Errors
    /// [`PrintError::Slice`] when `dir` exists and `force` does not allow its replacement or slices cannot
    /// be written, [`PrintError::Io`] for the other files; nothing is left behind then.
    pub fn write(
        self,
        dir: &Path,
        force: bool,
        observer: &dyn Observer,
        cancel: &AtomicBool,
    ) -> Result<Report, PrintError> {
        let staged = StagedDir::begin(dir, force, &output_files()).map_err(SliceError::from)?;
        let mut clock = Clock::new(observer, cancel);
        let settings = ExportSettings {
            force,
            seed: self.settings.seed,
            generator: concat!("pellucid ", env!("CARGO_PKG_VERSION")).into(),
            settings: Recorded::of(&self.recorded_settings())?,
        };
        clock.run(Stage::Slices, |c| {
            write_stack(
                &self.grid,
                &self.settings.materials,
                &self.settings.target,
                &settings,
                staged.path(),
                c,
            )
        })?;
        self.write_proof(staged.path())?;

        let mut report = self.report;
        report.stages = self.times;
        report.stages.extend(clock.into_times());
        report.peak_memory_bytes = peak_memory_bytes();
        let path = staged.path().join("report.json");
        let mut text = serde_json::to_string_pretty(&report).map_err(|e| PrintError::io(&path, e))?;
        text.push('\n');
        std::fs::write(&path, text).map_err(|e| PrintError::io(&path, e))?;
        staged.commit().map_err(SliceError::from)?;
        Ok(report)
    }

    fn write_proof(&self, dir: &Path) -> Result<(), PrintError> {
        let rows: Vec<Vec<_>> = self.views.iter().map(|v| v.pictures.to_vec()).collect();
        let path = dir.join("proof.png");
        contact_sheet(&rows).save(&path).map_err(|e| PrintError::io(&path, e))?;
        let layers: Vec<(String, &crate::proof::Picture)> = self
            .views
            .iter()
            .flat_map(|v| COLUMNS.iter().zip(&v.pictures).map(|(c, p)| (format!("{c}.{}", v.name), p)))
            .collect();
        let path = dir.join("proof.exr");
        write_exr(&path, &layers).map_err(|e| PrintError::io(&path, e))
    }

    /// What decided the labels, for the manifest.
    fn recorded_settings(&self) -> Value {
        let s = &self.settings;
        json!({
            "model": self.report.model,
            "height_mm": self.report.extent_mm[2],
            "predictor": s.predictor.name(),
            "spp": s.spp,
            "refractive_index": s.boundary.index(),
            "absolute": s.absolute,
            "refine": s.refine,
        })
    }
}
