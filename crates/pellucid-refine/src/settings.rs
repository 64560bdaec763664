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
    /// Step i takes `gain / (1 + gain_decay i)`; at least 0.
    pub gain_decay: f32,
    /// Depth in mm to which the target's own mixture reaches once refined; below is white.
    pub base_mm: f64,
    /// Depth in mm within which refined halftones keep sparse ink out of white, 0 to 10.
    pub veil_mm: f64,
    /// Standard deviation in mm of the Gaussian over the surface that smooths the residual
    /// before it is fed back; 0 feeds back every voxel's own.
    pub residual_blur_mm: f64,
    /// Seed of the halftone's threshold offsets.
    pub seed: u64,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self {
            iterations: 10,
            coloured_depth_mm: 2.0,
            layers: 12,
            gain: 2.0,
            gain_decay: 0.1,
            veil_mm: 0.2,
            base_mm: 0.4,
            residual_blur_mm: 0.1,
            seed: 0,
        }
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
            ("gain_decay", (0.0..=100.0).contains(&self.gain_decay), "0 to 100"),
            ("base_mm", (0.0..=100.0).contains(&self.base_mm), "0 to 100 mm"),
            ("veil_mm", (0.0..=10.0).contains(&self.veil_mm), "0 to 10 mm"),
            ("residual_blur_mm", (0.0..=10.0).contains(&self.residual_blur_mm), "0 to 10 mm"),
        ];
        match in_range.iter().find(|(_, ok, _)| !ok) {
            Some((field, _, range)) => Err(RefineError::invalid(*field, format!("must be {range}"))),
            None => Ok(()),
        }
    }
}
