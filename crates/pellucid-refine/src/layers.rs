//! Depth layers below the surface, and how many of them each surface voxel has.

use std::sync::atomic::{AtomicU32, Ordering};

use pellucid_voxel::{NearestSurface, Surface, TILE};
use rayon::prelude::*;

/// Growth of the layers' thickness with depth: ends lie at (i / count) to this power.
const SPACING: f64 = 1.5;

/// Layers by depth from centre to centre, thinner near the surface.
pub(crate) struct Layers {
    ends_mm: Vec<f64>,
}

impl Layers {
    /// `count` layers down to `depth_mm`.
    pub(crate) fn new(depth_mm: f64, count: u32) -> Self {
        let end = |i| depth_mm * (f64::from(i) / f64::from(count)).powf(SPACING);
        Self { ends_mm: (1..=count).map(end).collect() }
    }

    pub(crate) fn len(&self) -> usize {
        self.ends_mm.len()
    }

    /// Number of layers that lie wholly above `depth_mm`.
    pub(crate) fn above(&self, depth_mm: f64) -> usize {
        self.ends_mm.iter().take_while(|&&end| end <= depth_mm).count()
    }

    /// Squares of the depths at which the layers end, ascending.
    pub(crate) fn squared_ends(&self) -> Vec<f64> {
        self.ends_mm.iter().map(|d| d * d).collect()
    }

    /// Number of layers down to the deepest voxel that follows each surface voxel, at least 1: under a
    /// medial axis, or where neighbours' cells close below it, deeper layers have no voxels to take colour.
    pub(crate) fn available(&self, surface: &Surface, nearest: &NearestSurface, tiles: [u32; 3]) -> Vec<u8> {
        let pitch = surface.frame().pitch().mm();
        let squared = self.squared_ends();
        let found: Vec<AtomicU32> = surface.voxels().iter().map(|_| AtomicU32::new(1)).collect();
        let [dx, dy, dz] = tiles.map(|d| d as usize);
        (0..dx * dy * dz).into_par_iter().for_each(|t| {
            let Some(entries) = nearest.tile(t) else { return };
            let base = [t % dx, t / dx % dy, t / dx / dy].map(|v| v * TILE);
            for (i, &point) in entries.iter().enumerate().filter(|(_, p)| **p != NearestSurface::NONE) {
                let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
                let at = surface.voxels()[point as usize];
                let away = |a: usize| ((base[a] + local[a]) as f64 - f64::from(at[a])) * pitch[a];
                let distance: f64 = (0..3).map(|a| away(a).powi(2)).sum();
                let layer = squared.partition_point(|&end| end < distance);
                if layer < squared.len() {
                    found[point as usize].fetch_max(layer as u32 + 1, Ordering::Relaxed);
                }
            }
        });
        found.into_iter().map(|f| f.into_inner() as u8).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, SurfaceOptions, Tile};

    #[test]
    fn a_sheet_has_layers_to_its_middle_and_a_block_has_all() {
        let layers = Layers::new(1.0, 8);
        for (depth, deepest_mm) in [(10, 4.0 * 0.0270), (200, 1.0)] {
            let frame =
                Frame::new([0.0; 3], Pitch::new([0.05, 0.05, 0.027]).unwrap(), [80, 80, depth]).unwrap();
            let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
            let control = Control::none();
            let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
            let nearest = NearestSurface::build(&grid, &surface, 1.0, &control).unwrap();
            let available = layers.available(&surface, &nearest, grid.tile_dims());
            let middle = surface.index_of([40, 40, depth - 1]).unwrap() as usize;
            let expected =
                layers.squared_ends().partition_point(|&end: &f64| end.sqrt() < deepest_mm - 1e-9) + 1;
            assert_eq!(usize::from(available[middle]), expected.min(8));
        }
    }
}
