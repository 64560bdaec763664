//! Extraction for batches of points.

use std::ops::Range;
use std::sync::atomic::AtomicU64;

use pellucid_core::InstructionSet;
use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{Control, CountSat, LabelGrid, TILE, near_key};
use rayon::prelude::*;

use crate::changed::ChangedTiles;
use crate::kernel::{Kernel, Sums};
use crate::levels::{Levels, Workspace};
use crate::{Coefficients, StencilError, StencilSpec};

/// Points of one task, worked on level by level.
const TASK: usize = 2048;
/// Points whose corners are summed together: enough for neighbours to share table entries in the
/// nearer caches, few enough for their sums to stay there too.
const BATCH: usize = 1024;

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
    levels: Levels<'a>,
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
        let kernel = Kernel::of(InstructionSet::chosen());
        Ok(Self { levels: Levels::new(spec, grid, sat, kernel) })
    }

    /// The same on another instruction set than [`InstructionSet::chosen`]. All give the same bits.
    ///
    /// # Errors
    /// [`StencilError::Unsupported`] where the processor lacks it.
    pub fn with_instruction_set(mut self, set: InstructionSet) -> Result<Self, StencilError> {
        self.levels.kernel = Kernel::of(set.require().map_err(StencilError::Unsupported)?);
        Ok(self)
    }

    /// The instruction set in use: the best one that the kernels have a form for and that is not above the one asked
    /// for.
    pub fn instruction_set(&self) -> InstructionSet {
        self.levels.kernel.instruction_set()
    }

    /// The geometry.
    pub fn spec(&self) -> &StencilSpec {
        &self.levels.spec
    }

    /// Writes the descriptors of `points`, voxel coordinates `[x, y, z]` within the grid, to
    /// `out`, ordered `[point][channel][level][cell z][cell y][cell x][feature]` with features
    /// sigma_s, sigma_a in 1/mm and, where asked for, occupancy. Parallel over points.
    ///
    /// Memory beyond `out` is some 2 MB a thread, so any number of points may be asked for;
    /// neighbouring points in one call are cheaper than scattered ones, in any order.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when a point lies outside the grid, `out` has another length than
    /// points times [`Coefficients::values_per_point`], or the table counts other materials;
    /// [`StencilError::Cancelled`].
    pub fn extract(
        &self,
        coefficients: &Coefficients,
        points: &[[u32; 3]],
        out: &mut [f32],
        control: &Control,
    ) -> Result<(), StencilError> {
        self.check_materials(coefficients)?;
        let row = coefficients.values_per_point(&self.levels.spec);
        self.run(
            points,
            out,
            row,
            control,
            |_| 0,
            |cells, counts, out| {
                coefficients.convert_cells(self.levels.kernel, &self.levels.spec, cells, counts, out);
            },
        )
    }

    /// Brings the descriptors of `points` in `out`, extracted before some tiles changed, up to
    /// date: a level is extracted again only where its boxes meet a changed tile. Equal to
    /// [`Stencils::extract`], bit for bit, when `out` was.
    ///
    /// # Errors
    /// As [`Stencils::extract`], and [`StencilError::Invalid`] when `changed` is of another grid.
    pub fn refresh(
        &self,
        coefficients: &Coefficients,
        points: &[[u32; 3]],
        changed: &ChangedTiles,
        out: &mut [f32],
        control: &Control,
    ) -> Result<(), StencilError> {
        self.check_materials(coefficients)?;
        if changed.grid_size() != self.levels.grid.size() {
            return Err(StencilError::invalid("changed tiles", "they belong to a grid of another size"));
        }
        let row = coefficients.values_per_point(&self.levels.spec);
        let first = |point| changed.first_level(&self.levels.spec, point);
        self.run(points, out, row, control, first, |cells, counts, out| {
            coefficients.convert_cells(self.levels.kernel, &self.levels.spec, cells, counts, out);
        })
    }

    fn check_materials(&self, coefficients: &Coefficients) -> Result<(), StencilError> {
        if coefficients.materials() == self.levels.sat.materials() {
            return Ok(());
        }
        Err(StencilError::invalid(
            "coefficients",
            format!(
                "{} materials where {} are counted; build both from one material table",
                coefficients.materials(),
                self.levels.sat.materials()
            ),
        ))
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
        let m = self.levels.sat.materials();
        self.run(
            points,
            out,
            self.levels.spec.cells_in_all() * m,
            control,
            |_| 0,
            |cells, counts, out| {
                for (cell, out) in out[cells.start * m..cells.end * m].chunks_exact_mut(m).enumerate() {
                    for (group, out) in out.chunks_mut(LANES).enumerate() {
                        out.copy_from_slice(&counts[group * cells.len() + cell][..out.len()]);
                    }
                }
            },
        )
    }

    /// Sorts the points into batches of neighbours and, from each point's first level on, hands
    /// `sink` ranges of each point's cells over all levels with their counts, ordered `[group][cell]`, and the point's row of `out`.
    fn run<T: Send>(
        &self,
        points: &[[u32; 3]],
        out: &mut [T],
        row: usize,
        control: &Control,
        first_level: impl Fn([u32; 3]) -> usize + Sync,
        sink: impl Fn(Range<usize>, &[Sums], &mut [T]) + Sync,
    ) -> Result<(), StencilError> {
        let size = self.levels.grid.size();
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
        rows.par_sort_by_cached_key(|(p, _)| near_key(*p));
        let done = AtomicU64::new(0);
        let total = points.len() as u64;
        // Enough tasks for every thread; the split changes no value.
        let task = points.len().div_ceil(4 * rayon::current_num_threads()).clamp(64, TASK);
        let batch = (BATCH / self.levels.sat.groups().len()).max(1);
        rows.par_chunks_mut(task).try_for_each_init(Workspace::default, |work, rows| {
            let tile = |row: &([u32; 3], &mut [T])| row.0.map(|c| c / TILE as u32);
            work.first.clear();
            work.first.extend(rows.iter().map(|(p, _)| first_level(*p)));
            let mut start = 0;
            for rows in rows.chunk_by_mut(|a, b| tile(a) == tile(b)) {
                control.check()?;
                work.take_points(rows, start, self.levels.fine);
                self.levels.fine(work, |row, cells, counts| sink(cells, counts, rows[row].1));
                start += rows.len();
            }
            // Level by level: neighbouring batches share most of what a level looks up.
            for level in self.levels.fine..self.levels.spec.levels() {
                if self.levels.spec.cell_edge(level).is_multiple_of(TILE as u32) {
                    control.check()?;
                    work.take_points(rows, 0, level + 1);
                    self.levels.coarse(level, work, |row, cells, counts| sink(cells, counts, rows[row].1));
                    continue;
                }
                for (i, rows) in rows.chunks_mut(batch).enumerate() {
                    control.check()?;
                    work.take_points(rows, i * batch, level + 1);
                    self.levels.level(level, work, |row, cells, counts| sink(cells, counts, rows[row].1));
                }
            }
            control.advance(&done, rows.len() as u64, total);
            Ok(())
        })
    }
}
