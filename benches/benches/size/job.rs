//! One print of some size.

use std::path::PathBuf;
use std::process::Command;

use pellucid::core::Bytes;
use pellucid::core::memory::peak_bytes;
use pellucid::job::ProofFiles;
use pellucid::mesh::{ImportLimits, Scale, import_path};
use pellucid::refine::{Descent, Effort, RefineSettings};
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_benches::appearance::Error;
use serde::{Deserialize, Serialize};

/// How prints are refined.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Way {
    pub strategy: StrategyKind,
    #[serde(default)]
    pub section_mm: Option<f64>,
}

impl Way {
    /// What is measured at a height: as a whole up to two sections, and in sections from two on.
    pub fn all(height_mm: f64, section_mm: f64) -> Vec<Self> {
        let way = |strategy, section_mm| Self { strategy, section_mm };
        let mut ways = Vec::new();
        if height_mm <= 2.0 * section_mm {
            ways.extend(
                [StrategyKind::SurfaceFirst, StrategyKind::Descent].map(|strategy| way(strategy, None)),
            );
        }
        if height_mm >= 2.0 * section_mm {
            ways.push(way(StrategyKind::Descent, Some(section_mm)));
        }
        ways
    }

    /// Its name in tables.
    pub fn name(self) -> String {
        match self.section_mm {
            Some(mm) => format!("{} by {mm} mm", self.strategy.name()),
            None => self.strategy.name().to_owned(),
        }
    }
}

/// Iterations after the unrefined halftone.
const ITERATIONS: u32 = 3;
/// What of the defaults is less: paths cost in proportion to their number whatever the size, and memory none.
pub const EFFORT: &str = "3 iterations, 1 of them the opening's of descent; 2 paths a point and channel, 1 of derivatives, \
                          1 of the judge";

/// What is measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Task {
    pub model: PathBuf,
    pub height_mm: f64,
    #[serde(flatten)]
    pub way: Way,
}

/// What it took.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cost {
    pub model: String,
    #[serde(flatten)]
    pub way: Way,
    pub height_mm: f64,
    pub surface_voxels: u64,
    pub solid_voxels: u64,
    /// The process's peak, in bytes; 0 where the system does not tell.
    pub peak_bytes: u64,
    /// Mean CIEDE2000 to the printable target at 0.1 mm.
    pub error: f64,
    /// Seconds by stage.
    pub stages: Vec<(String, f64)>,
}

/// What a task took, and what was said of it.
pub struct Measured {
    pub cost: Cost,
    pub expected_bytes: u64,
}

/// A task that was not done for want of memory.
pub struct TooLarge {
    pub name: String,
    pub expected: Bytes,
}

impl Task {
    /// A name in files.
    pub fn name(&self) -> String {
        let model = self.model.file_stem().unwrap_or_default().to_string_lossy();
        format!("{model} {} {}", self.way.name(), self.height_mm)
    }

    fn settings(&self) -> PrintSettings {
        PrintSettings {
            scale: Scale::HeightMm(self.height_mm),
            strategy: self.way.strategy,
            section_mm: self.way.section_mm,
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
            way: self.way,
            height_mm: self.height_mm,
            surface_voxels: report.surface_voxels,
            solid_voxels: report.solid_voxels,
            peak_bytes: peak_bytes().unwrap_or(0),
            error: report.evaluation.refined.at_0_1_mm.printable.mean,
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
        self.stages.iter().filter(|(stage, _)| stage == name).fold(0.0, |sum, (_, seconds)| sum + seconds)
    }
}
