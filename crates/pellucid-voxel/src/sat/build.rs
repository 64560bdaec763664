//! Building a group's tables: tiles in parallel, then sums along tile rows and edge lines.

use rayon::prelude::*;

use super::tables::{
    BAR, CountTables, INNER, LANE_BITS, LANES, LOCAL, Lanes, TileRecord, TileTables, across, unpack,
};
use crate::grid::{inside, tile_coords};
use crate::{Control, LabelGrid, TILE, TILE_VOXELS, Tile, VoxelError};

/// A tile as one group sees it.
pub(super) enum GroupTile {
    /// Every voxel within the grid is of this lane, or of none of the group.
    Constant(Option<usize>),
    /// Tables with the bars of this tile alone.
    Mixed(Box<TileTables>),
}

/// The labels of one group: `first..first + LANES`.
#[derive(Clone, Copy)]
pub(super) struct GroupLabels {
    first: usize,
    lut: [u64; 256],
}

impl GroupLabels {
    /// Group `group` of a table of `materials` labels.
    pub(super) fn new(group: usize, materials: usize) -> Self {
        let first = 1 + group * LANES;
        let mut lut = [0; 256];
        for m in 0..LANES.min(materials + 1 - first) {
            lut[first + m] = 1 << (LANE_BITS as usize * m);
        }
        Self { first, lut }
    }

    fn lane(&self, label: u8) -> Option<usize> {
        (self.lut[usize::from(label)] != 0).then(|| usize::from(label) - self.first)
    }

    /// Classifies a tile and builds its tables where it is mixed.
    pub(super) fn tile(&self, tile: &Tile, inside: [usize; 3]) -> GroupTile {
        let labels = match tile {
            Tile::Constant(label) => return GroupTile::Constant(self.lane(*label)),
            Tile::Dense(labels) => labels,
        };
        let first = self.lut[usize::from(labels[0])];
        let same = if inside == [TILE; 3] {
            labels.iter().all(|&l| self.lut[usize::from(l)] == first)
        } else {
            let [nx, ny, nz] = inside;
            (0..nz).all(|z| {
                (0..ny).all(|y| {
                    let row = (z * TILE + y) * TILE;
                    labels[row..row + nx].iter().all(|&l| self.lut[usize::from(l)] == first)
                })
            })
        };
        if same { GroupTile::Constant(self.lane(labels[0])) } else { GroupTile::Mixed(self.tables(labels)) }
    }

    fn tables(&self, labels: &[u8; TILE_VOXELS]) -> Box<TileTables> {
        let mut out = TileTables::zero();
        // Counts of [0, x] x [0, y] x [0, z] at [y][x] for the layer in hand.
        let mut plane = [[0u64; TILE]; TILE];
        for (z, layer) in labels.chunks_exact(TILE * TILE).enumerate() {
            let mut rows = [0u64; TILE];
            for (y, row) in layer.chunks_exact(TILE).enumerate() {
                let mut run = 0;
                for x in 0..TILE {
                    run += self.lut[usize::from(row[x])];
                    rows[x] += run;
                    plane[y][x] += rows[x];
                }
                if y < INNER && z < INNER {
                    let at = (z * INNER + y) * INNER;
                    out.local[at..at + INNER].copy_from_slice(&plane[y][..INNER]);
                }
            }
            if z < INNER {
                for i in 0..INNER {
                    out.bars[0][z * INNER + i] = unpack(plane[i][INNER]);
                    out.bars[1][z * INNER + i] = unpack(plane[INNER][i]);
                }
            }
            out.profile[2][z] = plane[INNER][INNER];
        }
        for y in 0..TILE {
            out.profile[0][y] = plane[INNER][y];
            out.profile[1][y] = plane[y][INNER];
            if y < INNER {
                for x in 0..INNER {
                    out.bars[2][y * INNER + x] = unpack(plane[y][x]);
                }
            }
        }
        out
    }
}

const _: () = assert!(LOCAL == INNER * BAR);

/// Counts of a tile's first 1..=16 layers along an axis.
pub(super) fn profile(
    tables: &CountTables,
    t: [usize; 3],
    record: &TileRecord,
    axis: usize,
) -> [Lanes; TILE] {
    if record.table != 0 {
        return tables.table(record.table).profile[axis].map(unpack);
    }
    let (u, v) = across(axis);
    let along = tables.extent(axis, t[axis]);
    let area = tables.extent(u, t[u]) * tables.extent(v, t[v]);
    std::array::from_fn(|i| record.fill.map(|fill| fill * (i as u32 + 1).min(along) * area))
}

