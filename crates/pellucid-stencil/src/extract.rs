//! Extraction for batches of points.

use std::ops::Range;
use std::sync::atomic::AtomicU64;

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{Control, CountSat, LabelGrid, TILE};
use rayon::prelude::*;

use crate::axis::{Axis, Extent};
use crate::kernel::{Kernel, Plane, Sums};
use crate::window::{self, Window};
use crate::{Coefficients, StencilError, StencilSpec};

/// Points extracted together: enough for neighbours to share table entries in the nearest cache.
const BATCH: usize = 1024;
/// What an entry of a window costs to make, and a corner to look up, in the same unit.
const ENTRY_COST: usize = 1;
const CORNER_COST: usize = 20;

/// Extracts the stencils of one volume.
///
/// ```
/// use pellucid_stencil::{Coefficients, Features, StencilSpec, Stencils};
/// use pellucid_voxel::{Control, CountSat, Frame, LabelGrid, MaterialTable, Pitch, Tile};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [32, 32, 32]).unwrap();
/// let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5)); // a block of white
/// let sat = CountSat::build(&grid, 5, &Control::none()).unwrap();
/// let stencils = Stencils::new(StencilSpec::paper(), &grid, &sat).unwrap();
///
/// let table = MaterialTable::cmykw();
/// let coefficients = Coefficients::new(&table, &[0, 1, 2], Features::ScatterAbsorb).unwrap();
/// let points = [[16, 16, 31]];
/// let mut out = vec![0.0; points.len() * coefficients.values_per_point(stencils.spec())];
/// stencils.extract(&coefficients, &points, &mut out, &Control::none()).unwrap();
/// // Channel R, level 1, the cell around the point: the scattering coefficient of white.
/// assert_eq!(out[67 * 2], table.get(5).unwrap().sigma_s[0]);
/// ```
pub struct Stencils<'a> {
    spec: StencilSpec,
    grid: &'a LabelGrid,
    sat: &'a CountSat,
    bounds: Option<([u32; 3], [u32; 3])>,
    kernel: Kernel,
    /// Levels that a window can hold.
    fine_levels: usize,
}

impl<'a> Stencils<'a> {
    /// The stencils of `grid`, whose table is `sat`.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when the grid and the table differ in size.
    pub fn new(spec: StencilSpec, grid: &'a LabelGrid, sat: &'a CountSat) -> Result<Self, StencilError> {
        if grid.size() != sat.size() {
            return Err(StencilError::invalid(
                "summed-area table",
                format!("{:?} voxels for a grid of {:?}; build it from this grid", sat.size(), grid.size()),
            ));
        }
        let fine_levels = (0..spec.levels()).filter(|&l| spec.full_count(l) <= window::MAX_COUNT).count();
        Ok(Self { fine_levels, spec, grid, sat, bounds: sat.bounds(), kernel: Kernel::detect() })
    }

    /// The geometry.
    pub fn spec(&self) -> &StencilSpec {
        &self.spec
    }

    /// Writes the descriptors of `points`, voxel coordinates `[x, y, z]` within the grid, to
    /// `out`, ordered `[point][channel][level][cell z][cell y][cell x][feature]` with features
    /// sigma_s, sigma_a in 1/mm and, where asked for, occupancy. Parallel over points.
    ///
    /// Memory beyond `out` is a few hundred kB a thread, so any number of points may be asked for;
    /// neighbouring points in one call are cheaper than scattered ones, in any order.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when a point lies outside the grid, `out` has another length than
    /// points times [`Coefficients::values_per_point`], or the table counts other materials;
    /// [`StencilError::Voxel`] when cancelled.
    pub fn extract(
        &self,
        coefficients: &Coefficients,
        points: &[[u32; 3]],
        out: &mut [f32],
        control: &Control,
    ) -> Result<(), StencilError> {
        if coefficients.materials() != self.sat.materials() {
            return Err(StencilError::invalid(
                "coefficients",
                format!(
                    "{} materials where {} are counted; build both from one material table",
                    coefficients.materials(),
                    self.sat.materials()
                ),
            ));
        }
        let row = coefficients.values_per_point(&self.spec);
        self.run(points, out, row, control, |cells, counts, out| {
            coefficients.convert_cells(self.kernel, &self.spec, cells, counts, out);
        })
    }

