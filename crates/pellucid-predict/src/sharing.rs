//! How neighbouring points share what the network makes of their surroundings.

use crate::PredictError;

/// Which work of the network neighbouring points share; `docs/results/network_error` has what it costs in accuracy.
///
/// A network with an exact first flight is run for points some way apart, and the others take its outputs between them:
/// what follows the first collision varies slowly over the surface, and every point's own first flight is exact. A
/// network that gives radiance itself is run for every point.
///
/// Wherever it is run, the coarse levels of the stencil can be those of the central voxel of a block of voxels, since
/// coarse cells hardly differ between neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct Sharing {
    /// About how far apart in mm the points are for which a network with an exact first flight is run; 0 runs it for
    /// every point.
    pub spacing_mm: f64,
    /// Finest levels that every point it is run for has for itself, 1 to 9; 9 shares none.
    pub fine_levels: usize,
    /// Edge in voxels of the blocks that share the other levels, odd.
    pub block: u32,
}

impl Default for Sharing {
    /// Every 0.25 mm; three levels of their own, the coarser ones shared by blocks of 5³ voxels.
    fn default() -> Self {
        Self { spacing_mm: 0.25, fine_levels: 3, block: 5 }
    }
}

impl Sharing {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] otherwise.
    pub fn check(self) -> Result<(), PredictError> {
        if !(0.0..=5.0).contains(&self.spacing_mm) {
            return Err(PredictError::invalid(
                "sharing, spacing_mm",
                format!("{}; 0 to 5 are possible", self.spacing_mm),
            ));
        }
        if self.block.is_multiple_of(2) || self.block > 255 || !(1..=9).contains(&self.fine_levels) {
            return Err(PredictError::invalid(
                "sharing",
                format!("{self:?}; blocks have odd edges up to 255, fine levels are 1 to 9"),
            ));
        }
        Ok(())
    }

    /// Whether some levels are shared.
    #[cfg(feature = "rpnn")]
    pub(crate) fn shares_levels(self) -> bool {
        self.fine_levels < 9
    }

    /// The central voxel of a voxel's block, within a grid of `size`.
    #[cfg(feature = "rpnn")]
    pub(crate) fn centre(self, voxel: [u32; 3], size: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| (voxel[a] / self.block * self.block + self.block / 2).min(size[a] - 1))
    }
}
