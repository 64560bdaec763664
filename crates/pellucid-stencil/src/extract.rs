//! Extraction for batches of points.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{Control, CountSat, LabelGrid, TILE};
use rayon::prelude::*;

use crate::axis::Axis;
use crate::kernel::{Plane, Sums, corner_sums};
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
}

/// Where the counts of a level go: once a point and level.
type LevelSink<'s> = &'s mut dyn FnMut(usize, &[u32]);

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
        Ok(Self { spec, grid, sat, bounds: sat.bounds() })
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
        self.run(points, out, row, control, |level, counts, out| {
            coefficients.convert_level(&self.spec, level, counts, out);
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
        let row = self.spec.cells_in_all() * self.sat.materials();
        let part = self.spec.cells_per_level() * self.sat.materials();
        self.run(points, out, row, control, |level, counts, out: &mut [u32]| {
            out[level * part..(level + 1) * part].copy_from_slice(counts);
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
        sink: impl Fn(usize, &[u32], &mut [T]) + Sync,
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
            for batch in group.chunks_mut(BATCH) {
                control.check()?;
                let at: Vec<[u32; 3]> = batch.iter().map(|(p, _)| *p).collect();
                for level in 0..self.spec.levels() {
                    self.level_counts(level, &at, &mut |p, counts| sink(level, counts, batch[p].1));
                }
                control.advance(&done, batch.len() as u64, total);
            }
            Ok(())
        })
    }

    /// Hands `sink` each point's counts at a level, ordered `[cell][material]`.
    fn level_counts(&self, level: usize, points: &[[u32; 3]], sink: LevelSink) {
        let materials = self.sat.materials();
        let cells = self.spec.cells_per_level();
        let mut counts = vec![0u32; points.len() * cells * materials];
        if level == 0 {
            self.first_level(points, &mut counts);
        } else {
            self.coarse_level(level, points, &mut counts);
        }
        for (p, counts) in counts.chunks_exact(cells * materials).enumerate() {
            sink(p, counts);
        }
    }

    /// Cells of single voxels, read from the labels.
    fn first_level(&self, points: &[[u32; 3]], counts: &mut [u32]) {
        let materials = self.sat.materials();
        let [nx, ny, nz] = self.spec.cells();
        let offset = |i: usize, n: usize| i as i64 - (n / 2) as i64;
        let mut cells = counts.chunks_exact_mut(materials);
        for p in points {
            let p = p.map(i64::from);
            for z in 0..nz {
                for y in 0..ny {
                    for x in 0..nx {
                        let at = [p[0] + offset(x, nx), p[1] + offset(y, ny), p[2] + offset(z, nz)];
                        let label = self.grid.at(at);
                        if let (Some(cell), true) = (cells.next(), label > 0) {
                            cell[usize::from(label) - 1] = self.spec.full_count(0);
                        }
                    }
                }
            }
        }
    }

    /// Cells of two and more voxels, from the summed-area table; `counts` are zero at first.
    fn coarse_level(&self, level: usize, points: &[[u32; 3]], counts: &mut [u32]) {
        let Some((low, high)) = self.bounds else { return };
        let cells = self.spec.cells();
        let edge = self.spec.cell_edge(level);
        let axes: [Axis; 3] = std::array::from_fn(|a| {
            Axis::new(cells[a], edge, (low[a], high[a]), points.iter().map(|p| p[a]))
        });
        if axes.iter().any(Axis::beyond) {
            return;
        }
        let materials = self.sat.materials();
        let [nx, ny, nz] = cells;
        let per_plane = (nx + 1) * (ny + 1);
        let mut sums = vec![Sums::default(); points.len() * per_plane];
        let mut before = vec![Sums::default(); points.len() * nx * ny];
        for (g, tables) in self.sat.groups().iter().enumerate() {
            let lanes = (materials - g * LANES).min(LANES);
            for k in 0..=nz {
                let plane = Plane {
                    tables,
                    xs: (0..=nx).map(|i| axes[0].corner(i)).collect(),
                    ys: (0..=ny).map(|j| axes[1].corner(j)).collect(),
                    z: axes[2].corner(k),
                };
                corner_sums(&plane, &mut sums);
                for (p, (sums, before)) in
                    sums.chunks_exact(per_plane).zip(before.chunks_exact_mut(nx * ny)).enumerate()
                {
                    for j in 0..ny {
                        for i in 0..nx {
                            let at = j * (nx + 1) + i;
                            let (a, b, c, d) =
                                (&sums[at], &sums[at + 1], &sums[at + nx + 1], &sums[at + nx + 2]);
                            let column: Sums = std::array::from_fn(|m| {
                                d[m].wrapping_sub(c[m]).wrapping_sub(b[m]).wrapping_add(a[m])
                            });
                            let prior = std::mem::replace(&mut before[j * nx + i], column);
                            if k > 0 {
                                let cell = ((p * nz + k - 1) * ny + j) * nx + i;
                                let to = &mut counts[cell * materials + g * LANES..][..lanes];
                                for (m, to) in to.iter_mut().enumerate() {
                                    *to = column[m].wrapping_sub(prior[m]);
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}
