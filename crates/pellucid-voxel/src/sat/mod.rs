//! Exact summed-area tables over material counts.
//!
//! The method sums scattering and absorption coefficients of each channel in floating point
//! (Rittig, Sumin et al. 2021, section 4.4). [`CountSat`] sums voxels of each material as integers
//! instead: exact at any size, and one table serves all channels, since the mean coefficient of a
//! box is the sum over materials of count times coefficient, over the volume.

mod build;
pub mod tables;
mod update;

#[cfg(test)]
mod tests;

use rayon::prelude::*;

use crate::{Control, LabelGrid, TILE, Tile, VoxelError};
use build::GroupLabels;
use tables::{CountTables, LANES};

/// A two-level summed-area table of the voxels of each material.
///
/// Labels `1..=materials` are counted, five to a group of tables; outside the grid counts are
/// zero. See [`tables`] for the layout. A tile of one label costs about 1 kB, a mixed one 10.2
/// bytes a voxel and group.
///
/// ```
/// use pellucid_voxel::{Control, CountSat, Frame, LabelGrid, Pitch};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [40, 20, 30]).unwrap();
/// let mut grid = LabelGrid::new(frame);
/// grid.set([3, 4, 5], 2);
/// let sat = CountSat::build(&grid, 5, &Control::none()).unwrap();
/// let mut counts = [0; 5];
/// sat.counts([-10, 0, 0], [4, 20, 30], &mut counts);
/// assert_eq!(counts, [0, 1, 0, 0, 0]);
/// ```
pub struct CountSat {
    size: [u32; 3],
    tile_dims: [u32; 3],
    materials: usize,
    groups: Vec<CountTables>,
}

/// Bytes held by a [`CountSat`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SatMemory {
    /// Tables of mixed tiles.
    pub tiles: usize,
    /// One record a tile, with the counts along its edges.
    pub records: usize,
    /// Mixed tiles, counted once a group in which they are mixed.
    pub mixed_tiles: usize,
}

impl SatMemory {
    /// All bytes.
    pub fn total(&self) -> usize {
        self.tiles + self.records
    }
}

impl CountSat {
    /// Builds the table of labels `1..=materials`, in parallel.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when `materials` is 0 or over 255 or a voxel has a larger label,
    /// [`VoxelError::Unsupported`] when memory lacks, [`VoxelError::Cancelled`].
    pub fn build(grid: &LabelGrid, materials: usize, control: &Control) -> Result<Self, VoxelError> {
        if !(1..=255).contains(&materials) {
            return Err(VoxelError::invalid("materials", format!("{materials} must lie within 1 to 255")));
        }
        check_labels(grid, materials, None)?;
        let groups = materials.div_ceil(LANES);
        let groups = (0..groups)
            .map(|g| {
                control.report(g as u64, groups as u64);
                CountTables::build(grid, &GroupLabels::new(g, materials), control)
            })
            .collect::<Result<Vec<_>, _>>()?;
        control.report(groups.len() as u64, groups.len() as u64);
        Ok(Self { size: grid.size(), tile_dims: grid.tile_dims(), materials, groups })
    }

    /// Brings the table up to date after the tiles at positions `changed` of
    /// [`LabelGrid::tiles`], in any order, got other labels; equal to a full rebuild.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when the grid has another size, a position lies past its tiles or a
    /// label past the counted ones; [`VoxelError::Cancelled`]. After an error the table is as it
    /// was.
    pub fn update(&mut self, grid: &LabelGrid, changed: &[u32], control: &Control) -> Result<(), VoxelError> {
        if grid.size() != self.size {
            return Err(VoxelError::invalid(
                "grid",
                format!("{:?} voxels where the table has {:?}; build it anew", grid.size(), self.size),
            ));
        }
        let mut changed = changed.to_vec();
        changed.sort_unstable();
        changed.dedup();
        if let Some(last) = changed.last().filter(|&&last| last as usize >= grid.tiles().len()) {
            return Err(VoxelError::invalid(
                "changed tiles",
                format!("{last} of a grid with {} tiles", grid.tiles().len()),
            ));
        }
        check_labels(grid, self.materials, Some(&changed))?;
        let prepared = self
            .groups
            .iter()
            .enumerate()
            .map(|(g, group)| group.prepare(grid, &GroupLabels::new(g, self.materials), &changed, control))
            .collect::<Result<Vec<_>, _>>()?;
        // From here on there is no way out, so that no caller sees a table of neither state.
        for (group, built) in self.groups.iter_mut().zip(prepared) {
            group.apply(built);
        }
        Ok(())
    }

    /// Labels counted.
    pub fn materials(&self) -> usize {
        self.materials
    }

    /// Voxels along `[x, y, z]`.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// Tiles of the grid along `[x, y, z]`.
    pub fn tile_dims(&self) -> [u32; 3] {
        self.tile_dims
    }

    /// The tables: group `g` counts labels `5 g + 1..=5 g + 5`.
    pub fn groups(&self) -> &[CountTables] {
        &self.groups
    }

