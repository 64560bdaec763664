//! Surface voxels with smooth outward normals.

use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use crate::grid::tile_coords;
use crate::normals::NormalEstimator;
use crate::occupancy::{ROWS, surface_rows};
use crate::surface_count::SurfaceCount;
use crate::surface_index::SurfaceIndex;
use crate::surface_list::estimate;
use crate::{Control, Frame, LabelGrid, TILE, VoxelError};

/// How a surface's normals are estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct SurfaceOptions {
    /// Radius of the ball about a surface voxel from which its normal is estimated, in mm.
    /// A larger radius is smoother, a smaller one follows finer relief. Raised to 1.75 times the
    /// longest voxel edge and lowered to 24 times the shortest where it lies outside these.
    pub normal_radius_mm: f64,
    /// Most bytes that the surface may take: see [`Surface::memory_needed`].
    pub max_bytes: u64,
}

impl SurfaceOptions {
    /// What [`SurfaceOptions::max_bytes`] is by default: 3 GiB, about 95 million surface voxels. At the J750's pitch
    /// that is a closed cube of 170 mm.
    pub const MAX_BYTES: u64 = 3 << 30;
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self { normal_radius_mm: 0.25, max_bytes: Self::MAX_BYTES }
    }
}

/// The solid voxels with at least one of their six neighbours air or outside the grid, ascending
/// by (z, y, x), each with a unit normal that points out of the solid.
///
/// It depends on which voxels are solid and not on their materials, so it stays valid while the
/// materials of solid voxels change.
///
/// It takes 24 bytes a surface voxel, 2 KiB a tile that holds any (about 8 bytes a voxel of a level wall) and 4 bytes
/// a tile of the grid; extraction takes a few MiB a thread beside it.
///
/// ```
/// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions, Tile};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [32, 32, 32]).unwrap();
/// let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
/// assert_eq!(surface.len(), 32 * 32 * 32 - 30 * 30 * 30);
/// let top = surface.index_of([16, 16, 31]).unwrap();
/// assert_eq!(surface.voxels()[top as usize], [16, 16, 31]);
/// assert!(surface.normals()[top as usize][2] > 0.99);
/// assert_eq!(surface.index_of([16, 16, 16]), None);
/// ```
#[derive(Clone, Debug)]
pub struct Surface {
    frame: Frame,
    voxels: Arc<Vec<[u32; 3]>>,
    normals: Vec<[f32; 3]>,
    index: SurfaceIndex,
    /// Layers whose surface voxels are listed.
    pub(crate) listed: Range<u32>,
}

impl Surface {
    /// Finds the surface voxels of a grid and estimates their normals.
    ///
    /// A normal is the direction away from the weighted centre of the solid voxels within
    /// [`SurfaceOptions::normal_radius_mm`]; see the `normals` module for its fallbacks on thin
    /// parts. It never is NaN and always has unit length. Progress counts tiles.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when the radius is not finite and positive, [`VoxelError::Unsupported`] when the
    /// surface would take more than [`SurfaceOptions::max_bytes`] or has more than 2^32 - 2 voxels, before it is
    /// allocated; [`VoxelError::Cancelled`].
    pub fn extract(
        grid: &LabelGrid,
        options: &SurfaceOptions,
        control: &Control,
    ) -> Result<Surface, VoxelError> {
        let dims = grid.tile_dims();
        SurfaceIndex::check_size(dims)?;
        let estimator = NormalEstimator::new(grid, options.normal_radius_mm)?;
        let count = SurfaceCount::of(grid, control)?;
        count.check(dims, options.max_bytes)?;
        let mut index = SurfaceIndex::with_capacity(dims, count.tiles as usize)?;
        let per_slab = dims[0] as usize * dims[1] as usize;
        for tz in 0..dims[2] as usize {
            let masks = (tz * per_slab..(tz + 1) * per_slab)
                .into_par_iter()
                .filter_map(|i| match control.check() {
                    Ok(()) => surface_rows(grid, tile_coords(dims, i)).map(|rows| Ok((i as u32, rows))),
                    Err(cancelled) => Some(Err(cancelled)),
                })
                .collect::<Result<Vec<_>, _>>()?;
            index.push_slab(&masks)?;
        }
        let (voxels, normals) = estimate(&estimator, &index, dims, count.tiles, control)?;
        let frame = *grid.frame();
        Ok(Self { frame, voxels: Arc::new(voxels), normals, index, listed: 0..frame.size()[2] })
    }

