//! From demands to one material a voxel.

use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_voxel::{AIR, LabelGrid, NearestSurface, Surface, TILE_VOXELS, Tile};

use crate::BlueNoiseMask;
use crate::demand::{Demand, MAX_LAYERS, fill};
use crate::layers::{DepthLayers, depth_mm, local};
use crate::table::{DemandTable, Mixture};

/// What a halftone pass changed.
pub(crate) struct Changes {
    /// Positions of the tiles whose labels changed, ascending.
    pub tiles: Vec<u32>,
    /// Voxels whose label changed.
    pub flips: u64,
}

/// Everything a halftone needs besides the demand.
pub(crate) struct Halftone<'a> {
    pub surface: &'a Surface,
    pub nearest: &'a NearestSurface,
    pub table: DemandTable,
    pub layers: DepthLayers,
    pub mask: BlueNoiseMask,
}

impl Halftone<'_> {
    /// Sets the label of every solid voxel: within the coloured depth by the demand of its nearest
    /// surface voxel at its depth, deeper ones to white. Tiles in parallel; the result depends on
    /// the inputs only.
    pub fn apply(&self, grid: &mut LabelGrid, demand: &Demand) -> Changes {
        let flips = AtomicU64::new(0);
        let dims = grid.tile_dims().map(|d| d as usize);
        let pitch = grid.frame().pitch().mm().map(|p| p as f32);
        let tiles = grid.update_tiles(|t, tile| {
            let index = (t[2] as usize * dims[1] + t[1] as usize) * dims[0] + t[0] as usize;
            let new = self.tile(index, t.map(|v| v * 16), tile, demand, pitch)?;
            let changed = (0..TILE_VOXELS).filter(|&i| new[i] != label_at(tile, i)).count();
            if changed == 0 {
                return None;
            }
            flips.fetch_add(changed as u64, Ordering::Relaxed);
            Some(Tile::Dense(new))
        });
        Changes { tiles, flips: flips.into_inner() }
    }

    /// The new labels of a tile; `None` where nothing is solid.
    fn tile(
        &self,
        index: usize,
        base: [u32; 3],
        tile: &Tile,
        demand: &Demand,
        pitch: [f32; 3],
    ) -> Option<Box<[u8; TILE_VOXELS]>> {
        let white = self.table.labels()[self.table.labels().len() - 1];
        let entries = self.nearest.tile(index);
        match (tile, entries) {
            (Tile::Constant(AIR), _) => return None,
            (Tile::Constant(label), None) if *label == white => return None,
            _ => {}
        }
        let mut labels = Box::new([AIR; TILE_VOXELS]);
        // Voxels sorted by the surface voxel they follow, so that each demand is filled once.
        let mut cells: Vec<u64> = Vec::with_capacity(TILE_VOXELS);
        for i in 0..TILE_VOXELS {
            if label_at(tile, i) == AIR {
                continue;
            }
            labels[i] = white;
            let s = entries.map_or(NearestSurface::NONE, |e| e[i]);
            if s != NearestSurface::NONE {
                cells.push(u64::from(s) << 12 | i as u64);
            }
        }
        cells.sort_unstable();
        let mut mixtures = [Mixture::default(); MAX_LAYERS];
        for cell in cells.chunk_by(|a, b| a >> 12 == b >> 12) {
            let s = (cell[0] >> 12) as usize;
            let of = self.surface.voxels()[s];
            let placed = cell.iter().filter_map(|c| {
                let i = (c & 0xfff) as usize;
                let voxel = local(base, i);
                self.layers.layer(depth_mm(voxel, of, pitch)).map(|layer| (i, voxel, layer))
            });
            let Some(deepest) = placed.clone().map(|(_, _, layer)| layer).max() else { continue };
            fill(&self.table, &self.layers, demand.budget[s], demand.compression, &mut mixtures[..=deepest]);
            for (i, voxel, layer) in placed {
                labels[i] = self.table.label(&mixtures[layer], self.mask.threshold(voxel));
            }
        }
        Some(labels)
    }
}

/// The label at position `i` of a tile.
#[inline]
fn label_at(tile: &Tile, i: usize) -> u8 {
    match tile {
        Tile::Constant(label) => *label,
        Tile::Dense(labels) => labels[i],
    }
}
