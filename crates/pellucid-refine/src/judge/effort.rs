//! How much the judge predicts.

use serde::{Deserialize, Serialize};

use crate::RefineError;
use crate::settings::check_ranges;

/// How much is predicted. Every pass is one prediction with random numbers of its own; how many paths that is, the
/// predictor knows. A predictor without random error is asked once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Effort {
    /// Surface voxels drawn for per-voxel errors, spread over the surface, 1 to 2^30; all when there are no more.
    pub points: u32,
    /// Passes over those, even, 2 to 16384.
    pub point_passes: u32,
    /// Passes over every surface voxel, even, 2 to 16384.
    pub surface_passes: u32,
}

impl Default for Effort {
    fn default() -> Self {
        Self { points: 1_000, point_passes: 2, surface_passes: 2 }
    }
}

impl Effort {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] naming the first field out of range.
    pub fn check(&self) -> Result<(), RefineError> {
        let passes = |n: u32| (2..=1 << 14).contains(&n) && n.is_multiple_of(2);
        check_ranges(&[
            ("points", (1..=1 << 30).contains(&self.points), "1 to 2^30"),
            ("point_passes", passes(self.point_passes), "even, 2 to 16384"),
            ("surface_passes", passes(self.surface_passes), "even, 2 to 16384"),
        ])
    }
}
