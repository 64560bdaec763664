//! The nearest surface voxel of every solid voxel, to a depth.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use rayon::prelude::*;

use crate::grid::tile_coords;
use crate::nearest_block::{self, Plan};
use crate::{Control, Frame, LabelGrid, Surface, TILE, TILE_VOXELS, Tile, VoxelError};

/// Marks a tile without entries.
const NO_SLOT: u32 = u32::MAX;

/// For every solid voxel within a depth of the surface, the nearest surface voxel: the feature
/// transform of the anisotropic Euclidean distance between voxel centres.
///
/// The answer is exact, and of equally near surface voxels the one with the lowest index is
/// taken. Squared distances are compared as integers: the squares of the voxel edges are scaled
/// to whole numbers, without error where their ratios are fractions with denominators up to 2^16
/// (600 x 300 x 940 DPI is 2209 : 8836 : 900), else to a relative 1e-9 or better.
///
/// Storage is sparse: 16 KiB for each tile that holds an entry.
///
/// ```
/// use pellucid_voxel::{Control, Frame, LabelGrid, NearestSurface, Pitch, Surface, SurfaceOptions, Tile};
/// let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3]).unwrap(), [48, 48, 48]).unwrap();
/// let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
/// let nearest = NearestSurface::build(&grid, &surface, 1.0, &Control::none()).unwrap();
/// assert_eq!(nearest.nearest([24, 24, 4]), surface.index_of([24, 24, 0]));
/// assert!((nearest.distance_mm([24, 24, 4]).unwrap() - 0.4).abs() < 1e-12);
/// assert_eq!(nearest.nearest([24, 24, 24]), None); // 2.3 mm deep
/// ```
#[derive(Clone, Debug)]
pub struct NearestSurface {
    frame: Frame,
    tile_dims: [u32; 3],
    depth_mm: f64,
    surface: Arc<Vec<[u32; 3]>>,
    slots: Vec<u32>,
    tiles: Vec<Box<[u32; TILE_VOXELS]>>,
}

impl NearestSurface {
    /// Stands for "no surface voxel within the depth" in [`NearestSurface::tile`].
    pub const NONE: u32 = nearest_block::NONE;

    /// Finds the nearest surface voxel of every solid voxel within `depth_mm`, which is included
    /// to a relative 1e-9. A separable transform over blocks of tiles that overlap by the depth,
    /// in parallel; beside the result it holds a few tens of MiB a thread. Progress counts blocks.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when the surface lies in another frame or the depth is not finite
    /// and at least 0, [`VoxelError::Unsupported`] when the depth reaches past 16383 voxels
    /// within the grid, [`VoxelError::Cancelled`].
    pub fn build(
        grid: &LabelGrid,
        surface: &Surface,
        depth_mm: f64,
        control: &Control,
    ) -> Result<NearestSurface, VoxelError> {
        if grid.frame() != surface.frame() {
            return Err(VoxelError::invalid(
                "surface",
                format!("its frame {:?} is not the grid's {:?}", surface.frame(), grid.frame()),
            ));
        }
        let plan = Plan::new(grid.frame(), depth_mm)?;
        let blocks = plan.blocks(grid.size());
        let done = AtomicU64::new(0);
        let found = blocks
            .par_iter()
            .map(|&origin| {
                let tiles = plan.block(grid, surface.index(), origin, control)?;
                control.advance(&done, 1, blocks.len() as u64);
                Ok(tiles)
            })
            .collect::<Result<Vec<_>, VoxelError>>()?;
        let mut slots = vec![NO_SLOT; grid.tiles().len()];
        let mut tiles = Vec::with_capacity(found.iter().map(Vec::len).sum());
        for (tile, entries) in found.into_iter().flatten() {
            slots[tile] = tiles.len() as u32;
            tiles.push(entries);
        }
        Ok(Self {
            frame: *grid.frame(),
            tile_dims: grid.tile_dims(),
            depth_mm,
            surface: surface.shared_voxels(),
            slots,
            tiles,
        })
    }

    /// The map of no voxel.
    pub fn none(surface: &Surface) -> Self {
        let frame = *surface.frame();
        Self {
            frame,
            tile_dims: frame.size().map(|s| s.div_ceil(TILE as u32)),
            depth_mm: 0.0,
            surface: surface.shared_voxels(),
            slots: Vec::new(),
            tiles: Vec::new(),
        }
    }

