//! From mixtures to one material a voxel.

use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_core::{Cancelled, Control};
use pellucid_halftone::{BlueNoiseMask, Thresholds};
use pellucid_voxel::{AIR, LabelGrid, NearestSurface, TILE, TILE_VOXELS, Tile};

use crate::problem::MAX_LABELS;
use crate::{Cell, Mixtures, Setup};

/// What a halftone changed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Changes {
    /// Ascending positions of tiles with a changed voxel.
    pub(crate) tiles: Vec<u32>,
    pub(crate) voxels: u64,
}

/// Halftones the whole coloured depth of `labels`; once cancelled, some tiles only.
pub(crate) fn halftone(
    labels: &mut LabelGrid,
    mixtures: &dyn Mixtures,
    setup: &Setup<'_>,
    mask: &BlueNoiseMask,
    control: &Control<'_>,
) -> Result<Changes, Cancelled> {
    let flips = AtomicU64::new(0);
    let dims = labels.tile_dims();
    let task = TileTask {
        setup,
        mixtures,
        mask,
        size: labels.size(),
        pitch: labels.frame().pitch().mm(),
        row: setup.problem.ink.labels().len() - 1,
    };
    let tiles = labels.update_tiles(|t, tile| {
        if control.cancelled() {
            return None;
        }
        let index = (t[2] as usize * dims[1] as usize + t[1] as usize) * dims[0] as usize + t[0] as usize;
        let (new, changed) = task.halftone(t, tile, setup.problem.nearest.tile(index)?);
        flips.fetch_add(changed, Ordering::Relaxed);
        (changed > 0).then_some(Tile::Dense(new))
    });
    control.check()?;
    Ok(Changes { tiles, voxels: flips.into_inner() })
}

struct TileTask<'a> {
    setup: &'a Setup<'a>,
    mixtures: &'a dyn Mixtures,
    mask: &'a BlueNoiseMask,
    size: [u32; 3],
    pitch: [f64; 3],
    row: usize,
}

impl TileTask<'_> {
    /// The new labels of a tile and how many are new.
    fn halftone(
        &self,
        t: [u32; 3],
        tile: &Tile,
        nearest: &[u32; TILE_VOXELS],
    ) -> (Box<[u8; TILE_VOXELS]>, u64) {
        let base = t.map(|v| v * TILE as u32);
        let mut new = Box::new([AIR; TILE_VOXELS]);
        let mut changed = 0;
        for (i, label) in new.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            let voxel: [u32; 3] = std::array::from_fn(|a| base[a] + local[a] as u32);
            if (0..3).any(|a| voxel[a] >= self.size[a]) {
                continue;
            }
            let old = tile.label(local[0], local[1], local[2]);
            *label = old;
            if old != AIR
                && nearest[i] != NearestSurface::NONE
                && let Some(chosen) = self.choose(voxel, nearest[i])
            {
                *label = chosen;
                changed += u64::from(chosen != old);
            }
        }
        (new, changed)
    }

    /// The label of a voxel that follows `point`; `None` below the coloured depth.
    fn choose(&self, voxel: [u32; 3], point: u32) -> Option<u8> {
        let problem = &self.setup.problem;
        let at = problem.object.surface().voxels()[point as usize];
        let squared: f64 =
            (0..3).map(|a| ((f64::from(voxel[a]) - f64::from(at[a])) * self.pitch[a]).powi(2)).sum();
        let layer = self.setup.layers.layer_at(squared)? as u32;
        let mut scratch = [0; MAX_LABELS];
        let shares = self.mixtures.thresholds(&Cell { voxel, point, layer }, &mut scratch[..self.row]);
        Some(problem.ink.labels()[Thresholds::choose(shares, self.mask.threshold(voxel))])
    }
}
