//! A dense table of the surroundings of a few neighbouring points, for the fine levels.
//!
//! Near-surface points come in neighbourhoods of hundreds a tile, whose fine levels overlap almost
//! wholly. One pass over the labels around them makes a table in which a corner is one look-up:
//! entry (x, y, z) holds, for all five materials of a group in one word, the sum in eighths of a
//! voxel up to the centre of that voxel, modulo 2^64. Where sums start does not matter, as cells
//! are differences.
//!
//! A cell of at most 4096 eighths fits one word, although five counts up to 4096 take 65 bits:
//! materials 1 to 4 have 13 bits each, the fifth the top 12, and is added to the fields of the
//! first two as well. Only a cell full of the fifth overflows its own field, and only that cell
//! shows 4096 in both of the others.

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{LabelGrid, TILE, Tile};

use crate::StencilSpec;
use crate::kernel::{Kernel, Sums};

/// Bits of each of the first four materials.
pub(crate) const FIELD: u32 = 13;
/// Largest count of a cell that the packing holds.
pub(crate) const MAX_COUNT: u32 = 4096;

/// One eighth of a voxel of each material.
pub(crate) const UNITS: [u64; LANES] =
    [1, 1 << FIELD, 1 << (2 * FIELD), 1 << (3 * FIELD), 1 << (4 * FIELD) | 1 << FIELD | 1];

/// The counts of a packed cell.
#[inline(always)]
pub(crate) fn unpack(word: u64) -> Sums {
    const MASK: u64 = (1 << FIELD) - 1;
    let (a, b) = (word & MASK, word >> FIELD & MASK);
    let last = word >> (4 * FIELD) | (a & b & u64::from(MAX_COUNT));
    let (c, d) = (word >> (2 * FIELD) & MASK, word >> (3 * FIELD) & MASK);
    [(a - last) as u32, (b - last) as u32, c as u32, d as u32, last as u32, 0, 0, 0]
}

/// Labels and corner sums of a box of voxels.
#[derive(Default)]
pub(crate) struct Window {
    /// The voxel of entry 0, which may lie outside the grid.
    low: [i64; 3],
    /// Entries along `[x, y, z]`.
    size: [usize; 3],
    labels: Vec<u8>,
    /// Per group, packed sums up to each voxel's centre.
    sums: Vec<Vec<u64>>,
    pair: Vec<u64>,
    /// Packed counts of one point's cells.
    cells: Vec<u64>,
}

impl Window {
    /// Entries that a window for `points` and levels up to `level` takes.
    pub fn entries(spec: &StencilSpec, level: usize, points: &[[u32; 3]]) -> usize {
        bounds(spec, level, points).1.iter().product()
    }

    /// Reads the labels around `points` that their levels up to `level` need.
    pub fn read(&mut self, grid: &LabelGrid, spec: &StencilSpec, level: usize, points: &[[u32; 3]]) {
        (self.low, self.size) = bounds(spec, level, points);
        let [wx, wy, wz] = self.size;
        self.labels.clear();
        self.labels.resize(wx * wy * wz, 0);
        self.sums.clear();
        let [sx, sy, sz] = grid.size().map(i64::from);
        let (from, to) = (self.low[0].max(0), (self.low[0] + wx as i64).min(sx));
        for (row, out) in self.labels.chunks_exact_mut(wx).enumerate() {
            let (y, z) = (self.low[1] + (row % wy) as i64, self.low[2] + (row / wy) as i64);
            if y < 0 || y >= sy || z < 0 || z >= sz {
                continue;
            }
            let mut x = from;
            while x < to {
                let end = ((x / TILE as i64 + 1) * TILE as i64).min(to);
                let t = [x, y, z].map(|v| v as u32 / TILE as u32);
                let out = &mut out[(x - self.low[0]) as usize..(end - self.low[0]) as usize];
                match grid.tile(t) {
                    Tile::Constant(label) => out.fill(*label),
                    Tile::Dense(labels) => {
                        let at = [x, y, z].map(|v| v as usize % TILE);
                        let start = (at[2] * TILE + at[1]) * TILE + at[0];
                        out.copy_from_slice(&labels[start..start + out.len()]);
                    }
                }
                x = end;
            }
        }
    }

    /// Sums the labels read, for each group of materials.
    pub fn sum(&mut self, kernel: Kernel, groups: usize) {
        self.sums.resize(groups, Vec::new());
        for (g, sums) in self.sums.iter_mut().enumerate() {
            let mut lut = [0; 256];
            for (unit, to) in UNITS.iter().zip(&mut lut[1 + g * LANES..]) {
                *to = *unit;
            }
            sums.resize(self.labels.len(), 0);
            kernel.window_sums(self.size, &self.labels, &lut, &mut self.pair, sums);
        }
    }

    /// The label of a voxel that the window covers.
    #[inline(always)]
    pub fn label_row(&self, start: [i64; 3], len: usize) -> &[u8] {
        let at = self.entry(start);
        &self.labels[at..at + len]
    }

