//! Settings of the loop.

use serde::{Deserialize, Serialize};

use crate::RefineError;
#[cfg(doc)]
use crate::Strategy;

/// How a refinement runs, whatever its strategy. [`RefineSettings::default`] is what the studies settled on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RefineSettings {
    /// Refinement steps after the unrefined halftone (iteration 0), 0 to 1000; [`Strategy::iterations`] where `None`.
    pub iterations: Option<u32>,
    /// Depth in mm below the surface within which voxels take colour; deeper ones stay as they are. Above 0 and at
    /// most 100.
    pub coloured_depth_mm: f64,
    /// Number of depth layers within the coloured depth, 1 to 64; thinner near the surface.
    pub layers: u32,
    /// Standard deviation in mm, 0 to 1, of the Gaussian over the surface that smooths what the target lacks before
    /// it is fed back and before iterates are compared; 0 takes every voxel's own.
    pub residual_blur_mm: f64,
    /// Seed of the halftone's threshold offsets and of the predictor's draws.
    pub seed: u64,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { iterations: None, coloured_depth_mm: 2.0, layers: 12, residual_blur_mm: 0.1, seed: 0 }
    }
}

impl RefineSettings {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] naming the first field out of range.
    pub fn check(&self) -> Result<(), RefineError> {
        let depth = self.coloured_depth_mm;
        check_ranges(&[
            ("iterations", self.iterations.is_none_or(|n| n <= 1000), "0 to 1000"),
            ("coloured_depth_mm", depth > 0.0 && depth <= 100.0, "above 0 and at most 100 mm"),
            ("layers", (1..=64).contains(&self.layers), "1 to 64"),
            ("residual_blur_mm", (0.0..=1.0).contains(&self.residual_blur_mm), "0 to 1 mm"),
        ])
    }
}

/// Names the first field (name, whether it is in range, its range) that is out of range.
pub(crate) fn check_ranges(fields: &[(&str, bool, &str)]) -> Result<(), RefineError> {
    match fields.iter().find(|(_, ok, _)| !ok) {
        Some((field, _, range)) => Err(RefineError::invalid(*field, format!("must be {range}"))),
        None => Ok(()),
    }
}
