//! What a refinement reports.

use pellucid_core::ErrorStats;
use serde::{Deserialize, Serialize};

/// One iteration: the state of the labels that was predicted, and its errors in CIEDE2000 over all surface voxels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct IterationReport {
    /// 0 for the unrefined halftone.
    pub iteration: u32,
    /// Against the target as given.
    pub target: ErrorStats,
    /// Against the printable target, which is what the loop aims at.
    pub printable_target: ErrorStats,
    /// As `printable_target`, with what the target lacks smoothed over
    /// [`RefineSettings::residual_blur_mm`](crate::RefineSettings::residual_blur_mm): without most of the halftone's
    /// and the predictor's noise. The best iterate has the least mean, over all viewings.
    pub smoothed: ErrorStats,
    /// The mean of the same in each further viewing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub further: Vec<f64>,
    /// Voxels whose label differs from the labels handed to the step: for iteration 0 the coloured voxels, else those
    /// that changed since the iteration before, unless the step was resumed or repeated with other labels.
    pub label_flips: u64,
    /// Tiles with at least one such voxel.
    pub changed_tiles: u64,
    /// Predicted values around which coefficients lie outside what the predictor was made for.
    pub outside_training: u64,
    /// Paths traced.
    pub paths: u64,
    /// Seconds spent on mixtures and halftone.
    pub halftone_seconds: f64,
    /// Seconds spent in the predictor.
    pub predict_seconds: f64,
    /// Seconds spent on the next state, derivatives included.
    pub update_seconds: f64,
    /// What the strategy lowers, where it says so.
    pub loss: Option<f64>,
    /// How much of it is the predictor's random error, where that was measured.
    pub noise: Option<f64>,
    /// Mean change of what it moved next, where it says so.
    pub step: Option<f64>,
}

impl IterationReport {
    /// Sum of the smoothed means over all viewings: the best iterate has the least.
    pub(crate) fn off(&self) -> f64 {
        self.smoothed.mean + self.further.iter().sum::<f64>()
    }
}

/// The whole refinement.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct RefineReport {
    /// [`Strategy::name`](crate::Strategy::name).
    pub strategy: String,
    /// Every iteration in order; the first is the unrefined halftone.
    pub iterations: Vec<IterationReport>,
    /// The iteration whose labels are kept: least mean of [`IterationReport::smoothed`] over
    /// all viewings.
    pub best: u32,
    /// The strategy ended the refinement before its iterations were done: nothing was to be gained.
    pub settled: bool,
    /// Surface voxels in all.
    pub surface_voxels: u64,
    /// Share of surface voxels whose target had to be mapped by more than one CIEDE2000 unit.
    pub out_of_gamut: f64,
}

impl RefineReport {
    /// The report of the iteration that is kept; `None` before any iteration finished.
    pub fn best_iteration(&self) -> Option<&IterationReport> {
        self.iterations.iter().find(|i| i.iteration == self.best)
    }
}
