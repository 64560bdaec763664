//! What a refinement reports.

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
    /// Share of surface voxels whose material ends above the coloured depth.
    pub thin: f64,
}

impl RefineReport {
    /// The report of the iteration that was kept; `None` before any iteration finished.
    pub fn best_iteration(&self) -> Option<&IterationReport> {
        self.iterations.iter().find(|i| i.iteration == self.best)
    }
}
