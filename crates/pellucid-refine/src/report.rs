//! What a refinement reports.

use rayon::prelude::*;

/// Distribution of CIEDE2000 differences over the evaluated surface voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ErrorStats {
    /// Arithmetic mean.
    pub mean: f64,
    /// 50 % quantile.
    pub median: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl ErrorStats {
    /// Of a list; all zero when it is empty.
    pub(crate) fn of(mut values: Vec<f32>) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        values.par_sort_unstable_by(f32::total_cmp);
        let quantile = |q: f64| f64::from(values[(q * (values.len() - 1) as f64).round() as usize]);
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
        Self { mean, median: quantile(0.5), p95: quantile(0.95), max: quantile(1.0) }
    }
}

/// One iteration: the state of the labels that was predicted, and its errors.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct IterationReport {
    /// 0 for the unrefined halftone.
    pub iteration: u32,
    /// Against the target as given.
    pub raw: ErrorStats,
    /// Against the gamut-mapped target, which is what the loop aims at.
    pub mapped: ErrorStats,
    /// As `mapped`, with what the target lacks smoothed over [`RefineSettings::residual_blur_mm`]: without
    /// most of the halftone's and the predictor's noise. The best iterate has the least mean.
    ///
    /// [`RefineSettings::residual_blur_mm`]: crate::RefineSettings::residual_blur_mm
    pub smoothed: ErrorStats,
    /// Voxels whose label changed since the iteration before; for iteration 0, coloured voxels.
    pub label_flips: u64,
    /// Tiles with at least one such voxel.
    pub changed_tiles: u64,
    /// Seconds spent on demand and halftone.
    pub halftone_seconds: f64,
    /// Seconds spent in the predictor.
    pub predict_seconds: f64,
}

/// The whole refinement.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RefineReport {
    /// [`AppearancePredictor::name`](crate::AppearancePredictor::name).
    pub predictor: String,
    /// Every iteration in order; the first is the unrefined halftone.
    pub iterations: Vec<IterationReport>,
    /// The iteration whose labels were kept: least mean difference to the mapped target.
    pub best: u32,
    /// Surface voxels in all.
    pub surface_voxels: u64,
    /// Share of surface voxels whose target had to be mapped by more than one CIEDE2000 unit.
    pub out_of_gamut: f64,
}

impl RefineReport {
    /// The report of the iteration that was kept; `None` before any iteration finished.
    pub fn best_iteration(&self) -> Option<&IterationReport> {
        self.iterations.iter().find(|i| i.iteration == self.best)
    }
}
