//! The counts of single levels, by the cheapest way that is exact.
//!
//! | way | when |
//! | --- | --- |
//! | nothing but zeros | every box of the level lies beyond the object |
//! | one count for all cells | the boxes meet constant tiles of one label only |
//! | window | fine levels of points close together ([`crate::window`]) |
//! | summed-area table, tile by tile | levels whose cells are whole tiles, several points of a tile ([`crate::lattice`]) |
//! | summed-area table | else; corners before and past the object are not looked up |

use std::ops::Range;

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{AIR, CountSat, LabelGrid, TILE, Tile};

use crate::StencilSpec;
use crate::axis::{Axis, Extent};
use crate::kernel::{Cells, Kernel, Pass, Plane, Sums, packed};
use crate::lattice::{Corners, Member};
use crate::window::Window;

/// What an entry of a window costs to make, and a corner to look up, in the same unit.
const ENTRY_COST: usize = 1;
const CORNER_COST: usize = 20;

/// Points of a group below which finding what its corners look up does not pay.
const SMALL_GROUP: usize = 4;
/// Most points of a group.
const GROUP: usize = 128;
/// Most points whose corners are looked up one by one.
const BATCH: usize = 256;

/// Buffers of one thread, reused from batch to batch.
#[derive(Default)]
pub(crate) struct Workspace {
    /// First level wanted of each point of the task.
    pub first: Vec<usize>,
    pub points: Vec<[u32; 3]>,
    /// Which row each point belongs to.
    rows: Vec<usize>,
    /// Counts of one point, ordered `[group][cell]`.
    counts: Vec<Sums>,
    /// Ordered `[group][point][y corner][x corner]`.
    sums: Vec<Sums>,
    /// Ordered `[point][group][y cell][x cell]`.
    columns: Vec<Sums>,
    window: Window,
}

impl Workspace {
    /// Takes the members of `points` and `rows`.
    fn take(&mut self, members: &[Member], points: &[[u32; 3]], rows: &[usize]) {
        self.points.clear();
        self.points.extend(members.iter().map(|m| points[m.index as usize]));
        self.rows.clear();
        self.rows.extend(members.iter().map(|m| rows[m.index as usize]));
    }

    /// Takes the points of `rows`, the first of which is number `start` of the task, that want a
    /// level below `end`.
    pub fn take_points<T>(&mut self, rows: &[([u32; 3], T)], start: usize, end: usize) {
        self.points.clear();
        self.rows.clear();
        for (row, ((point, _), first)) in rows.iter().zip(&self.first[start..]).enumerate() {
            if *first < end {
                self.points.push(*point);
                self.rows.push(row);
            }
        }
    }
}

/// Geometry, volume and kernel: all that the counts of a level follow from.
pub(crate) struct Levels<'a> {
    pub spec: StencilSpec,
    pub grid: &'a LabelGrid,
    pub sat: &'a CountSat,
    pub kernel: Kernel,
    /// The box that holds every solid voxel.
    bounds: Option<([u32; 3], [u32; 3])>,
    /// Levels that a window can hold.
    pub fine: usize,
}

impl<'a> Levels<'a> {
    /// Of a grid and its table, which have one size.
    pub fn new(spec: StencilSpec, grid: &'a LabelGrid, sat: &'a CountSat, kernel: Kernel) -> Self {
        let fine = (0..spec.levels()).filter(|&l| spec.full_count(l) <= packed::MAX_COUNT).count();
        Self { bounds: sat.bounds(), spec, grid, sat, kernel, fine }
    }

    /// The levels that a window can hold, of points of one tile. `sink` gets the row, a range of
    /// cells over all levels and their counts, ordered `[group][cell]`.
    pub fn fine(&self, work: &mut Workspace, mut sink: impl FnMut(usize, Range<usize>, &[Sums])) {
        if work.points.is_empty() {
            return;
        }
        let mut levels = self.window_levels(&work.points);
        if let Some(label) = self.uniform(levels - 1, &work.points) {
            (0..levels).for_each(|level| self.fill(level, label, work, &mut sink));
        } else {
            self.with_window(levels, work, &mut sink);
        }
        while levels < self.fine {
            self.level(levels, work, &mut sink);
            levels += 1;
        }
    }

    /// One level above the first; `sink` as in [`Levels::fine`].
    pub fn level(
        &self,
        level: usize,
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        if work.points.is_empty() {
            return;
        }
        match self.uniform(level, &work.points) {
            Some(label) => self.fill(level, label, work, &mut sink),
            None => self.with_table(level, work, sink),
        }
    }

