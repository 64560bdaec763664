//! Label grids from functions and dense arrays, and back.

use rayon::prelude::*;

use super::{inside, tile_coords};
use crate::{AIR, Frame, LabelGrid, TILE, TILE_VOXELS, Tile, VoxelError};

impl LabelGrid {
    /// The grid whose label at voxel `[x, y, z]` is `label([x, y, z])`. Tile by tile in parallel; tiles of one label
    /// take no memory of their own.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3])?, [40, 40, 40])?;
    /// let ball = LabelGrid::from_fn(frame, |v| {
    ///     let from_centre = v.map(|c| f64::from(c) - 19.5);
    ///     u8::from(from_centre.iter().map(|d| d * d).sum::<f64>() <= 18.0 * 18.0)
    /// });
    /// assert_eq!((ball.get([20, 20, 20]), ball.get([0, 0, 0])), (1, 0));
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    pub fn from_fn(frame: Frame, label: impl Fn([u32; 3]) -> u8 + Sync) -> Self {
        Self::from_rows(frame, |[x, y, z], row| {
            for (out, x) in row.iter_mut().zip(x..) {
                *out = label([x, y, z]);
            }
        })
    }

    /// From one label a voxel, ordered `[z][y][x]`, x fastest.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [3, 2, 1])?;
    /// let grid = LabelGrid::from_dense(frame, &[1, 2, 3, 4, 5, 0])?;
    /// assert_eq!(grid.get([0, 1, 0]), 4);
    /// let mut back = [9; 6];
    /// grid.to_dense(&mut back)?;
    /// assert_eq!(back, [1, 2, 3, 4, 5, 0]);
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] unless there is one label for each voxel of the frame.
    pub fn from_dense(frame: Frame, labels: &[u8]) -> Result<Self, VoxelError> {
        check_length(&frame, labels.len())?;
        let [sx, sy, _] = frame.size().map(|s| s as usize);
        Ok(Self::from_rows(frame, |at, row| {
            let [x, y, z] = at.map(|v| v as usize);
            let start = (z * sy + y) * sx + x;
            row.copy_from_slice(&labels[start..start + row.len()]);
        }))
    }

    /// Writes one label a voxel, ordered `[z][y][x]`, x fastest. In parallel over layers.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] unless `labels` has one place for each voxel.
    pub fn to_dense(&self, labels: &mut [u8]) -> Result<(), VoxelError> {
        check_length(self.frame(), labels.len())?;
        let [sx, sy, _] = self.size().map(|s| s as usize);
        labels.par_chunks_mut(sx * sy).enumerate().try_for_each(|(z, layer)| self.copy_layer(z as u32, layer))
    }

    /// The part of the grid from voxel `low` with `size` voxels along `[x, y, z]`, where it lay in space.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3])?, [40, 20, 30])?;
    /// let grid = LabelGrid::from_fn(frame, |[x, ..]| x as u8);
    /// let part = grid.crop([10, 0, 0], [5, 20, 30])?;
    /// assert_eq!(part.get([2, 0, 0]), 12);
    /// assert!((part.frame().origin_mm()[0] - 1.0).abs() < 1e-12);
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when the part is empty or reaches past the grid.
    pub fn crop(&self, low: [u32; 3], size: [u32; 3]) -> Result<Self, VoxelError> {
        let all = self.size();
        if (0..3).any(|a| low[a].checked_add(size[a]).is_none_or(|end| end > all[a])) {
            return Err(VoxelError::invalid(
                "part of a grid",
                format!("{size:?} voxels from {low:?} reach past the grid's {all:?}"),
            ));
        }
        let (origin, mm) = (self.frame().origin_mm(), self.frame().pitch().mm());
        let origin = std::array::from_fn(|a| origin[a] + f64::from(low[a]) * mm[a]);
        let frame = Frame::new(origin, self.frame().pitch(), size)?;
        Ok(Self::from_rows(frame, |at, row| self.copy_row(std::array::from_fn(|a| low[a] + at[a]), row)))
    }

    /// The voxels of a tile, by its position in [`LabelGrid::tiles`], that lie within the frame: each with its
    /// label, ordered `[z][y][x]`. Nothing past the last tile.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [20, 3, 1])?;
    /// let grid = LabelGrid::from_fn(frame, |[x, ..]| x as u8);
    /// let second: Vec<_> = grid.voxels_of(1).collect();
    /// assert_eq!(second.len(), 4 * 3);
    /// assert_eq!(second[5], ([17, 1, 0], 17));
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    pub fn voxels_of(&self, tile_index: usize) -> impl Iterator<Item = ([u32; 3], u8)> + '_ {
        let tile = self.tiles().get(tile_index);
        tile.into_iter().flat_map(move |tile| {
            let t = tile_coords(self.tile_dims(), tile_index);
            let [nx, ny, nz] = inside(t, self.size());
            let corner = t.map(|v| v * TILE as u32);
            (0..nz).flat_map(move |z| {
                (0..ny).flat_map(move |y| {
                    (0..nx).map(move |x| {
                        let at = [corner[0] + x as u32, corner[1] + y as u32, corner[2] + z as u32];
                        (at, tile.label(x, y, z))
                    })
                })
            })
        })
    }

    /// All voxels that are not air, each with its label, tile by tile.
    ///
    /// ```
    /// use pellucid_voxel::{Frame, LabelGrid, Pitch};
    /// let mut grid = LabelGrid::new(Frame::new([0.0; 3], Pitch::j750(), [20, 30, 40])?);
    /// grid.set([17, 2, 3], 5);
    /// grid.set([1, 2, 3], 4);
    /// assert_eq!(grid.solid_voxels().collect::<Vec<_>>(), [([1, 2, 3], 4), ([17, 2, 3], 5)]);
    /// assert_eq!(grid.solid_count(), 2);
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    pub fn solid_voxels(&self) -> impl Iterator<Item = ([u32; 3], u8)> + '_ {
        (0..self.tiles().len())
            .filter(|&i| !matches!(self.tiles()[i], Tile::Constant(AIR)))
            .flat_map(|i| self.voxels_of(i))
            .filter(|&(_, label)| label != AIR)
    }

    /// Number of voxels that are not air.
    pub fn solid_count(&self) -> u64 {
        self.histogram()[usize::from(AIR) + 1..].iter().sum()
    }

    /// Builds the grid from its rows: `fill` gets the first voxel of at most 16 along x that lie within the frame,
    /// and their labels, which are air, to overwrite.
    pub(super) fn from_rows(frame: Frame, fill: impl Fn([u32; 3], &mut [u8]) + Sync) -> Self {
        let size = frame.size();
        Self::from_tiles(frame, |t| {
            let [nx, ny, nz] = inside(t, size);
            let [x, y0, z0] = t.map(|v| v * TILE as u32);
            let mut labels = [AIR; TILE_VOXELS];
            let mut constant = true;
            for z in 0..nz {
                for y in 0..ny {
                    let start = (z * TILE + y) * TILE;
                    fill([x, y0 + y as u32, z0 + z as u32], &mut labels[start..start + nx]);
                    let first = labels[0];
                    constant &= labels[start..start + nx].iter().all(|&l| l == first);
                }
            }
            if constant { Tile::Constant(labels[0]) } else { Tile::Dense(Box::new(labels)) }
        })
    }

    /// Copies the labels of a row along x from a voxel on; all of it lies within the grid.
    fn copy_row(&self, at: [u32; 3], row: &mut [u8]) {
        let [mut x, y, z] = at.map(|v| v as usize);
        let mut rest = row;
        while !rest.is_empty() {
            let count = (TILE - x % TILE).min(rest.len());
            let (part, next) = rest.split_at_mut(count);
            match self.tile([x, y, z].map(|v| (v / TILE) as u32)) {
                Tile::Constant(label) => part.fill(*label),
                Tile::Dense(labels) => {
                    let start = (z % TILE * TILE + y % TILE) * TILE + x % TILE;
                    part.copy_from_slice(&labels[start..start + count]);
                }
            }
            rest = next;
            x += count;
        }
    }
}