    /// Writes the counts of `points` to `out`, ordered
    /// `[point][level][cell z][cell y][cell x][material]`, in eighths of a voxel: a cell full of
    /// one material at level `k` holds [`StencilSpec::full_count`]. Shared by all channels:
    /// [`Coefficients::convert`] makes descriptors from them.
    ///
    /// # Errors
    /// As [`Stencils::extract`]; a point takes cells times materials counts.
    pub fn extract_counts(
        &self,
        points: &[[u32; 3]],
        out: &mut [u32],
        control: &Control,
    ) -> Result<(), StencilError> {
        let m = self.sat.materials();
        self.run(points, out, self.spec.cells_in_all() * m, control, |cells, counts, out| {
            for (cell, out) in out[cells.start * m..cells.end * m].chunks_exact_mut(m).enumerate() {
                for (group, out) in out.chunks_mut(LANES).enumerate() {
                    out.copy_from_slice(&counts[group * cells.len() + cell][..out.len()]);
                }
            }
        })
    }

    /// Sorts the points into batches of neighbours, and hands `sink` ranges of each point's cells
    /// over all levels with their counts, ordered `[group][cell]`, and the point's row of `out`.
    fn run<T: Send>(
        &self,
        points: &[[u32; 3]],
        out: &mut [T],
        row: usize,
        control: &Control,
        sink: impl Fn(Range<usize>, &[Sums], &mut [T]) + Sync,
    ) -> Result<(), StencilError> {
        let size = self.grid.size();
        if let Some(p) = points.iter().find(|p| (0..3).any(|a| p[a] >= size[a])) {
            return Err(StencilError::invalid("points", format!("{p:?} lies outside the grid {size:?}")));
        }
        if out.len() != points.len() * row {
            return Err(StencilError::invalid(
                "output",
                format!("{} values for {} points of {row}", out.len(), points.len()),
            ));
        }
        let mut rows: Vec<([u32; 3], &mut [T])> =
            points.iter().copied().zip(out.chunks_exact_mut(row)).collect();
        rows.par_sort_by_cached_key(|(p, _)| (along_curve(p.map(|c| c / TILE as u32)), p[2], p[1], p[0]));
        let done = AtomicU64::new(0);
        let total = points.len() as u64;
        // Enough batches for every thread; the split changes no value.
        let batch = points.len().div_ceil(4 * rayon::current_num_threads()).clamp(64, BATCH);
        let batch = (batch / self.sat.groups().len()).max(1);
        rows.par_chunks_mut(batch).try_for_each_init(Workspace::default, |work, rows| {
            let tile = |row: &([u32; 3], &mut [T])| row.0.map(|c| c / TILE as u32);
            for rows in rows.chunk_by_mut(|a, b| tile(a) == tile(b)) {
                control.check()?;
                work.take_points(rows);
                let fine = self.fine_levels(&work.points);
                self.window_levels(0..fine, work, |p, cells, counts| sink(cells, counts, rows[p].1));
                for level in fine..self.fine_levels {
                    self.coarse_level(level, work, |p, cells, counts| sink(cells, counts, rows[p].1));
                }
            }
            work.take_points(rows);
            for level in self.fine_levels..self.spec.levels() {
                control.check()?;
                self.coarse_level(level, work, |p, cells, counts| sink(cells, counts, rows[p].1));
            }
            control.advance(&done, rows.len() as u64, total);
            Ok(())
        })
    }

    /// How many levels of some points of a tile are cheaper from a window around them than from the
    /// summed-area table; at least the first, which is read from the labels.
    fn fine_levels(&self, points: &[[u32; 3]]) -> usize {
        let corners: usize = self.spec.cells().iter().map(|n| n + 1).product();
        let cheaper = |level: usize| {
            let entries = Window::entries(&self.spec, level, points);
            entries * ENTRY_COST <= points.len() * corners * level * CORNER_COST
        };
        (1..self.fine_levels).rev().find(|&level| cheaper(level)).unwrap_or(0) + 1
    }

