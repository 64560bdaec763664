//! From the demand to one material a voxel.

use pellucid_voxel::{AIR, Control, LabelGrid, NearestSurface, Surface, TILE, TILE_VOXELS, Tile, VoxelError};
use rayon::prelude::*;

use crate::demand::{Demand, Plan};
use crate::{BlueNoiseMask, InkModel};

/// Where the halftone reads and writes.
pub(crate) struct Halftone<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) nearest: &'a NearestSurface,
    pub(crate) ink: &'a dyn InkModel,
    pub(crate) mask: &'a BlueNoiseMask,
}

/// What a halftone changed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Changes {
    pub(crate) tiles: Vec<u32>,
    pub(crate) voxels: u64,
    /// What no layer of a surface voxel could take of its residual.
    pub(crate) unspent: Vec<[f32; 3]>,
}

impl Halftone<'_> {
    /// Halftones the whole coloured depth of `grid`.
    pub(crate) fn apply(
        &self,
        grid: &mut LabelGrid,
        demand: &Demand,
        plan: &Plan<'_>,
        control: &Control<'_>,
    ) -> Result<Changes, VoxelError> {
        let labels = self.ink.labels();
        let row = labels.len() - 1;
        let stride = plan.layers.len() * row;
        let mut thresholds = vec![0u16; self.surface.len() * stride];
        let mut unspent = vec![[0.0; 3]; self.surface.len()];
        let chunks = thresholds.par_chunks_mut(stride * 256).zip(unspent.par_chunks_mut(256)).enumerate();
        chunks.try_for_each(|(chunk, (rows, unspent))| {
            control.check()?;
            for (i, (out, unspent)) in rows.chunks_exact_mut(stride).zip(unspent).enumerate() {
                *unspent = demand.thresholds(chunk * 256 + i, plan, self.ink, out);
            }
            Ok::<(), VoxelError>(())
        })?;
        let flips = std::sync::atomic::AtomicU64::new(0);
        let size = grid.size();
        let dims = grid.tile_dims();
        let pitch = grid.frame().pitch().mm();
        let squared = plan.layers.squared_ends();
        let tiles = grid.update_tiles(|t, tile| {
            if control.cancelled() {
                return None;
            }
            let index = (t[2] as usize * dims[1] as usize + t[1] as usize) * dims[0] as usize + t[0] as usize;
            let nearest = self.nearest.tile(index)?;
            let base = t.map(|v| v * TILE as u32);
            let mut new = Box::new([AIR; TILE_VOXELS]);
            let mut changed = 0;
            for (i, label) in new.iter_mut().enumerate() {
                let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
                let voxel: [u32; 3] = std::array::from_fn(|a| base[a] + local[a] as u32);
                if (0..3).any(|a| voxel[a] >= size[a]) {
                    continue;
                }
                let old = tile.label(local[0], local[1], local[2]);
                *label = old;
                let point = nearest[i];
                if old == AIR || point == NearestSurface::NONE {
                    continue;
                }
                let at = self.surface.voxels()[point as usize];
                let distance: f64 =
                    (0..3).map(|a| ((f64::from(voxel[a]) - f64::from(at[a])) * pitch[a]).powi(2)).sum();
                let layer = squared.partition_point(|&end| end < distance);
                if layer >= squared.len() {
                    continue;
                }
                let start = point as usize * stride + layer * row;
                let threshold = (self.mask.threshold(voxel) * 65535.0) as u16;
                let slot = thresholds[start..start + row].iter().position(|&sum| threshold < sum);
                *label = labels[slot.unwrap_or(row)];
                changed += u64::from(*label != old);
            }
            if changed == 0 {
                return None;
            }
            flips.fetch_add(changed, std::sync::atomic::Ordering::Relaxed);
            Some(Tile::Dense(new))
        });
        control.check()?;
        Ok(Changes { tiles, voxels: flips.into_inner(), unspent })
    }
}
