//! Settings of a refinement.

use crate::RefineError;

/// How a refinement runs. [`RefineSettings::default`] is what the studies settled on.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct RefineSettings {
    /// Refinement steps after the unrefined halftone (iteration 0), 0..=1000.
    pub iterations: u32,
    /// Depth in mm below the surface within which voxels take colour; deeper ones are white.
    pub coloured_depth_mm: f64,
    /// Number of depth layers within the coloured depth, 1..=64; thinner near the surface.
    pub layers: u32,
    /// Share of the residual added to the demand in the first step, above 0 and at most 4.
    pub gain: f32,
    /// Standard deviation in mm of the Gaussian over the surface that smooths the residual
    /// before it is fed back; 0 feeds back every voxel's own.
    pub residual_blur_mm: f64,
    /// Seed of the halftone's threshold offsets.
    pub seed: u64,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { iterations: 10, coloured_depth_mm: 2.0, layers: 10, gain: 1.0, residual_blur_mm: 0.0, seed: 0 }
    }
}

impl RefineSettings {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] naming the first field out of range.
    pub fn check(&self) -> Result<(), RefineError> {
        let in_range = [
            ("iterations", self.iterations <= 1000, "0 to 1000"),
            (
                "coloured_depth_mm",
                self.coloured_depth_mm > 0.0 && self.coloured_depth_mm <= 100.0,
                "above 0 and at most 100 mm",
            ),
            ("layers", (1..=64).contains(&self.layers), "1 to 64"),
            ("gain", self.gain > 0.0 && self.gain <= 4.0, "above 0 and at most 4"),
            ("residual_blur_mm", (0.0..=10.0).contains(&self.residual_blur_mm), "0 to 10 mm"),
        ];
        match in_range.iter().find(|(_, ok, _)| !ok) {
            Some((field, _, range)) => Err(RefineError::invalid(*field, format!("must be {range}"))),
            None => Ok(()),
        }
    }
}
