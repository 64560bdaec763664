//! How neighbouring points share what the network makes of their coarse surroundings.

use crate::PredictError;

/// Points of one cubic block of voxels take the coarse levels of the stencil about the block's central voxel, and their
/// own finest levels. This leaves out most of the work, since coarse cells hardly differ between neighbours;
/// `docs/results/network_error` has what it costs in accuracy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Sharing {
    /// Finest levels that every point has for itself, 1 to 8.
    pub fine_levels: usize,
    /// Edge of a block in voxels, odd.
    pub block: u32,
}

impl Default for Sharing {
    /// Three levels of their own, the coarser ones shared by blocks of 5³ voxels.
    fn default() -> Self {
        Self { fine_levels: 3, block: 5 }
    }
}

impl Sharing {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] otherwise.
    pub fn check(self) -> Result<(), PredictError> {
        if self.block.is_multiple_of(2) || self.block > 255 || !(1..=8).contains(&self.fine_levels) {
            return Err(PredictError::invalid(
                "sharing",
                format!("{self:?}; blocks have odd edges up to 255, fine levels are 1 to 8"),
            ));
        }
        Ok(())
    }

    /// The central voxel of a voxel's block, within a grid of `size`.
    #[cfg(feature = "rpnn")]
    pub(crate) fn centre(self, voxel: [u32; 3], size: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| (voxel[a] / self.block * self.block + self.block / 2).min(size[a] - 1))
    }
}