    /// A level whose cells are whole tiles long, group by group; `sink` as in [`Levels::fine`].
    pub fn coarse(
        &self,
        level: usize,
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let edge = self.spec.cell_edge(level);
        let (points, rows) = (std::mem::take(&mut work.points), std::mem::take(&mut work.rows));
        let mut members: Vec<Member> =
            points.iter().enumerate().map(|(i, &p)| Member::new(p, i, self.spec.cells(), edge)).collect();
        // In a tile, points that reach into no next one come first.
        members.sort_unstable_by_key(|m| {
            let [x, y, z] = m.tile;
            (z, y, x, m.split() != 0, m.place[2], m.place[1], m.place[0])
        });
        let mut few = Vec::new();
        for group in members.chunk_by(|a, b| a.tile == b.tile) {
            if group.len() < SMALL_GROUP {
                few.extend_from_slice(group);
                continue;
            }
            for group in group.chunks((GROUP / self.sat.groups().len()).max(8)) {
                work.take(group, &points, &rows);
                match self.uniform(level, &work.points) {
                    Some(label) => self.fill(level, label, work, &mut sink),
                    None => self.with_lattice(level, group, work, &mut sink),
                }
            }
        }
        for group in few.chunks(BATCH) {
            work.take(group, &points, &rows);
            self.level(level, work, &mut sink);
        }
        (work.points, work.rows) = (points, rows);
    }

    /// Points whose corners lie in the same tiles.
    fn with_lattice(
        &self,
        level: usize,
        group: &[Member],
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let Workspace { rows, counts, sums, columns, .. } = work;
        let n = self.spec.cells();
        let cells = self.spec.cells_per_level();
        let range = level * cells..(level + 1) * cells;
        let groups = self.sat.groups();
        let points = group.len();
        counts.clear();
        counts.resize(points * groups.len() * cells, Sums::default());
        let axes: [Option<Corners>; 3] = std::array::from_fn(|a| {
            let tile = group.first()?.tile[a];
            Corners::new(n[a], self.spec.cell_edge(level), tile.into(), self.extent(a)?)
        });
        let [Some(x), Some(y), Some(z)] = axes else {
            rows.iter().for_each(|&row| sink(row, range.clone(), &counts[..groups.len() * cells]));
            return;
        };
        let axes = [x, y, z];
        let lead = [0, 1, 2].map(|a: usize| usize::from(axes[a].lead));
        let [mx, my] = [axes[0].len(), axes[1].len()];
        for (g, tables) in groups.iter().enumerate() {
            let mut passes: Vec<Pass> =
                (0..8).filter_map(|next| Pass::new(tables, self.grid.size(), &axes, group, next)).collect();
            columns.clear();
            columns.resize((mx - 1) * (my - 1) * points, Sums::default());
            for k in 0..axes[2].len() - lead[2] {
                sums.clear();
                sums.resize(mx * my * points, Sums::default());
                for pass in &mut passes {
                    self.kernel.plane_sums(pass, points, k, [lead[0], lead[1]], mx, sums);
                }
                // The first plane has no cells before it, unless nothing lies there.
                let layer = (axes[2].first_cell + k + lead[2]).checked_sub(1);
                let first = [axes[0].first_cell, axes[1].first_cell, layer.unwrap_or(0)];
                let between = Cells {
                    corners: [mx, my],
                    points,
                    first: g * cells + self.spec.cell_index(first),
                    width: n[0],
                    stride: groups.len() * cells,
                };
                self.kernel.plane_cells(&between, sums, columns, counts);
            }
        }
        for (&row, counts) in rows.iter().zip(counts.chunks_exact(groups.len() * cells)) {
            sink(row, range.clone(), counts);
        }
    }

    /// The axis as the table sees it; `None` where the volume is empty.
    fn extent(&self, axis: usize) -> Option<Extent> {
        let (low, high) = self.bounds?;
        let stride = self.sat.groups()[0].strides()[axis];
        Some(Extent { size: self.grid.size()[axis], low: low[axis], high: high[axis], stride })
    }

    /// The label of all that the boxes of a level meet, where whole tiles show that it is one.
    fn uniform(&self, level: usize, points: &[[u32; 3]]) -> Option<u8> {
        let edge = i64::from(self.spec.cell_edge(level));
        let size = self.grid.size();
        let (mut low, mut high) = ([0; 3], [0; 3]);
        let mut outside = false;
        for a in 0..3 {
            let reach = edge * self.spec.cells()[a] as i64 / 2;
            let from = points.iter().map(|p| i64::from(p[a])).min()? - reach;
            let to = points.iter().map(|p| i64::from(p[a])).max()? + reach + 1;
            outside |= from < 0 || to > i64::from(size[a]);
            low[a] = from.max(0) as u32 / TILE as u32;
            high[a] = (to.min(i64::from(size[a])) as u32).div_ceil(TILE as u32);
        }
        let mut seen = outside.then_some(AIR);
        for z in low[2]..high[2] {
            for y in low[1]..high[1] {
                for x in low[0]..high[0] {
                    let Tile::Constant(label) = *self.grid.tile([x, y, z]) else { return None };
                    if *seen.get_or_insert(label) != label {
                        return None;
                    }
                }
            }
        }
        seen
    }

