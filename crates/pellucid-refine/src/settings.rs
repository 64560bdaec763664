//! Settings of a refinement.

use crate::RefineError;

/// How a refinement runs. The defaults are what the crate's `ball` example measured as best.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct RefineSettings {
    /// Refinement steps after the unrefined halftone (iteration 0), 0 to 1000.
    pub iterations: u32,
    /// Depth in mm below the surface within which voxels take colour, above 0 and at most 100;
    /// deeper ones are white.
    pub coloured_depth_mm: f64,
    /// Number of depth layers within the coloured depth, 1 to 64; thinner near the surface.
    pub layers: u32,
    /// How much denser than the surface's colour the material near the surface is made, 1 to 50.
    /// The colour then needs less depth, which keeps edges sharp. 1 keeps the extrusion and adds
    /// only corrections.
    pub compression: f32,
    /// Depth over which colour counts, in transport mean free paths of the white, 0.1 to 20.
    pub reach: f64,
    /// Share of the residual added to the demand in each step, above 0 and at most 4.
    pub gain: f32,
    /// Step i takes `gain / (1 + gain_decay i)`; at least 0.
    pub gain_decay: f32,
    /// Depth in mm to which the target's own mixture reaches once refined; below is white.
    pub base_mm: f64,
    /// Depth in mm within which refined halftones keep sparse ink out of white, 0 to 10.
    pub veil_mm: f64,
    /// Standard deviation in mm of the Gaussian over the surface that smooths the residual
    /// before it is fed back, 0 to 1; 0 feeds back every voxel's own.
    pub residual_blur_mm: f64,
    /// Seed of the halftone's threshold mask.
    pub seed: u64,
}

impl Default for RefineSettings {
    fn default() -> Self {
        Self { iterations: 10, coloured_depth_mm: 2.0, layers: 12, gain: 2.0, gain_decay: 0.1, veil_mm: 0.2, base_mm: 0.4, residual_blur_mm: 0.1, seed: 0 }
    }
}

impl RefineSettings {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] naming the first field out of range.
    pub fn check(&self) -> Result<(), RefineError> {
        let depth = self.coloured_depth_mm;
        let in_range = [
            ("iterations", self.iterations <= 1000, "0 to 1000"),
            ("coloured_depth_mm", depth > 0.0 && depth <= 100.0, "above 0 and at most 100 mm"),
            ("layers", (1..=64).contains(&self.layers), "1 to 64"),
            ("compression", (1.0..=50.0).contains(&self.compression), "1 to 50"),
            ("reach", (0.1..=20.0).contains(&self.reach), "0.1 to 20 mean free paths"),
            ("gain", self.gain > 0.0 && self.gain <= 4.0, "above 0 and at most 4"),
            ("gain_decay", (0.0..=100.0).contains(&self.gain_decay), "0 to 100"),
            ("veil_mm", (0.0..=10.0).contains(&self.veil_mm), "0 to 10 mm"),
            ("residual_blur_mm", (0.0..=10.0).contains(&self.residual_blur_mm), "0 to 10 mm"),
        ];
        match in_range.iter().find(|(_, ok, _)| !ok) {
            Some((field, _, range)) => Err(RefineError::invalid(*field, format!("must be {range}"))),
            None => Ok(()),
        }
    }
}