    /// Counts of each material in the box from `low` to `high` (exclusive), label 1 first.
    ///
    /// Exact for any box, also partly or wholly outside; an empty box counts nothing.
    ///
    /// # Panics
    /// When `counts` is not [`CountSat::materials`] long.
    pub fn counts(&self, low: [i64; 3], high: [i64; 3], counts: &mut [u64]) {
        assert_eq!(counts.len(), self.materials, "one count a material");
        counts.fill(0);
        let clip = |v: i64, a: usize| v.clamp(0, i64::from(self.size[a])) as u32;
        let low: [u32; 3] = std::array::from_fn(|a| clip(low[a], a));
        let high: [u32; 3] = std::array::from_fn(|a| clip(high[a], a));
        if (0..3).all(|a| low[a] < high[a]) {
            self.add_counts(low, high, counts);
        }
    }

    fn add_counts(&self, low: [u32; 3], high: [u32; 3], counts: &mut [u64]) {
        let edges: [u64; 3] = std::array::from_fn(|a| u64::from(high[a] - low[a]));
        // Sums are modulo 2^32: a box that may hold more is halved along its longest axis.
        if edges.iter().product::<u64>() >= 1 << 32 {
            let axis = (0..3).max_by_key(|&a| edges[a]).unwrap_or(2);
            let middle = low[axis] + (edges[axis] / 2) as u32;
            let (mut below, mut above) = (high, low);
            below[axis] = middle;
            above[axis] = middle;
            self.add_counts(low, below, counts);
            self.add_counts(above, high, counts);
            return;
        }
        for (tables, counts) in self.groups.iter().zip(counts.chunks_mut(LANES)) {
            let mut sum = [0u32; LANES];
            for corner in 0..8u32 {
                let at = std::array::from_fn(|a| if corner >> a & 1 == 1 { high[a] } else { low[a] });
                let minus = corner.count_ones() % 2 == 0;
                for (sum, p) in sum.iter_mut().zip(tables.prefix(at)) {
                    *sum = if minus { sum.wrapping_sub(p) } else { sum.wrapping_add(p) };
                }
            }
            for (count, sum) in counts.iter_mut().zip(sum) {
                *count += u64::from(sum);
            }
        }
    }

    /// Mean over the box from `low` to `high` (exclusive) of a quantity given per label, label 1
    /// first: a coefficient of one channel in 1/mm, or ones for occupancy. What lies outside the
    /// grid counts as air, with 0. An empty box has mean 0.
    ///
    /// # Panics
    /// When `values` is not [`CountSat::materials`] long.
    pub fn mean(&self, low: [i64; 3], high: [i64; 3], values: &[f64]) -> f64 {
        assert_eq!(values.len(), self.materials, "one value a material");
        let mut counts = [0u64; 255];
        let counts = &mut counts[..self.materials];
        self.counts(low, high, counts);
        let volume: f64 = (0..3).map(|a| high[a].saturating_sub(low[a]).max(0) as f64).product();
        let sum: f64 = counts.iter().zip(values).map(|(&n, v)| n as f64 * v).sum();
        if volume > 0.0 { sum / volume } else { 0.0 }
    }

    /// Bytes held.
    pub fn memory(&self) -> SatMemory {
        let mut out = SatMemory { tiles: 0, records: 0, mixed_tiles: 0 };
        for group in &self.groups {
            let [tiles, records] = group.memory();
            out.tiles += tiles;
            out.records += records;
            out.mixed_tiles += group.records().iter().filter(|r| r.table != 0).count();
        }
        out
    }

    /// The smallest box `low..high` that holds every counted voxel; `None` when there is none.
    pub fn bounds(&self) -> Option<([u32; 3], [u32; 3])> {
        let mut bounds = [(0, 0); 3];
        for (axis, bounds) in bounds.iter_mut().enumerate() {
            let solid = |i: &u32| {
                let (mut low, mut high) = ([0; 3], self.size.map(i64::from));
                (low[axis], high[axis]) = (i64::from(*i), i64::from(*i) + 1);
                let mut counts = [0u64; 255];
                self.counts(low, high, &mut counts[..self.materials]);
                counts.iter().any(|&n| n > 0)
            };
            let low = (0..self.size[axis]).find(solid)?;
            let high = (0..self.size[axis]).rev().find(solid)?;
            *bounds = (low, high + 1);
        }
        Some((bounds.map(|b| b.0), bounds.map(|b| b.1)))
    }
}

/// Refuses labels past the counted ones, in the tiles `only` or in all.
fn check_labels(grid: &LabelGrid, materials: usize, only: Option<&[u32]>) -> Result<(), VoxelError> {
    let largest = |tile: &Tile| match tile {
        Tile::Constant(label) => *label,
        Tile::Dense(labels) => labels.iter().copied().fold(0, u8::max),
    };
    let largest = match only {
        Some(tiles) => tiles.par_iter().map(|&i| largest(&grid.tiles()[i as usize])).max(),
        None => grid.tiles().par_iter().map(largest).max(),
    };
    match largest {
        Some(label) if usize::from(label) > materials => Err(VoxelError::invalid(
            "labels",
            format!(
                "a voxel has label {label} but {materials} materials are counted; count them all or fix the grid"
            ),
        )),
        _ => Ok(()),
    }
}

const _: () = assert!(TILE == 16, "packed local counts need tiles of at most 4096 voxels");
