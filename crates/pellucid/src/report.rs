//! The report of a print job, written as `report.json`.

use pellucid_color::spectrum::Illuminant;
use pellucid_core::{ErrorStats, NoisyScore};
use pellucid_mesh::MeshReport;
use pellucid_refine::{Evaluation, RefineReport};
use serde::{Deserialize, Serialize};

use crate::choice::Choice;
use crate::job::{ClearReport, TextureReport};
use crate::record::Record;

pub use crate::error_histogram::ErrorHistogram;
pub use crate::picture_error::PictureError;
pub use crate::resins::{ResinUse, Resins};

/// How far the network was off on the labels that were written, in linear radiance, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PredictionError {
    /// Root mean square over the judge's points and channels, the judge's own noise taken out.
    pub rmse: f64,
    /// Mean of prediction less judgement.
    pub bias: f64,
}

impl PredictionError {
    pub(crate) fn of(score: &NoisyScore) -> Self {
        Self { rmse: score.rmse(), bias: score.bias() }
    }
}

/// What the print looks like under one of several lights, in CIEDE2000 over 0.1 mm of surface, the noise of paths
/// included.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightErrors {
    /// The light; the first is the one that the print is judged under.
    pub illuminant: Illuminant,
    /// Linear RGB radiance that media-relative 1 stands for under it.
    #[serde(default)]
    pub media_white: [f32; 3],
    /// To what it should look like there, before and after refinement.
    pub error: [ErrorStats; 2],
    /// Colour inconstancy: from its look under the first light, before and after.
    pub inconstancy: [ErrorStats; 2],
    /// The inconstancy of what it should look like.
    pub wanted_inconstancy: ErrorStats,
}

/// Where material is thin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Thinness {
    /// Least thickness in mm below a surface voxel, along its normal.
    pub least_mm: f64,
    /// Share of the surface with less than 1 mm of material.
    pub below_1_mm: f64,
    /// Share of the surface with less than 2 mm, where colour starts to depend on thickness.
    pub below_2_mm: f64,
}

impl Thinness {
    /// Of the thickness in mm at each surface voxel.
    pub fn of(thickness_mm: &[f32]) -> Self {
        let count = thickness_mm.len().max(1) as f64;
        let below = |mm: f32| thickness_mm.iter().filter(|&&t| t < mm).count() as f64 / count;
        Self {
            least_mm: f64::from(thickness_mm.iter().copied().reduce(f32::min).unwrap_or(0.0)),
            below_1_mm: below(1.0),
            below_2_mm: below(2.0),
        }
    }
}

/// Time of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// [`Stage::name`](crate::stage::Stage::name).
    pub stage: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// Everything a user may want to know of a finished job.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Report {
    /// Settings, model and predictor: what it takes to make the print again.
    pub record: Record,
    /// Linear RGB radiance that media-relative 1 stands for.
    pub media_white: [f32; 3],
    /// Object size `[x, y, z]` in mm.
    pub extent_mm: [f64; 3],
    /// Layers of the object.
    pub layers: u32,
    /// Solid voxels.
    pub solid_voxels: u64,
    /// Surface voxels.
    pub surface_voxels: u64,
    /// The model's mesh; absent for volumes.
    pub mesh: Option<MeshReport>,
    /// Thin places.
    pub thin: Thinness,
    /// Volume and mass of the resins.
    #[serde(default)]
    pub resins: Resins,
    /// The refinement, iteration by iteration, as predicted in the loop.
    pub refinement: RefineReport,
    /// The errors before and after, as judged by fresh paths.
    pub evaluation: Evaluation,
    /// How the errors to the target as given are spread over the surface.
    #[serde(default)]
    pub error_histogram: ErrorHistogram,
    /// Error of the appearance that the proof shows.
    #[serde(default)]
    pub picture: PictureError,
    /// The same labels under all lights, where there are several.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<LightErrors>,
    /// The network beside the judge's paths; absent with the path tracer, whose only error is noise.
    pub prediction: Option<PredictionError>,
    /// What was tried, where the settings left the predictor open.
    #[serde(default)]
    pub choice: Option<Choice>,
    /// What is printed in clear resin, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clear: Option<ClearReport>,
    /// The compensated texture, where that was written instead of slices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureReport>,
    /// Wall times in order.
    pub stages: Vec<StageTime>,
    /// Most memory that the process held in bytes, where a program measured it.
    pub peak_memory_bytes: Option<u64>,
}