fn check_length(frame: &Frame, length: usize) -> Result<(), VoxelError> {
    if length as u64 == frame.voxels() {
        return Ok(());
    }
    let [x, y, z] = frame.size();
    Err(VoxelError::invalid("dense labels", format!("{length} for {x} x {y} x {z} voxels")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pitch;
    use proptest::prelude::*;

    /// Labels that change from voxel to voxel in one place and are level in another.
    fn label([x, y, z]: [u32; 3]) -> u8 {
        if x > 20 { 3 } else { ((x * 7 + y * 5 + z * 3) % 11 / 2) as u8 }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn functions_arrays_and_parts_agree(
            size in [1u32..50, 1u32..40, 1u32..40],
            low in [0u32..50, 0u32..40, 0u32..40],
            part in [1u32..50, 1u32..40, 1u32..40],
        ) {
            let frame = Frame::new([1.0, -2.0, 3.0], Pitch::j750(), size).unwrap();
            let mut set = LabelGrid::new(frame);
            let mut dense = Vec::new();
            for z in 0..size[2] {
                for y in 0..size[1] {
                    for x in 0..size[0] {
                        set.set([x, y, z], label([x, y, z]));
                        dense.push(label([x, y, z]));
                    }
                }
            }
            let made = LabelGrid::from_fn(frame, label);
            prop_assert!(made == set);
            prop_assert!(LabelGrid::from_dense(frame, &dense).unwrap() == set);
            let mut back = vec![99; dense.len()];
            set.to_dense(&mut back).unwrap();
            prop_assert_eq!(&back, &dense);
            // As sparse as compression makes it.
            set.compress();
            prop_assert_eq!(made.memory_bytes(), set.memory_bytes());

            let listed: u64 = (0..made.tiles().len()).map(|i| made.voxels_of(i).count() as u64).sum();
            prop_assert_eq!(listed, frame.voxels());
            prop_assert!(made.solid_voxels().all(|(v, l)| l != AIR && made.get(v) == l));
            prop_assert_eq!(made.solid_voxels().count() as u64, made.solid_count());
            prop_assert_eq!(made.solid_count(), dense.iter().filter(|&&l| l != AIR).count() as u64);

            let low: [u32; 3] = std::array::from_fn(|a| low[a] % size[a]);
            let part: [u32; 3] = std::array::from_fn(|a| part[a].min(size[a] - low[a]));
            let cut = made.crop(low, part).unwrap();
            let shifted = |v: [u32; 3]| label(std::array::from_fn(|a| v[a] + low[a]));
            prop_assert!(cut == LabelGrid::from_fn(*cut.frame(), shifted));
            for a in 0..3 {
                let at = cut.frame().centre_mm([0; 3])[a] - frame.centre_mm(low.map(i64::from))[a];
                prop_assert!(at.abs() < 1e-9);
            }
        }
    }

    #[test]
    fn lengths_and_parts_are_checked() {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [20, 3, 2]).unwrap();
        let grid = LabelGrid::new(frame);
        assert!(LabelGrid::from_dense(frame, &[0; 119]).unwrap_err().to_string().contains("20 x 3 x 2"));
        assert!(grid.to_dense(&mut [0; 121]).is_err());
        assert!(grid.crop([0; 3], [20, 3, 2]).is_ok());
        for (low, size) in [([0; 3], [0, 1, 1]), ([1, 0, 0], [20, 1, 1]), ([u32::MAX, 0, 0], [2, 1, 1])] {
            assert!(matches!(grid.crop(low, size), Err(VoxelError::Invalid(_))), "{low:?} {size:?}");
        }
        assert_eq!(grid.voxels_of(2).count(), 0);
        assert_eq!(Tile::coords(TILE_VOXELS - 1), [15; 3]);
        assert_eq!(Tile::coords(2 * 256 + 3 * 16 + 4), [4, 3, 2]);
    }
}