    /// Counts of a point's cells at a level above the first that the window covers.
    pub fn cell_counts(
        &mut self,
        kernel: Kernel,
        spec: &StencilSpec,
        level: usize,
        group: usize,
        point: [u32; 3],
        cells: &mut [Sums],
    ) {
        let edge = spec.cell_edge(level) as usize;
        let n = spec.cells();
        let start = std::array::from_fn(|a| i64::from(point[a]) - (edge * n[a] / 2) as i64);
        let strides = [edge, edge * self.size[0], edge * self.size[0] * self.size[1]];
        let sums = &self.sums[group][self.entry(start)..];
        self.cells.resize(cells.len(), 0);
        kernel.window_cells(n, strides, sums, &mut self.cells);
        kernel.unpack(&self.cells, cells);
    }

    #[inline(always)]
    fn entry(&self, voxel: [i64; 3]) -> usize {
        let at: [usize; 3] = std::array::from_fn(|a| (voxel[a] - self.low[a]) as usize);
        debug_assert!((0..3).all(|a| at[a] < self.size[a]));
        (at[2] * self.size[1] + at[1]) * self.size[0] + at[0]
    }
}

/// The first voxel and the entries of the window of some points: those of their corners.
fn bounds(spec: &StencilSpec, level: usize, points: &[[u32; 3]]) -> ([i64; 3], [usize; 3]) {
    let edge = spec.cell_edge(level) as usize;
    let reach = |a: usize| ((edge * spec.cells()[a]) / 2) as i64;
    let range = |a: usize| {
        let values = || points.iter().map(|p| i64::from(p[a]));
        (values().min().unwrap_or(0), values().max().unwrap_or(0))
    };
    let low = std::array::from_fn(|a| range(a).0 - reach(a));
    let size = std::array::from_fn(|a| (range(a).1 - range(a).0 + 2 * reach(a) + 1) as usize);
    (low, size)
}

/// Sums of `units` of the labels over 2 x 2 x 2 voxels, then over all entries up to each one along
/// every axis. `pair` is scratch.
#[inline(always)]
pub(crate) fn sum_labels(
    size: [usize; 3],
    labels: &[u8],
    units: &[u64; 256],
    pair: &mut Vec<u64>,
    sums: &mut [u64],
) {
    let [wx, wy, _] = size;
    let layer = wx * wy;
    // Sums over pairs along y of the layer before, and along x of the row in hand.
    pair.clear();
    pair.resize(layer + 3 * wx, 0);
    let (before, rows) = pair.split_at_mut(layer);
    let (last, rest) = rows.split_at_mut(wx);
    let (row, total) = rest.split_at_mut(wx);
    for (z, labels) in labels.chunks_exact(layer).enumerate() {
        last.fill(0);
        total.fill(0);
        let (done, open) = sums.split_at_mut(z * layer);
        let prior = if z > 0 { &done[(z - 1) * layer..] } else { &[] };
        for y in 0..wy {
            let labels = &labels[y * wx..(y + 1) * wx];
            let before = &mut before[y * wx..(y + 1) * wx];
            let out = &mut open[y * wx..(y + 1) * wx];
            for x in 0..wx {
                row[x] = units[usize::from(labels[x])];
            }
            // Over four rows of voxels.
            for x in 0..wx {
                let here = last[x].wrapping_add(row[x]);
                last[x] = row[x];
                row[x] = here.wrapping_add(before[x]);
                before[x] = here;
            }
            let (mut run, mut left) = (0u64, 0u64);
            for x in 0..wx {
                run = run.wrapping_add(left).wrapping_add(row[x]);
                left = row[x];
                total[x] = total[x].wrapping_add(run);
            }
            match prior.get(y * wx..(y + 1) * wx) {
                Some(prior) => {
                    for x in 0..wx {
                        out[x] = total[x].wrapping_add(prior[x]);
                    }
                }
                None => out.copy_from_slice(total),
            }
        }
    }
}

/// Packed cell counts from packed corner sums, the first corner at `sums[0]`.
#[inline(always)]
pub(crate) fn cells_between(n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [u64]) {
    const MOST: usize = StencilSpec::MAX_CELLS;
    let [nx, ny, nz] = n;
    let mut columns = [0u64; MOST * MOST];
    let (mut near, mut far) = ([0u64; MOST], [0u64; MOST]);
    for k in 0..=nz {
        for j in 0..=ny {
            let row = &sums[k * strides[2] + j * strides[1]..][..nx * strides[0] + 1];
            let mut last = row[0];
            for (far, corner) in far[..nx].iter_mut().zip(row[strides[0]..].iter().step_by(strides[0])) {
                *far = corner.wrapping_sub(last);
                last = *corner;
            }
            if j > 0 {
                let at = (j - 1) * nx;
                for (i, column) in columns[at..at + nx].iter_mut().enumerate() {
                    let new = far[i].wrapping_sub(near[i]);
                    if k > 0 {
                        cells[(k - 1) * nx * ny + at + i] = new.wrapping_sub(*column);
                    }
                    *column = new;
                }
            }
            near = far;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn packing_holds_every_cell(counts in prop::array::uniform5(0u32..=MAX_COUNT), full in 0usize..6) {
            let mut counts = counts;
            // Cut down to what fits one cell, or one material alone.
            let mut left = MAX_COUNT;
            for (m, n) in counts.iter_mut().enumerate() {
                *n = if full == m { left } else if full < 5 { 0 } else { (*n).min(left) };
                left -= *n;
            }
            let word = counts.iter().zip(UNITS).fold(0u64, |w, (&n, u)| w.wrapping_add(u.wrapping_mul(n.into())));
            prop_assert_eq!(&unpack(word)[..LANES], &counts[..]);
        }
    }
}