    /// A level whose cells are full of one label.
    fn fill(
        &self,
        level: usize,
        label: u8,
        work: &mut Workspace,
        sink: &mut impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let cells = self.spec.cells_per_level();
        work.counts.clear();
        work.counts.resize(self.sat.groups().len() * cells, Sums::default());
        if let Some(m) = usize::from(label).checked_sub(1) {
            for cell in &mut work.counts[m / LANES * cells..(m / LANES + 1) * cells] {
                cell[m % LANES] = self.spec.full_count(level);
            }
        }
        for &row in &work.rows {
            sink(row, level * cells..(level + 1) * cells, &work.counts);
        }
    }

    /// How many levels of some points of a tile are cheaper from a window around them than from the
    /// summed-area table; at least the first, which is read from the labels.
    fn window_levels(&self, points: &[[u32; 3]]) -> usize {
        let corners: usize = self.spec.cells().iter().map(|n| n + 1).product();
        let cheaper = |level: usize| {
            let entries = Window::entries(&self.spec, level, points);
            entries * ENTRY_COST <= points.len() * corners * level * CORNER_COST
        };
        (1..self.fine).rev().find(|&level| cheaper(level)).unwrap_or(0) + 1
    }

    /// The first levels, from a window around the points.
    fn with_window(
        &self,
        levels: usize,
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let Workspace { points, rows, counts, window, .. } = work;
        let (cells, groups) = (self.spec.cells_per_level(), self.sat.groups().len());
        window.read(self.grid, &self.spec, levels - 1, points);
        if levels > 1 {
            window.sum(self.kernel, groups);
        }
        counts.clear();
        counts.resize(groups * cells, Sums::default());
        let [nx, ny, nz] = self.spec.cells();
        for (p, &row) in points.iter().zip(rows.iter()) {
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
            sink(row, 0..cells, counts);
            for level in 1..levels {
                for (g, counts) in counts.chunks_exact_mut(cells).enumerate() {
                    window.cell_counts(self.kernel, &self.spec, level, g, *p, counts);
                }
                sink(row, level * cells..(level + 1) * cells, counts);
            }
        }
    }

    /// Cells of two and more voxels, from the summed-area table, layer by layer.
    fn with_table(
        &self,
        level: usize,
        work: &mut Workspace,
        mut sink: impl FnMut(usize, Range<usize>, &[Sums]),
    ) {
        let Workspace { points, rows, counts, sums, columns, .. } = work;
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
            rows.iter().for_each(|&row| sink(row, first..first + cells, counts));
            return;
        }
        let [nx, ny, nz] = n;
        let (per_plane, layer) = ((nx + 1) * (ny + 1), nx * ny);
        sums.resize(groups.len() * points.len() * per_plane, Sums::default());
        columns.resize(points.len() * groups.len() * layer, Sums::default());
        counts.resize(groups.len() * layer, Sums::default());
        for k in 0..=nz {
            let start = (k > 0).then(|| first + (k - 1) * layer);
            if axes[2].still(k) {
                // No sum changes: the cells between hold nothing.
                if let Some(start) = start {
                    counts.fill(Sums::default());
                    rows.iter().for_each(|&row| sink(row, start..start + layer, counts));
                } else {
                    sums.fill(Sums::default());
                    columns.fill(Sums::default());
                }
                continue;
            }
            for (tables, sums) in groups.iter().zip(sums.chunks_exact_mut(points.len() * per_plane)) {
                let plane = Plane { tables, axes: &axes, n: [nx + 1, ny + 1], k };
                self.kernel.corner_sums(&plane, sums);
            }
            for (p, columns) in columns.chunks_exact_mut(groups.len() * layer).enumerate() {
                for (g, (columns, counts)) in
                    columns.chunks_exact_mut(layer).zip(counts.chunks_exact_mut(layer)).enumerate()
                {
                    let sums = &sums[(g * points.len() + p) * per_plane..][..per_plane];
                    self.kernel.cell_counts(nx, sums, columns, counts);
                }
                if let Some(start) = start {
                    sink(rows[p], start..start + layer, counts);
                }
            }
        }
    }
}
