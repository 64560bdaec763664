//! A dense table of the surroundings of a few neighbouring points, for the fine levels.
//!
//! Near-surface points come in neighbourhoods of hundreds a tile, whose fine levels overlap almost
//! wholly. One pass over the labels around them makes a table in which a corner is one look-up:
//! entry (x, y, z) holds, for all five materials of a group in one word
//! ([`crate::kernel::packed`]), the sum in eighths of a
//! voxel up to the centre of that voxel, modulo 2^64. Where sums start does not matter, as cells
//! are differences.

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{LabelGrid, TILE, Tile};

use crate::StencilSpec;
use crate::kernel::{Kernel, Sums, packed};

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
            for (unit, to) in packed::UNITS.iter().zip(&mut lut[1 + g * LANES..]) {
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
