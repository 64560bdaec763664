//! Extraction for batches of points.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{Control, CountSat, LabelGrid, TILE};
use rayon::prelude::*;

use crate::axis::{Axis, Extent};
use crate::kernel::{Kernel, Plane, Sums};
use crate::{Coefficients, StencilError, StencilSpec};

/// Points extracted together: enough for neighbours to share table entries in the nearest cache.
const BATCH: usize = 64;

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
        Ok(Self { spec, grid, sat, bounds: sat.bounds(), kernel: Kernel::detect() })
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
        self.run(points, out, row, control, |level, counts, scratch, out| {
            coefficients.convert_level(self.kernel, &self.spec, level, counts, scratch, out);
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
        let (cells, m) = (self.spec.cells_per_level(), self.sat.materials());
        self.run(points, out, self.spec.cells_in_all() * m, control, |level, counts, _, out| {
            let out = &mut out[level * cells * m..(level + 1) * cells * m];
            for (cell, out) in out.chunks_exact_mut(m).enumerate() {
                for (group, out) in out.chunks_mut(LANES).enumerate() {
                    out.copy_from_slice(&counts[group * cells + cell][..out.len()]);
                }
            }
        })
    }

    /// Sorts the points into batches of neighbours, and hands `sink` the counts of every point and
    /// level with the point's row of `out`.
    fn run<T: Send>(
        &self,
        points: &[[u32; 3]],
        out: &mut [T],
        row: usize,
        control: &Control,
        sink: impl Fn(usize, &[Sums], &mut Vec<f32>, &mut [T]) + Sync,
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
        let tile = |p: &[u32; 3]| p.map(|c| c / TILE as u32);
        rows.par_sort_unstable_by_key(|(p, _)| {
            let t = tile(p);
            (t[2], t[1], t[0], p[2], p[1], p[0])
        });
        let done = AtomicU64::new(0);
        let total = points.len() as u64;
        rows.par_chunk_by_mut(|a, b| tile(&a.0) == tile(&b.0)).try_for_each(|group| {
            let mut work = Workspace::default();
            let groups = self.sat.groups().len();
            let cells = self.spec.cells_per_level();
            for batch in group.chunks_mut((BATCH / groups).max(1)) {
                control.check()?;
                work.points.clear();
                work.points.extend(batch.iter().map(|(p, _)| *p));
                work.counts.clear();
                work.counts.resize(batch.len() * groups * cells, Sums::default());
                for level in 0..self.spec.levels() {
                    if level == 0 {
                        self.first_level(&work.points, &mut work.counts);
                    } else {
                        self.coarse_level(level, &mut work);
                    }
                    for ((_, out), counts) in batch.iter_mut().zip(work.counts.chunks_exact(groups * cells)) {
                        sink(level, counts, &mut work.scratch, out);
                    }
                }
                control.advance(&done, batch.len() as u64, total);
            }
            Ok(())
        })
    }

    /// Cells of single voxels, read from the labels.
    fn first_level(&self, points: &[[u32; 3]], counts: &mut [Sums]) {
        let cells = self.spec.cells_per_level();
        let [nx, ny, nz] = self.spec.cells();
        let offset = |i: usize, n: usize| i as i64 - (n / 2) as i64;
        counts.fill(Sums::default());
        for (p, counts) in points.iter().zip(counts.chunks_exact_mut(self.sat.groups().len() * cells)) {
            let p = p.map(i64::from);
            for z in 0..nz {
                for y in 0..ny {
                    for x in 0..nx {
                        let at = [p[0] + offset(x, nx), p[1] + offset(y, ny), p[2] + offset(z, nz)];
                        if let Some(m) = usize::from(self.grid.at(at)).checked_sub(1) {
                            let cell = self.spec.cell_index([x, y, z]);
                            counts[m / LANES * cells + cell][m % LANES] = self.spec.full_count(0);
                        }
                    }
                }
            }
        }
    }

    /// Cells of two and more voxels, from the summed-area table.
    fn coarse_level(&self, level: usize, work: &mut Workspace) {
        let Workspace { points, counts, sums, columns, .. } = work;
        let Some((low, high)) = self.bounds else { return counts.fill(Sums::default()) };
        let n = self.spec.cells();
        let edge = self.spec.cell_edge(level);
        let size = self.grid.size();
        let strides = self.sat.groups()[0].strides();
        let axes: [Axis; 3] = std::array::from_fn(|a| {
            let extent = Extent { size: size[a], low: low[a], high: high[a], stride: strides[a] };
            Axis::new(n[a], edge, extent, points.iter().map(|p| p[a]))
        });
        if axes.iter().any(Axis::beyond) {
            return counts.fill(Sums::default());
        }
        let [nx, ny, nz] = n;
        let (per_plane, layer, cells) = ((nx + 1) * (ny + 1), nx * ny, nx * ny * nz);
        sums.resize(points.len() * per_plane, Sums::default());
        columns.resize(points.len() * layer, Sums::default());
        let groups = self.sat.groups();
        for (g, tables) in groups.iter().enumerate() {
            for k in 0..=nz {
                let plane = Plane {
                    tables,
                    xs: (0..=nx).map(|i| axes[0].corner(i)).collect(),
                    ys: (0..=ny).map(|j| axes[1].corner(j)).collect(),
                    z: axes[2].corner(k),
                };
                self.kernel.corner_sums(&plane, sums);
                for (p, (sums, columns)) in
                    sums.chunks_exact(per_plane).zip(columns.chunks_exact_mut(layer)).enumerate()
                {
                    let start = (p * groups.len() + g) * cells;
                    let between = k.checked_sub(1).map(|k| &mut counts[start + k * layer..][..layer]);
                    self.kernel.cell_counts(nx, sums, columns, between);
                }
            }
        }
    }
}

/// Buffers of one thread, reused from batch to batch.
#[derive(Default)]
struct Workspace {
    points: Vec<[u32; 3]>,
    /// Ordered `[point][group][cell]`.
    counts: Vec<Sums>,
    /// Ordered `[point][y corner][x corner]`.
    sums: Vec<Sums>,
    /// Ordered `[point][y cell][x cell]`.
    columns: Vec<Sums>,
    scratch: Vec<f32>,
}