    /// The first levels, from a window around the points.
    fn window_levels(
        &self,
        levels: Range<usize>,
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let Workspace { points, counts, window, .. } = work;
        let (cells, groups) = (self.spec.cells_per_level(), self.sat.groups().len());
        window.read(self.grid, &self.spec, levels.end - 1, points);
        if levels.end > 1 {
            window.sum(self.kernel, groups);
        }
        counts.clear();
        counts.resize(groups * cells, Sums::default());
        let [nx, ny, nz] = self.spec.cells();
        for (i, p) in points.iter().enumerate() {
            counts.fill(Sums::default());
            let low = [nx, ny, nz].map(|n| (n / 2) as i64);
            for z in 0..nz {
                for y in 0..ny {
                    let steps = [0, y as i64, z as i64];
                    let start = std::array::from_fn(|a| i64::from(p[a]) - low[a] + steps[a]);
                    let first = self.spec.cell_index([0, y, z]);
                    for (x, &label) in window.label_row(start, nx).iter().enumerate() {
                        if let Some(m) = usize::from(label).checked_sub(1) {
                            counts[m / LANES * cells + first + x][m % LANES] = self.spec.full_count(0);
                        }
                    }
                }
            }
            sink(i, 0..cells, counts);
            for level in 1..levels.end {
                for (g, counts) in counts.chunks_exact_mut(cells).enumerate() {
                    window.cell_counts(self.kernel, &self.spec, level, g, *p, counts);
                }
                sink(i, level * cells..(level + 1) * cells, counts);
            }
        }
    }

    /// Cells of two and more voxels, from the summed-area table, layer by layer.
    fn coarse_level(
        &self,
        level: usize,
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let Workspace { points, counts, sums, columns, .. } = work;
        let n = self.spec.cells();
        let (cells, first) = (self.spec.cells_per_level(), level * self.spec.cells_per_level());
        let groups = self.sat.groups();
        let edge = self.spec.cell_edge(level);
        let size = self.grid.size();
        let strides = groups[0].strides();
        let (low, high) = self.bounds.unwrap_or_default();
        let axes: [Axis; 3] = std::array::from_fn(|a| {
            let extent = Extent { size: size[a], low: low[a], high: high[a], stride: strides[a] };
            Axis::new(n[a], edge, extent, points.iter().map(|p| p[a]))
        });
        if self.bounds.is_none() || axes.iter().any(Axis::beyond) {
            counts.clear();
            counts.resize(groups.len() * cells, Sums::default());
            (0..points.len()).for_each(|p| sink(p, first..first + cells, counts));
            return;
        }
        let [nx, ny, nz] = n;
        let (per_plane, layer) = ((nx + 1) * (ny + 1), nx * ny);
        sums.resize(groups.len() * points.len() * per_plane, Sums::default());
        columns.resize(points.len() * groups.len() * layer, Sums::default());
        counts.resize(groups.len() * layer, Sums::default());
        for k in 0..=nz {
            for (tables, sums) in groups.iter().zip(sums.chunks_exact_mut(points.len() * per_plane)) {
                let plane = Plane {
                    tables,
                    xs: (0..=nx).map(|i| axes[0].corner(i)).collect(),
                    ys: (0..=ny).map(|j| axes[1].corner(j)).collect(),
                    z: axes[2].corner(k),
                };
                self.kernel.corner_sums(&plane, sums);
            }
            for (p, columns) in columns.chunks_exact_mut(groups.len() * layer).enumerate() {
                for (g, (columns, counts)) in
                    columns.chunks_exact_mut(layer).zip(counts.chunks_exact_mut(layer)).enumerate()
                {
                    let sums = &sums[(g * points.len() + p) * per_plane..][..per_plane];
                    self.kernel.cell_counts(nx, sums, columns, counts);
                }
                if k > 0 {
                    let start = first + (k - 1) * layer;
                    sink(p, start..start + layer, counts);
                }
            }
        }
    }
}

/// A position along a space-filling curve (Morton's), so that neighbours come close together.
fn along_curve(tile: [u32; 3]) -> u64 {
    let spread = |v: u32| (0..u32::BITS - 11).fold(0u64, |s, bit| s | u64::from(v >> bit & 1) << (3 * bit));
    spread(tile[0]) | spread(tile[1]) << 1 | spread(tile[2]) << 2
}

/// Buffers of one thread, reused from batch to batch.
#[derive(Default)]
struct Workspace {
    points: Vec<[u32; 3]>,
    /// Counts of one point, ordered `[group][cell]`.
    counts: Vec<Sums>,
    /// Ordered `[group][point][y corner][x corner]`.
    sums: Vec<Sums>,
    /// Ordered `[point][group][y cell][x cell]`.
    columns: Vec<Sums>,
    window: Window,
}

impl Workspace {
    fn take_points<T>(&mut self, rows: &[([u32; 3], T)]) {
        self.points.clear();
        self.points.extend(rows.iter().map(|(p, _)| *p));
    }
}