    /// The map by the part `points` of the surface voxels, which `surface` lists alone. Of these only `wanted` keep their
    /// entries.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when `surface` is not these voxels, or they do not hold the wanted ones.
    pub fn of_part(
        mut self,
        surface: &Surface,
        points: Range<u32>,
        wanted: Range<u32>,
    ) -> Result<Self, VoxelError> {
        let part = self.surface.get(points.start as usize..points.end as usize);
        if surface.frame() != &self.frame || part != Some(surface.voxels()) {
            return Err(VoxelError::invalid("part of a surface", "its voxels are not those of the map"));
        }
        if wanted.start < points.start || wanted.end > points.end {
            let reason = format!("voxels {wanted:?} are wanted of {points:?}");
            return Err(VoxelError::invalid("part of a surface", reason));
        }
        self.tiles.par_iter_mut().for_each(|tile| {
            tile.iter_mut().filter(|entry| **entry != Self::NONE).for_each(|entry| {
                *entry = if wanted.contains(entry) { *entry - points.start } else { Self::NONE };
            });
        });
        self.surface = surface.shared_voxels();
        Ok(self)
    }

    /// Where the grid lies.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The depth in mm the map was built to.
    pub fn depth_mm(&self) -> f64 {
        self.depth_mm
    }

    /// The entries of a tile by its position in [`LabelGrid::tiles`], ordered `[z][y][x]`, x
    /// fastest: a surface index or [`NearestSurface::NONE`] a voxel. `None` for a tile without
    /// entries and past the grid.
    #[inline]
    pub fn tile(&self, tile_index: usize) -> Option<&[u32; TILE_VOXELS]> {
        self.slots.get(tile_index).and_then(|&slot| self.tiles.get(slot as usize)).map(|tile| &**tile)
    }

