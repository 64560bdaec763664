//! One print of some size.

use std::path::PathBuf;
use std::process::Command;

use pellucid::core::memory::peak_bytes;
use pellucid::job::ProofFiles;
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::refine::{Descent, Effort, RefineSettings};
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_benches::appearance::Error;
use serde::{Deserialize, Serialize};

/// Strategies that are measured.
pub const STRATEGIES: [StrategyKind; 2] = [StrategyKind::SurfaceFirst, StrategyKind::Descent];
/// Iterations after the unrefined halftone.
const ITERATIONS: u32 = 4;
/// What of the defaults is less: paths cost in proportion to their number whatever the size, and memory none.
pub const EFFORT: &str = "4 iterations, 1 of them the opening's of descent; 2 paths a point and channel, 1 of derivatives, \
                          1 of the judge";

/// What is measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Task {
    pub model: PathBuf,
    pub height_mm: f64,
    pub strategy: StrategyKind,
}

/// What it took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cost {
    pub model: String,
    pub strategy: StrategyKind,
    pub height_mm: f64,
    pub surface_voxels: u64,
    pub solid_voxels: u64,
    /// The process's peak, in bytes; 0 where the system does not tell.
    pub peak_bytes: u64,
    /// Seconds by stage.
    pub stages: Vec<(String, f64)>,
}

/// What a task took, and what was said of it.
pub struct Measured {
    pub cost: Cost,
    pub expected_bytes: u64,
}

impl Task {
    /// A name in files.
    pub fn name(&self) -> String {
        let model = self.model.file_stem().unwrap_or_default().to_string_lossy();
        format!("{model} {} {}", self.strategy.name(), self.height_mm)
    }

    fn settings(&self) -> PrintSettings {
        PrintSettings {
            scale: Scale::HeightMm(self.height_mm),
            strategy: self.strategy,
            spp: Some(2),
            gradient_spp: 1.0,
            judge_spp: 1,
            judge_point_spp: 64,
            judge: Effort { points: 1000, ..Effort::default() },
            refine: RefineSettings { iterations: Some(ITERATIONS), ..RefineSettings::default() },
            descent: Descent { opening_steps: 1, ..Descent::default() },
            ..PrintSettings::default()
        }
    }

    /// What is said of its memory before the work begins.
    pub fn expected_bytes(&self) -> Result<u64, Error> {
        let model = import_path(&self.model, &ImportLimits::default())?;
        Ok(PrintJob::new(self.settings())?.memory_need(&model)?.bytes.0)
    }

    /// Does the job, with its checkpoints, in a folder that is removed again.
    pub fn run(&self) -> Result<Cost, Error> {
        let out = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("size-{}", std::process::id()));
        let job = PrintJob::new(self.settings())?;
        let model = import_path(&self.model, &ImportLimits::default())?;
        let workspace = Workspace::create(&out)?;
        let monitor = Monitor::silent();
        let prepared = job.prepare(&model, &workspace, &monitor)?;
        let report = prepared.write_with(ProofFiles::built(), &out, true, &monitor)?;
        workspace.finish()?;
        std::fs::remove_dir_all(&out)?;
        Ok(Cost {
            model: self.model.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            strategy: self.strategy,
            height_mm: self.height_mm,
            surface_voxels: report.surface_voxels,
            solid_voxels: report.solid_voxels,
            peak_bytes: peak_bytes().unwrap_or(0),
            stages: report.stages.into_iter().map(|time| (time.stage, time.seconds)).collect(),
        })
    }

    /// [`Task::run`] in a process of its own, so that its peak is its own too.
    pub fn run_apart(&self) -> Result<Cost, Error> {
        let output = Command::new(std::env::current_exe()?)
            .arg("--task")
            .arg(serde_json::to_string(self)?)
            .stderr(std::process::Stdio::inherit())
            .output()?;
        if !output.status.success() {
            return Err(format!("{}: ended with {}", self.name(), output.status).into());
        }
        Ok(serde_json::from_slice(&output.stdout)?)
    }
}

impl Cost {
    /// All stages.
    pub fn seconds(&self) -> f64 {
        self.stages.iter().map(|(_, seconds)| seconds).sum()
    }

    /// One stage.
    pub fn stage(&self, name: &str) -> f64 {
        self.stages.iter().filter(|(stage, _)| stage == name).map(|(_, seconds)| seconds).sum()
    }
}
