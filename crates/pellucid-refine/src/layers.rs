//! Depth layers below the surface, and which of them each surface voxel has.

use std::sync::atomic::{AtomicU64, Ordering};

use pellucid_core::{Cancelled, Control};
use pellucid_voxel::{NearestSurface, Surface, TILE};
use rayon::prelude::*;

/// Growth of the layers' thickness with depth: ends lie at (i / count) to this power.
const SPACING: f64 = 1.5;

/// Layers by depth from centre to centre, thinner near the surface, and which of them have voxels below each surface
/// voxel.
#[derive(Clone, Debug)]
pub struct Layers {
    ends_mm: Vec<f64>,
    squared_ends: Vec<f64>,
    /// A bit a layer.
    occupied: Vec<u64>,
}

impl Layers {
    /// Layers down to `depth_mm`: `count` (1 to 64) of them.
    pub(crate) fn find(
        depth_mm: f64,
        count: u32,
        surface: &Surface,
        nearest: &NearestSurface,
        control: &Control<'_>,
    ) -> Result<Self, Cancelled> {
        let end = |i| depth_mm * (f64::from(i) / f64::from(count)).powf(SPACING);
        let ends_mm: Vec<f64> = (1..=count).map(end).collect();
        let squared_ends = ends_mm.iter().map(|d| d * d).collect();
        let mut layers = Self { ends_mm, squared_ends, occupied: Vec::new() };
        layers.occupied = layers.occupation(surface, nearest, control)?;
        Ok(layers)
    }

    /// Number of layers.
    pub fn count(&self) -> usize {
        self.ends_mm.len()
    }

    /// Depths in mm at which the layers end, ascending.
    pub fn ends_mm(&self) -> &[f64] {
        &self.ends_mm
    }

    /// Number of layers that lie wholly above `depth_mm`.
    pub fn above(&self, depth_mm: f64) -> usize {
        self.ends_mm.iter().take_while(|&&end| end <= depth_mm).count()
    }

    /// The layer of a voxel whose squared distance in mm² to its surface voxel is given; `None` below the last.
    #[inline]
    pub fn layer_at(&self, squared_mm: f64) -> Option<usize> {
        let layer = self.squared_ends.partition_point(|&end| end < squared_mm);
        (layer < self.squared_ends.len()).then_some(layer)
    }

    /// Which layers have voxels that follow a surface voxel: bit i for layer i. The first has, the voxel itself, unless the
    /// voxel lies beside a section that is refined and none follows it. Under a medial axis, or where neighbours' cells
    /// close below it, deeper layers have none.
    pub fn occupied(&self, point: u32) -> u64 {
        self.occupied[point as usize]
    }

    fn occupation(
        &self,
        surface: &Surface,
        nearest: &NearestSurface,
        control: &Control<'_>,
    ) -> Result<Vec<u64>, Cancelled> {
        let pitch = surface.frame().pitch().mm();
        let found: Vec<AtomicU64> = surface.voxels().iter().map(|_| AtomicU64::new(0)).collect();
        let [dx, dy, dz] = surface.frame().size().map(|s| s.div_ceil(TILE as u32) as usize);
        (0..dx * dy * dz).into_par_iter().try_for_each(|t| {
            let Some(entries) = nearest.tile(t) else { return Ok(()) };
            control.check()?;
            let base = [t % dx, t / dx % dy, t / dx / dy].map(|v| v * TILE);
            for (i, &point) in entries.iter().enumerate().filter(|(_, p)| **p != NearestSurface::NONE) {
                let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
                let at = surface.voxels()[point as usize];
                let away = |a: usize| ((base[a] + local[a]) as f64 - f64::from(at[a])) * pitch[a];
                let squared: f64 = (0..3).map(|a| away(a).powi(2)).sum();
                if let Some(layer) = self.layer_at(squared) {
                    found[point as usize].fetch_or(1 << layer, Ordering::Relaxed);
                }
            }
            Ok(())
        })?;
        Ok(found.into_iter().map(AtomicU64::into_inner).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, LabelGrid, Pitch, SurfaceOptions, Tile};

    #[test]
    fn a_sheet_has_layers_to_its_middle_and_a_block_has_all() {
        for (depth, deepest_mm) in [(10, 4.0 * 0.0270), (200, 1.0)] {
            let frame =
                Frame::new([0.0; 3], Pitch::new([0.05, 0.05, 0.027]).unwrap(), [80, 80, depth]).unwrap();
            let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
            let control = Control::none();
            let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
            let nearest = NearestSurface::build(&grid, &surface, 1.0, &control).unwrap();
            let layers = Layers::find(1.0, 8, &surface, &nearest, &control).unwrap();
            let middle = surface.index_of([40, 40, depth - 1]).unwrap();
            let expected = layers.ends_mm.partition_point(|&end| end < deepest_mm - 1e-9) + 1;
            assert_eq!(layers.occupied(middle).trailing_ones() as usize, expected.min(8));
            assert_eq!(layers.occupied(middle).count_ones() as usize, expected.min(8));
        }
    }

    #[test]
    fn voxels_that_none_follows_have_no_layers() {
        let frame = Frame::new([0.0; 3], Pitch::new([0.05; 3]).unwrap(), [10, 10, 40]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
        let control = Control::none();
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
        let nearest = NearestSurface::build(&grid, &surface, 0.2, &control).unwrap();
        let (all, wanted) = (0..surface.len() as u32, surface.points_in(12..40));
        let nearest = nearest.of_part(&surface, all.clone(), wanted.clone()).unwrap();
        let layers = Layers::find(0.2, 4, &surface, &nearest, &control).unwrap();
        assert!(wanted.start > 0);
        for point in all {
            assert_eq!(layers.occupied(point) & 1, u64::from(wanted.contains(&point)));
            assert!(wanted.contains(&point) || layers.occupied(point) == 0);
        }
    }
}