    /// Bytes that the surface of a grid will take, by counting its surface voxels: what [`Surface::memory_bytes`] of
    /// the extracted one tells. Takes a small part of the time of extraction and no memory.
    ///
    /// ```
    /// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [100, 100, 100])?;
    /// let grid = LabelGrid::from_fn(frame, |_| 5);
    /// let needed = Surface::memory_needed(&grid);
    /// assert!(needed > 24 * (100 * 100 * 100 - 98 * 98 * 98));
    /// let tight = SurfaceOptions { max_bytes: needed - 1, ..SurfaceOptions::default() };
    /// assert!(Surface::extract(&grid, &tight, &Control::none()).is_err());
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    pub fn memory_needed(grid: &LabelGrid) -> u64 {
        // Without a flag nothing cancels the count.
        SurfaceCount::of(grid, &Control::none()).unwrap_or_default().bytes(grid.tile_dims())
    }

    /// A surface from voxels and normals that were stored or made elsewhere.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] unless there are as many normals as voxels, the voxels lie within
    /// the frame and ascend strictly by (z, y, x), and each normal's length is 1 within 1e-3.
    pub fn from_parts(
        frame: Frame,
        voxels: Vec<[u32; 3]>,
        normals: Vec<[f32; 3]>,
    ) -> Result<Surface, VoxelError> {
        if voxels.len() != normals.len() {
            return Err(VoxelError::invalid(
                "surface normals",
                format!("{} for {} voxels", normals.len(), voxels.len()),
            ));
        }
        let size = frame.size();
        if let Some(v) = voxels.iter().find(|v| (0..3).any(|a| v[a] >= size[a])) {
            return Err(VoxelError::invalid(
                "surface voxels",
                format!("{v:?} lies outside the grid {size:?}"),
            ));
        }
        let key = |v: &[u32; 3]| [v[2], v[1], v[0]];
        if let Some(pair) = voxels.windows(2).find(|p| key(&p[0]) >= key(&p[1])) {
            return Err(VoxelError::invalid(
                "surface voxels",
                format!(
                    "{:?} is followed by {:?}; sort by z, then y, then x, without repeats",
                    pair[0], pair[1]
                ),
            ));
        }
        let unit = |n: &[f32; 3]| {
            let length = n.iter().map(|&c| f64::from(c) * f64::from(c)).sum::<f64>().sqrt();
            (length - 1.0).abs() <= 1e-3
        };
        if let Some(i) = normals.iter().position(|n| !unit(n)) {
            return Err(VoxelError::invalid(
                "surface normals",
                format!("normal {i} is {:?}; it must have length 1", normals[i]),
            ));
        }
        let dims = size.map(|s| s.div_ceil(TILE as u32));
        SurfaceIndex::check_size(dims)?;
        let index = SurfaceIndex::new(dims, &rows_of(dims, &voxels))?;
        Ok(Self { frame, voxels: Arc::new(voxels), normals, index, listed: 0..size[2] })
    }

    /// Where the grid lies.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The layers whose surface voxels are listed: all of them, but those of a [section](Surface::section) that it
    /// leaves out.
    pub fn listed_layers(&self) -> Range<u32> {
        self.listed.clone()
    }

    /// Number of surface voxels.
    pub fn len(&self) -> usize {
        self.voxels.len()
    }

    /// True when there are no surface voxels: the grid is all air.
    pub fn is_empty(&self) -> bool {
        self.voxels.is_empty()
    }

    /// The surface voxels `[x, y, z]`, ascending by (z, y, x).
    pub fn voxels(&self) -> &[[u32; 3]] {
        &self.voxels
    }

