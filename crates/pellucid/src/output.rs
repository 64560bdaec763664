//! Writing a prepared print.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use pellucid_core::Control;
use pellucid_proof::{Picture, contact_sheet, write_exr};
use pellucid_slice::{ExportSettings, StagedDir, write_stack};
use serde_json::{Map, Value, json};

use crate::PrintError;
use crate::clock::Clock;
use crate::job::Prepared;
use crate::report::{Report, peak_memory_bytes};
use crate::stage::{Observer, Stage};

/// The proof's columns, as EXR layers call them.
const COLUMNS: [&str; 3] = ["target", "unrefined", "refined"];

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
        let staged = StagedDir::begin(dir, force)?;
        let mut clock = Clock::new(observer, cancel);
        let settings = ExportSettings {
            force,
            seed: self.settings.seed,
            generator: concat!("pellucid ", env!("CARGO_PKG_VERSION")).into(),
            settings: self.recorded_settings(),
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
        self.write_proof(staged.path(), &Control::none().with_cancel(cancel))?;

        let mut report = self.report;
        report.stages = self.times;
        report.stages.extend(clock.into_times());
        report.peak_memory_bytes = peak_memory_bytes();
        let path = staged.path().join("report.json");
        let mut text = serde_json::to_string_pretty(&report).map_err(|e| PrintError::io(&path, e))?;
        text.push('\n');
        std::fs::write(&path, text).map_err(|e| PrintError::io(&path, e))?;
        staged.commit()?;
        Ok(report)
    }

    fn write_proof(&self, dir: &Path, control: &Control<'_>) -> Result<(), PrintError> {
        let rows: Vec<Vec<_>> = self.views.iter().map(|v| v.pictures.to_vec()).collect();
        contact_sheet(&rows, control)?.write_png(dir.join("proof.png"), control)?;
        let layers: Vec<(String, &Picture)> = self
            .views
            .iter()
            .flat_map(|v| COLUMNS.iter().zip(&v.pictures).map(|(c, p)| (format!("{c}.{}", v.name), p)))
            .collect();
        Ok(write_exr(dir.join("proof.exr"), &layers, control)?)
    }

    /// What decided the labels, for the manifest.
    fn recorded_settings(&self) -> Map<String, Value> {
        let s = &self.settings;
        let fields = json!({
            "model": self.report.model,
            "height_mm": self.report.extent_mm[2],
            "predictor": s.predictor.name(),
            "spp": s.spp,
            "refractive_index": s.boundary.index(),
            "absolute": s.absolute,
            "refine": s.refine,
        });
        match fields {
            Value::Object(map) => map,
            _ => Map::new(),
        }
    }
}