    /// The voxels with an entry in a tile, by its position in [`LabelGrid::tiles`], ordered `[z][y][x]`: each with
    /// the index of its nearest surface voxel and the squared distance to it in mm².
    ///
    /// ```
    /// use pellucid_voxel::{Control, Frame, LabelGrid, NearestSurface, Pitch, Surface, SurfaceOptions};
    /// let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3])?, [48, 48, 48])?;
    /// let grid = LabelGrid::from_fn(frame, |_| 5);
    /// let control = Control::none();
    /// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control)?;
    /// let nearest = NearestSurface::build(&grid, &surface, 0.35, &control)?;
    /// let below_the_top = grid.tile_index([1, 1, 2]);
    /// for (voxel, point, squared_mm) in nearest.entries(below_the_top) {
    ///     assert_eq!(surface.voxels()[point as usize], [voxel[0], voxel[1], 47]);
    ///     assert!(squared_mm <= 0.35 * 0.35);
    /// }
    /// assert_eq!(nearest.entries(below_the_top).count(), 16 * 16 * 4);
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    pub fn entries(&self, tile_index: usize) -> impl Iterator<Item = ([u32; 3], u32, f64)> + '_ {
        self.tile(tile_index).into_iter().flat_map(move |entries| {
            let corner = tile_coords(self.tile_dims, tile_index).map(|v| v * TILE as u32);
            entries.iter().enumerate().filter(|&(_, &point)| point != Self::NONE).map(move |(i, &point)| {
                let local = Tile::coords(i);
                let voxel = std::array::from_fn(|a| corner[a] + local[a] as u32);
                (voxel, point, self.squared_mm(voxel, point))
            })
        })
    }

    /// The index of the surface voxel nearest to a voxel; `None` for air, deeper voxels and
    /// voxels outside the grid.
    #[inline]
    pub fn nearest(&self, voxel: [u32; 3]) -> Option<u32> {
        let size = self.frame.size();
        if (0..3).any(|a| voxel[a] >= size[a]) {
            return None;
        }
        let [tx, ty, tz] = voxel.map(|v| v as usize / TILE);
        let [x, y, z] = voxel.map(|v| v as usize % TILE);
        let [dx, dy] = [self.tile_dims[0] as usize, self.tile_dims[1] as usize];
        let entries = self.tile((tz * dy + ty) * dx + tx)?;
        Some(entries[(z * TILE + y) * TILE + x]).filter(|&index| index != Self::NONE)
    }

    /// The distance in mm from a voxel's centre to that of its nearest surface voxel; 0 on the
    /// surface, `None` where [`NearestSurface::nearest`] is.
    pub fn distance_mm(&self, voxel: [u32; 3]) -> Option<f64> {
        Some(self.squared_mm(voxel, self.nearest(voxel)?).sqrt())
    }

    fn squared_mm(&self, voxel: [u32; 3], point: u32) -> f64 {
        let surface = self.surface[point as usize];
        let mm = self.frame.pitch().mm();
        (0..3).map(|a| ((f64::from(voxel[a]) - f64::from(surface[a])) * mm[a]).powi(2)).sum()
    }

    /// Number of tiles with entries.
    pub fn stored_tiles(&self) -> usize {
        self.tiles.len()
    }

    /// Bytes held, without the surface voxels shared with [`Surface`].
    pub fn memory_bytes(&self) -> usize {
        self.slots.len() * size_of::<u32>()
            + self.tiles.len() * (size_of::<usize>() + TILE_VOXELS * size_of::<u32>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pitch, SurfaceOptions};
    use proptest::prelude::*;

    /// Nearest surface index by comparing with every surface voxel in whole numbers.
    fn brute_force(surface: &Surface, weights: [i64; 3], limit: i64, voxel: [u32; 3]) -> Option<u32> {
        let squared = |s: &[u32; 3]| -> i64 {
            (0..3).map(|a| weights[a] * (i64::from(s[a]) - i64::from(voxel[a])).pow(2)).sum()
        };
        let best = (0..surface.len()).min_by_key(|&i| (squared(&surface.voxels()[i]), i))?;
        (squared(&surface.voxels()[best]) <= limit).then_some(best as u32)
    }

    /// Compares every voxel; `weights` are the squared edges in units of `unit_mm`².
    fn check(
        grid: &LabelGrid,
        surface: &Surface,
        weights: [i64; 3],
        unit_mm: f64,
        limit: i64,
    ) -> Result<(), TestCaseError> {
        let depth = (limit as f64).sqrt() * unit_mm;
        let nearest = NearestSurface::build(grid, surface, depth, &Control::none()).unwrap();
        let mut listed = 0;
        for (v, point, squared_mm) in (0..grid.tiles().len()).flat_map(|i| nearest.entries(i)) {
            prop_assert_eq!(nearest.nearest(v), Some(point));
            prop_assert_eq!(nearest.distance_mm(v), Some(squared_mm.sqrt()));
            listed += 1;
        }
        let [sx, sy, sz] = grid.size();
        for z in 0..sz {
            for y in 0..sy {
                for x in 0..sx {
                    let v = [x, y, z];
                    listed -= i64::from(nearest.nearest(v).is_some());
                    let expected =
                        if grid.get(v) == 0 { None } else { brute_force(surface, weights, limit, v) };
                    prop_assert_eq!(nearest.nearest(v), expected, "voxel {:?} depth {}", v, depth);
                    let mm = expected.map(|i| {
                        let s = surface.voxels()[i as usize];
                        let squared: i64 =
                            (0..3).map(|a| weights[a] * (i64::from(s[a]) - i64::from(v[a])).pow(2)).sum();
                        (squared as f64).sqrt() * unit_mm
                    });
                    match (mm, nearest.distance_mm(v)) {
                        (Some(a), Some(b)) => prop_assert!((a - b).abs() <= 1e-9 * (1.0 + a)),
                        (a, b) => prop_assert_eq!(a, b),
                    }
                }
            }
        }
        prop_assert_eq!(listed, 0);
        Ok(())
    }

    fn solid_boxes(frame: Frame, fill: u8, boxes: &[([u32; 3], [u32; 3], u8)]) -> LabelGrid {
        let size = frame.size();
        let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(fill));
        for &(corner, extent, label) in boxes {
            let from: [u32; 3] = std::array::from_fn(|a| corner[a] % size[a]);
            let to: [u32; 3] = std::array::from_fn(|a| (from[a] + extent[a]).min(size[a]));
            for z in from[2]..to[2] {
                for y in from[1]..to[1] {
                    for x in from[0]..to[0] {
                        grid.set([x, y, z], label);
                    }
                }
            }
        }
        grid
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn agrees_with_brute_force(
            size in prop_oneof![[1u32..40, 1u32..24, 1u32..40], [1u32..4, 1u32..20, 30u32..90], [60u32..140, 1u32..8, 1u32..8]],
            // Squared edges as whole numbers: isotropic ones plant many ties.
            weights in prop_oneof![
                Just([1i64, 1, 1]), Just([1, 4, 9]), Just([2209, 8836, 900]), [1i64..20, 1i64..20, 1i64..20]
            ],
            fill in 0u8..2,
            boxes in prop::collection::vec(([0u32..50, 0u32..40, 0u32..40], [1u32..40, 1u32..30, 1u32..30], 0u8..3), 0..5),
            depth in prop_oneof![Just(0.0), 0.0f64..3.0, 0.0f64..12.0, Just(200.0)],
        ) {
            let unit_mm = 0.1;
            let pitch = Pitch::new(weights.map(|w| (w as f64).sqrt() * unit_mm)).unwrap();
            let least = *weights.iter().min().unwrap();
            let grid = solid_boxes(Frame::new([0.0; 3], pitch, size).unwrap(), fill, &boxes);
            let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
            // Depths that are reached exactly by some offset plant ties with the limit itself.
            let limit = (depth * depth * least as f64) as i64;
            check(&grid, &surface, weights, unit_mm, limit)?;
        }

        #[test]
        fn agrees_with_brute_force_for_any_sites(
            sites in prop::collection::btree_set((0u32..36, 0u32..20, 0u32..50), 0..12),
            weights in prop_oneof![Just([1i64, 1, 1]), Just([2209, 8836, 900])],
            depth in 0.0f64..30.0,
        ) {
            let unit_mm = 0.01;
            let pitch = Pitch::new(weights.map(|w| (w as f64).sqrt() * unit_mm)).unwrap();
            let frame = Frame::new([1.0, 2.0, 3.0], pitch, [50, 20, 36]).unwrap();
            let grid = solid_boxes(frame, 1, &[([3, 3, 3], [9, 9, 9], 0)]);
            let voxels: Vec<_> = sites.iter().map(|&(z, y, x)| [x, y, z]).collect();
            let normals = vec![[0.0, 0.0, 1.0]; voxels.len()];
            let surface = Surface::from_parts(frame, voxels, normals).unwrap();
            let limit = (depth * depth * *weights.iter().min().unwrap() as f64) as i64;
            check(&grid, &surface, weights, unit_mm, limit)?;
        }
    }

    #[test]
    fn a_slab_at_printer_pitch_is_cut_at_its_middle() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [48, 24, 20]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let nearest = NearestSurface::build(&grid, &surface, 50.0, &Control::none()).unwrap();
        let edge = frame.pitch().mm()[2];
        for z in 0..20u32 {
            let v = [24, 12, z];
            let steps = z.min(19 - z);
            assert!((nearest.distance_mm(v).unwrap() - f64::from(steps) * edge).abs() < 1e-12);
            // Up to the middle the lower face is the nearest, from there the upper one.
            assert_eq!(nearest.nearest(v), surface.index_of([24, 12, if z < 10 { 0 } else { 19 }]));
        }
    }

    #[test]
    fn odd_pitches_agree_with_floating_point() {
        let pitch = Pitch::new([0.0413, 0.0871, 0.0269]).unwrap();
        let frame = Frame::new([0.0; 3], pitch, [40, 30, 70]).unwrap();
        let grid = solid_boxes(frame, 1, &[([10, 10, 10], [3, 4, 5], 0), ([30, 20, 50], [9, 9, 9], 0)]);
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let nearest = NearestSurface::build(&grid, &surface, 0.6, &Control::none()).unwrap();
        let mm = pitch.mm();
        for v in [[20, 15, 30], [15, 14, 18], [33, 15, 60], [5, 5, 5]] {
            let squared = |s: &[u32; 3]| -> f64 {
                (0..3).map(|a| ((f64::from(s[a]) - f64::from(v[a])) * mm[a]).powi(2)).sum()
            };
            let best = surface.voxels().iter().map(squared).fold(f64::INFINITY, f64::min).sqrt();
            let expected = (best <= 0.6).then_some(best);
            match (nearest.distance_mm(v), expected) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-12),
                (a, b) => assert_eq!(a, b),
            }
        }
    }

    #[test]
    fn the_same_for_any_number_of_threads() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [150, 90, 200]).unwrap();
        let grid = solid_boxes(frame, 1, &[([0; 3], [30, 90, 40], 0), ([50, 40, 60], [60, 9, 100], 0)]);
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let control = Control::none();
                let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
                let nearest = NearestSurface::build(&grid, &surface, 0.5, &control).unwrap();
                (surface, nearest)
            })
        };
        let ((surface, nearest), (other_surface, other_nearest)) = (run(1), run(4));
        assert_eq!(surface.voxels(), other_surface.voxels());
        assert_eq!(surface.normals(), other_surface.normals());
        for i in 0..grid.tiles().len() {
            assert_eq!(nearest.tile(i), other_nearest.tile(i));
        }
        assert!(nearest.stored_tiles() > 100);
    }

    #[test]
    fn refuses_what_does_not_fit() {
        let frame = |size| Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
        let grid = LabelGrid::from_tiles(frame([20, 20, 20]), |_| Tile::Constant(1));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let none = Control::none();
        for depth in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                NearestSurface::build(&grid, &surface, depth, &none),
                Err(VoxelError::Invalid { .. })
            ));
        }
        let other = LabelGrid::new(frame([20, 20, 21]));
        assert!(NearestSurface::build(&other, &surface, 1.0, &none).is_err());
        let stop = std::sync::atomic::AtomicBool::new(true);
        let cancelled = NearestSurface::build(&grid, &surface, 1.0, &none.with_cancel(&stop));
        assert_eq!(cancelled.err(), Some(VoxelError::Cancelled));
        let long = LabelGrid::new(frame([20000, 1, 1]));
        let sites = Surface::from_parts(*long.frame(), vec![], vec![]).unwrap();
        assert!(matches!(
            NearestSurface::build(&long, &sites, 1e4, &none),
            Err(VoxelError::Unsupported { .. })
        ));
        assert_eq!(NearestSurface::build(&grid, &surface, 1.0, &none).unwrap().tile(usize::MAX), None);
    }
}
