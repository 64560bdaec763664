//! The report of a print job, written as `report.json`.

use pellucid_mesh::MeshReport;
use pellucid_refine::{ErrorStats, RefineReport};
use serde::Serialize;

/// Errors of one state of the labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct StateErrors {
    /// CIEDE2000 to the target as the texture has it.
    pub raw: ErrorStats,
    /// CIEDE2000 to the target mapped into the printer's gamut.
    pub mapped: ErrorStats,
    /// Mean CIEDE2000 that the remaining Monte Carlo noise makes by itself, estimated from two halves of
    /// the paths.
    pub noise: f64,
}

/// The judgement: both states predicted again with fresh paths at the same surface voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Evaluation {
    /// Surface voxels drawn.
    pub points: u64,
    /// Paths a point and channel.
    pub spp: u32,
    /// The halftone of the extruded target.
    pub unrefined: StateErrors,
    /// The labels that were written.
    pub refined: StateErrors,
}

impl Evaluation {
    /// Share by which refinement lowered the mean error to the mapped target; 0 when there was none.
    pub fn reduction(&self) -> f64 {
        match self.unrefined.mapped.mean {
            before if before > 0.0 => 1.0 - self.refined.mapped.mean / before,
            _ => 0.0,
        }
    }
}

/// How far the loop's predictor was off on the labels that were written, in linear radiance, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PredictionError {
    /// Root mean square over the evaluation's points and channels, the judge's own noise taken out.
    pub rmse: f64,
    /// Mean of prediction less judgement.
    pub bias: f64,
}

/// Where material is thin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Thinness {
    /// Least thickness in mm below a surface voxel, along its normal.
    pub least_mm: f64,
    /// Share of the surface with less than 1 mm of material.
    pub below_1_mm: f64,
    /// Share of the surface with less than 2 mm, where colour starts to depend on thickness.
    pub below_2_mm: f64,
}

/// Time of a stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageTime {
    /// [`Stage::name`](crate::stage::Stage::name).
    pub stage: &'static str,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// Everything a user may want to know of a finished job.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// This library's version.
    pub version: &'static str,
    /// The model's name.
    pub model: String,
    /// What import left out or put right.
    pub notes: Vec<String>,
    /// The printer's name.
    pub printer: String,
    /// Predictor of the loop.
    pub predictor: String,
    /// Paths a point and channel in each iteration of the loop, where points are traced.
    pub spp: u32,
    /// Predictions (surface voxels times channels) of the last iteration around which coefficients lie outside
    /// what the network was trained for; 0 with the path tracer.
    pub outside_training: u64,
    /// The network beside the judge's paths; absent with the path tracer, whose only error is noise.
    pub prediction: Option<PredictionError>,
    /// Seed of everything random.
    pub seed: u64,
    /// Refractive index of the boundary.
    pub refractive_index: f64,
    /// Linear RGB radiance that media-relative 1 stands for.
    pub media_white: [f64; 3],
    /// Object size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// Layers of the object.
    pub layers: u32,
    /// Solid voxels.
    pub solid_voxels: u64,
    /// Surface voxels.
    pub surface_voxels: u64,
    /// The model's mesh.
    pub mesh: Option<MeshReport>,
    /// Thin places.
    pub thin: Thinness,
    /// The refinement, iteration by iteration, as predicted in the loop.
    pub refinement: RefineReport,
    /// The errors as re-predicted.
    pub evaluation: Evaluation,
    /// Wall times in order.
    pub stages: Vec<StageTime>,
    /// Most memory the process held, where the system tells.
    pub peak_memory_bytes: Option<u64>,
}

/// The process's peak resident memory in bytes, from Linux's `/proc`; `None` elsewhere.
pub(crate) fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}