impl CountTables {
    pub(super) fn build(
        grid: &LabelGrid,
        labels: &GroupLabels,
        control: &Control,
    ) -> Result<Self, VoxelError> {
        let size = grid.size();
        let dims = size.map(|s| (s as usize + 1) / TILE + 1);
        let tiles: usize = dims.iter().product();
        let mut this = Self {
            size,
            dims,
            records: filled(tiles, TileRecord::EMPTY)?,
            tables: vec![Some(TileTables::zero())],
            free: Vec::new(),
        };
        let built: Vec<GroupTile> = grid
            .tiles()
            .par_iter()
            .enumerate()
            .map(|(i, tile)| {
                control.check()?;
                Ok(labels.tile(tile, inside(tile_coords(grid.tile_dims(), i), size)))
            })
            .collect::<Result<_, VoxelError>>()?;
        for (i, tile) in built.into_iter().enumerate() {
            let at = this.record_index(tile_coords(grid.tile_dims(), i));
            this.place(at, tile);
        }
        this.link();
        for axis in 0..3 {
            control.check()?;
            this.sweep(axis, None, Sweep::Accumulate);
        }
        control.check()?;
        this.build_edges()?;
        Ok(this)
    }

    /// Position of a tile's record.
    pub(super) fn record_index(&self, t: [u32; 3]) -> usize {
        let [x, y, z] = t.map(|t| t as usize);
        (z * self.dims[1] + y) * self.dims[0] + x
    }

    /// The tile coordinates of a record.
    pub(super) fn record_tile(&self, at: usize) -> [usize; 3] {
        let [dx, dy, _] = self.dims;
        [at % dx, at / dx % dy, at / dx / dy]
    }

    /// Gives a record its new tile, freeing the tables of the old one.
    pub(super) fn place(&mut self, at: usize, tile: GroupTile) {
        let old = self.records[at].table;
        if old != 0 {
            self.tables[old as usize] = None;
            self.free.push(old);
        }
        let record = &mut self.records[at];
        record.fill = [0; LANES];
        record.table = 0;
        match tile {
            GroupTile::Constant(lane) => {
                if let Some(lane) = lane {
                    record.fill[lane] = 1;
                }
            }
            GroupTile::Mixed(tables) => {
                record.table = match self.free.pop() {
                    Some(position) => {
                        self.tables[position as usize] = Some(tables);
                        position
                    }
                    None => {
                        self.tables.push(Some(tables));
                        (self.tables.len() - 1) as u32
                    }
                };
            }
        }
    }

    /// Sets what lies behind each tile along each axis.
    pub(super) fn link(&mut self) {
        let strides = self.strides();
        for at in 0..self.records.len() {
            let t = self.record_tile(at);
            for axis in 0..3 {
                let (behind, depth) = if t[axis] == 0 {
                    (0, [0; LANES])
                } else {
                    let prior = &self.records[at - strides[axis]];
                    if prior.table != 0 {
                        (prior.table, [0; LANES])
                    } else {
                        let extent = self.extent(axis, t[axis] - 1);
                        (
                            prior.behind[axis],
                            std::array::from_fn(|m| prior.depth[axis][m] + prior.fill[m] * extent),
                        )
                    }
                };
                self.records[at].behind[axis] = behind;
                self.records[at].depth[axis] = depth;
            }
        }
    }