    /// Unit outward normals `[x, y, z]` in millimetre space, one a surface voxel.
    pub fn normals(&self) -> &[[f32; 3]] {
        &self.normals
    }

    /// Position of a voxel in [`Surface::voxels`]; `None` when it is not a surface voxel or lies
    /// outside the grid. Two memory accesses.
    #[inline]
    pub fn index_of(&self, voxel: [u32; 3]) -> Option<u32> {
        self.index.get(voxel)
    }

    /// Centre of surface voxel `point` in millimetres.
    ///
    /// # Panics
    /// When `point` is not below [`Surface::len`].
    pub fn position_mm(&self, point: u32) -> [f64; 3] {
        self.frame.centre_mm(self.voxels[point as usize].map(i64::from))
    }

    /// Bytes held by voxels, normals and the index.
    pub fn memory_bytes(&self) -> usize {
        self.len() * (size_of::<[u32; 3]>() + size_of::<[f32; 3]>()) + self.index.memory_bytes()
    }

    pub(crate) fn index(&self) -> &SurfaceIndex {
        &self.index
    }

    pub(crate) fn shared_voxels(&self) -> Arc<Vec<[u32; 3]>> {
        Arc::clone(&self.voxels)
    }
}

/// The surface rows of each tile that holds any of `voxels`, ascending by tile index.
fn rows_of(dims: [u32; 3], voxels: &[[u32; 3]]) -> Vec<(u32, [u16; ROWS])> {
    const T: u32 = TILE as u32;
    let tile_of = |v: &[u32; 3]| (v[2] / T * dims[1] + v[1] / T) * dims[0] + v[0] / T;
    let mut tiles: Vec<u32> = voxels.iter().map(tile_of).collect();
    tiles.sort_unstable();
    tiles.dedup();
    let mut rows: Vec<_> = tiles.iter().map(|&tile| (tile, [0; ROWS])).collect();
    for v in voxels {
        let slot = tiles.binary_search(&tile_of(v)).expect("every voxel's tile was listed");
        rows[slot].1[(v[2] % T * T + v[1] % T) as usize] |= 1 << (v[0] % T);
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pitch, Tile};
    use proptest::prelude::*;

    fn extract(grid: &LabelGrid) -> Surface {
        Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap()
    }

    /// Surface voxels by the definition.
    fn brute_force(grid: &LabelGrid) -> Vec<[u32; 3]> {
        let [sx, sy, sz] = grid.size().map(i64::from);
        let mut found = Vec::new();
        for z in 0..sz {
            for y in 0..sy {
                for x in 0..sx {
                    let around = [
                        [x - 1, y, z],
                        [x + 1, y, z],
                        [x, y - 1, z],
                        [x, y + 1, z],
                        [x, y, z - 1],
                        [x, y, z + 1],
                    ];
                    if grid.at([x, y, z]) != 0 && around.iter().any(|&v| grid.at(v) == 0) {
                        found.push([x as u32, y as u32, z as u32]);
                    }
                }
            }
        }
        found
    }

    fn check(grid: &LabelGrid) -> Result<(), TestCaseError> {
        let surface = extract(grid);
        prop_assert_eq!(surface.voxels(), &brute_force(grid)[..]);
        prop_assert_eq!(Surface::memory_needed(grid), surface.memory_bytes() as u64);
        for n in surface.normals() {
            let length: f32 = n.iter().map(|c| c * c).sum();
            prop_assert!((length - 1.0).abs() < 1e-5, "{n:?}");
        }
        let [sx, sy, sz] = grid.size();
        let mut next = 0;
        for z in 0..sz + 17 {
            for y in 0..sy + 17 {
                for x in 0..sx + 17 {
                    let expected = surface.voxels().get(next as usize) == Some(&[x, y, z]);
                    prop_assert_eq!(surface.index_of([x, y, z]), expected.then_some(next));
                    next += u32::from(expected);
                }
            }
        }
        let copy = Surface::from_parts(*grid.frame(), surface.voxels().to_vec(), surface.normals().to_vec())
            .unwrap();
        for (i, &v) in surface.voxels().iter().enumerate() {
            prop_assert_eq!(copy.index_of(v), Some(i as u32));
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn agrees_with_the_definition(
            size in [1u32..50, 1u32..40, 1u32..40],
            fill in 0u8..2,
            boxes in prop::collection::vec(([0u32..50, 0u32..40, 0u32..40], [1u32..40, 1u32..30, 1u32..30], 0u8..3), 0..6),
            specks in prop::collection::vec(([0u32..50, 0u32..40, 0u32..40], 0u8..3), 0..40),
        ) {
            let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
            let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(fill));
            for (corner, extent, label) in boxes {
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
            for (v, label) in specks {
                grid.set(std::array::from_fn(|a| v[a] % size[a]), label);
            }
            check(&grid)?;
            let mut compressed = grid.clone();
            compressed.compress();
            check(&compressed)?;
        }
    }

    #[test]
    fn parts_are_checked() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [8, 8, 8]).unwrap();
        let up = [0.0, 0.0, 1.0];
        let make = |voxels: &[[u32; 3]], normals: &[[f32; 3]]| {
            Surface::from_parts(frame, voxels.to_vec(), normals.to_vec())
        };
        assert_eq!(make(&[[7, 0, 0], [0, 1, 0], [0, 0, 1]], &[up; 3]).unwrap().len(), 3);
        assert!(make(&[], &[]).unwrap().is_empty());
        assert!(make(&[[0, 1, 0], [7, 0, 0]], &[up; 2]).is_err());
        assert!(make(&[[0, 1, 0], [0, 1, 0]], &[up; 2]).is_err());
        assert!(make(&[[8, 1, 0]], &[up]).is_err());
        assert!(make(&[[1, 1, 0]], &[up; 2]).is_err());
        assert!(make(&[[1, 1, 0]], &[[0.0, 0.0, 0.9]]).is_err());
        assert!(make(&[[1, 1, 0]], &[[f32::NAN, 0.0, 1.0]]).is_err());
    }

    #[test]
    fn a_frame_of_edge_tiles_only_is_refused_before_allocation() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [1 << 20, 1 << 20, 1]).unwrap();
        let result = Surface::from_parts(frame, vec![[5, 5, 0]], vec![[0.0, 0.0, 1.0]]);
        assert!(matches!(result, Err(VoxelError::Unsupported { .. })));
    }

    #[test]
    fn more_than_the_allowed_memory_is_refused_with_what_it_would_take() {
        // A plate of 1000 x 1000 x 2 voxels is all surface: 45.8 MiB of voxels and normals, 7.8 of index.
        let frame = Frame::new([0.0; 3], Pitch::j750(), [1000, 1000, 2]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
        let needed = Surface::memory_needed(&grid);
        let options = SurfaceOptions { max_bytes: needed - 1, ..SurfaceOptions::default() };
        let error = Surface::extract(&grid, &options, &Control::none()).unwrap_err();
        assert!(matches!(error, VoxelError::Unsupported(_)));
        let text = error.to_string();
        assert!(
            text.contains("2.0 million") && text.contains("0.05 GiB") && text.contains("max_bytes"),
            "{text}"
        );
        let enough = SurfaceOptions { max_bytes: needed, ..SurfaceOptions::default() };
        assert_eq!(Surface::extract(&grid, &enough, &Control::none()).unwrap().len(), 2_000_000);
    }

    #[test]
    fn stops_when_cancelled_and_refuses_a_bad_radius() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [20, 20, 20]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
        let stop = std::sync::atomic::AtomicBool::new(true);
        let result = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none().with_cancel(&stop));
        assert_eq!(result.err(), Some(VoxelError::Cancelled));
        for normal_radius_mm in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let options = SurfaceOptions { normal_radius_mm, ..SurfaceOptions::default() };
            assert!(Surface::extract(&grid, &options, &Control::none()).is_err());
        }
    }
}