    /// Sums bars along every tile row of an axis, or undoes that; `rows` limits it to the marked
    /// rows, numbered by [`CountTables::row`].
    pub(super) fn sweep(&mut self, axis: usize, rows: Option<&[bool]>, direction: Sweep) {
        let (u, v) = across(axis);
        let (dims, size) = (self.dims, self.size);
        let extent = |a: usize, t: usize| size[a].saturating_sub((t * TILE) as u32).min(TILE as u32);
        let mut owner = vec![usize::MAX; self.tables.len()];
        for (at, record) in self.records.iter().enumerate() {
            if record.table != 0 {
                owner[record.table as usize] = at;
            }
        }
        let mut lists: Vec<Vec<(usize, &mut [Lanes; BAR])>> = Vec::new();
        lists.resize_with(dims[u] * dims[v], Vec::new);
        for (position, tables) in self.tables.iter_mut().enumerate() {
            let at = owner[position];
            if let (Some(tables), true) = (tables, at != usize::MAX) {
                let t = [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]];
                let row = t[v] * dims[u] + t[u];
                if rows.is_none_or(|rows| rows[row]) {
                    lists[row].push((at, &mut tables.bars[axis]));
                }
            }
        }
        let records = &self.records;
        lists.par_iter_mut().enumerate().for_each(|(row, list)| {
            list.sort_unstable_by_key(|(at, _)| *at);
            let (eu, ev) = (extent(u, row % dims[u]), extent(v, row / dims[u]));
            let step = |i: usize, list: &mut Vec<(usize, &mut [Lanes; BAR])>| {
                let (before, rest) = list.split_at_mut(i);
                let (at, bar) = &mut rest[0];
                let depth = &records[*at].depth[axis];
                if let Some((_, prior)) = before.last() {
                    direction.apply(bar, prior);
                }
                if *depth != [0; LANES] {
                    direction.apply_depth(bar, depth, eu, ev);
                }
            };
            match direction {
                Sweep::Accumulate => (0..list.len()).for_each(|i| step(i, list)),
                Sweep::Separate => (0..list.len()).rev().for_each(|i| step(i, list)),
            }
        });
    }

    /// The number of a tile's row along an axis.
    pub(super) fn row(&self, axis: usize, t: [usize; 3]) -> usize {
        let (u, v) = across(axis);
        t[v] * self.dims[u] + t[u]
    }

    /// Sums tile profiles into the counts along tile edges.
    fn build_edges(&mut self) -> Result<(), VoxelError> {
        for axis in 0..3 {
            let (u, v) = across(axis);
            let (line, lines) = (self.dims[axis] * TILE, self.dims[u]);
            // P at corners with two coordinates on tile corners, the line's coordinate fastest.
            let mut sums = filled(self.records.len() * TILE, [0; LANES])?;
            let this = &*self;
            sums.par_chunks_exact_mut(line * lines).enumerate().for_each(|(tv, plane)| {
                let mut before = vec![[0; LANES]; line];
                for (tu, out) in plane.chunks_exact_mut(line).enumerate() {
                    out.copy_from_slice(&before);
                    let mut t = [0; 3];
                    (t[u], t[v]) = (tu, tv);
                    let mut run = [0; LANES];
                    for (ta, cells) in before.chunks_exact_mut(TILE).enumerate() {
                        t[axis] = ta;
                        let record = &this.records[this.record_index(t.map(|t| t as u32))];
                        if record.table == 0 && record.fill == [0; LANES] && run == [0; LANES] {
                            continue;
                        }
                        let inner = profile(this, t, record, axis);
                        add(&mut cells[0], &run);
                        for i in 1..TILE {
                            add(&mut cells[i], &run);
                            add(&mut cells[i], &inner[i - 1]);
                        }
                        add(&mut run, &inner[TILE - 1]);
                    }
                }
            });
            sum_planes(&mut sums, line * lines);
            self.add_edges(axis, &sums);
        }
        Ok(())
    }

    /// Adds to the records' edges of an axis the sums at corners with two coordinates on tile
    /// corners, ordered by the axes across, then the line's coordinate.
    pub(super) fn add_edges(&mut self, axis: usize, sums: &[Lanes]) {
        let (u, v) = across(axis);
        let dims = self.dims;
        self.records.par_iter_mut().enumerate().with_min_len(256).for_each(|(at, record)| {
            let t = [at % dims[0], at / dims[0] % dims[1], at / dims[0] / dims[1]];
            let start = ((t[v] * dims[u] + t[u]) * dims[axis] + t[axis]) * TILE;
            // Along y and z only what moving the corner adds: the corner itself is counted along x.
            let own = if axis == 0 { [0; LANES] } else { sums[start].map(u32::wrapping_neg) };
            for (edge, sum) in record.edges[axis].iter_mut().zip(&sums[start..start + TILE]) {
                add(edge, sum);
                add(edge, &own);
            }
        });
    }
}

/// Replaces each plane by the sum of the planes before it.
fn sum_planes(planes: &mut [Lanes], plane: usize) {
    let mut total = vec![[0; LANES]; plane];
    for values in planes.chunks_exact_mut(plane) {
        values.par_iter_mut().zip(&mut total).with_min_len(1 << 12).for_each(|(value, total)| {
            let sum = *total;
            add(total, value);
            *value = sum;
        });
    }
}

/// Adds counts modulo 2^32.
#[inline]
pub(super) fn add(to: &mut Lanes, counts: &Lanes) {
    for (to, count) in to.iter_mut().zip(counts) {
        *to = to.wrapping_add(*count);
    }
}

/// Which way bars are swept.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Sweep {
    /// From the bars of single tiles to sums from the grid's face on.
    Accumulate,
    /// Back again.
    Separate,
}

impl Sweep {
    /// Adds or takes off the bars of the mixed tile before.
    fn apply(self, bar: &mut [Lanes; BAR], prior: &[Lanes; BAR]) {
        let (bar, prior) = (bar.as_flattened_mut(), prior.as_flattened());
        match self {
            Sweep::Accumulate => bar.iter_mut().zip(prior).for_each(|(b, p)| *b = b.wrapping_add(*p)),
            Sweep::Separate => bar.iter_mut().zip(prior).for_each(|(b, p)| *b = b.wrapping_sub(*p)),
        }
    }

    /// Adds or takes off constant tiles `depth` voxels deep, cut to `eu` x `ev` voxels across.
    fn apply_depth(self, bar: &mut [Lanes; BAR], depth: &Lanes, eu: u32, ev: u32) {
        for v in 0..INNER {
            for u in 0..INNER {
                let area = (u as u32 + 1).min(eu) * (v as u32 + 1).min(ev);
                for (b, depth) in bar[v * INNER + u].iter_mut().zip(depth) {
                    let counts = depth.wrapping_mul(area);
                    *b = match self {
                        Sweep::Accumulate => b.wrapping_add(counts),
                        Sweep::Separate => b.wrapping_sub(counts),
                    };
                }
            }
        }
    }
}

/// A vector whose size comes from a frame: refused, not aborted on, when memory lacks.
pub(super) fn filled<T: Clone>(len: usize, value: T) -> Result<Vec<T>, VoxelError> {
    let mut out = Vec::new();
    out.try_reserve_exact(len).map_err(|_| {
        VoxelError::unsupported(
            "summed-area table",
            format!("no memory for {len} entries of {} bytes; use a coarser pitch", size_of::<T>()),
        )
    })?;
    out.resize(len, value);
    Ok(out)
}
