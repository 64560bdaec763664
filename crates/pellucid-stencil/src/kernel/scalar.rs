//! The plain form of the kernels.

use pellucid_voxel::TILE;
use pellucid_voxel::sat::tables::{
    BAR, CountTables, INNER, LANE_BITS, LANES, Lanes, TileRecord, TileTables, unpack,
};

use super::lattice::Clusters;
use super::{Plane, Rows, Sums, each_corner};
use crate::axis::{Position, each};
use crate::lattice::{BarAt, LocalAt};

pub(super) fn corner_sums(plane: &Plane, sums: &mut [Sums]) {
    let [nx, ny] = plane.n;
    let zs = plane.axes[2].corner(plane.k);
    each_corner(plane, sums, |sums, [i, j, word], fresh, _| {
        let (xs, ys) = (plane.axes[0].corner(i), plane.axes[1].corner(j));
        each(fresh, |p| {
            let p = 64 * word + p;
            let at = [&xs[p], &ys[p], &zs[p]];
            let record = at.iter().map(|p| p.record as usize).sum();
            sums[p * nx * ny + j * nx + i] = around(plane.tables, record, at);
        });
    });
}

/// Clusters entry by entry.
#[derive(Clone, Copy)]
pub(super) struct Plain;

impl Clusters for Plain {
    fn bar(self, bars: &[Lanes; BAR], at: &BarAt) -> Sums {
        let mut sum = [0; 8];
        for (row, _) in [INNER, 0].iter().zip(at.v).filter(|(_, on)| *on != 0) {
            for (entry, _) in [1, 0].iter().zip(at.u).filter(|(_, on)| *on != 0) {
                add_times(&mut sum, &bars[usize::from(at.entry) - row - entry], 1);
            }
        }
        sum
    }

    fn local(self, tables: &TileTables, at: &LocalAt) -> Sums {
        let mut sum = [0; 8];
        let offsets = |axis: usize, stride: usize| {
            [stride, 0].into_iter().zip(at.axes[axis]).filter(|(_, on)| *on != 0).map(|(offset, _)| offset)
        };
        for z in offsets(2, INNER * INNER) {
            for y in offsets(1, INNER) {
                for x in offsets(0, 1) {
                    add_times(&mut sum, &unpack(tables.local[usize::from(at.entry) - z - y - x]), 1);
                }
            }
        }
        sum
    }

    fn ask_bar(self, _: &[Lanes; BAR], _: &BarAt) {}

    fn ask_local(self, _: &TileTables, _: &LocalAt) {}
}

/// The part of a 2 x 2 x 2 cluster of voxel corners that lies in one tile, along one axis: at
/// `local` and, where `two`, at `local + 1`.
#[derive(Clone, Copy)]
struct Part {
    local: usize,
    two: bool,
    before: u32,
}

/// The sum over the voxel corners around a corner.
fn around(tables: &CountTables, record: usize, at: [&Position; 3]) -> Sums {
    let mut sum = [0; 8];
    let strides = tables.strides();
    let split: [bool; 3] = std::array::from_fn(|a| usize::from(at[a].local) == INNER);
    for step in 0..8usize {
        if (0..3).any(|a| step >> a & 1 == 1 && !split[a]) {
            continue;
        }
        let mut at_record = record;
        let parts = std::array::from_fn(|a| {
            if step >> a & 1 == 1 {
                at_record += strides[a];
                Part { local: 0, two: false, before: 0 }
            } else {
                Part { local: at[a].local.into(), two: !split[a], before: at[a].before.into() }
            }
        });
        within_tile(tables, &tables.records()[at_record], parts, &mut sum);
    }
    sum
}

/// Adds the sum over the voxel corners that lie in one tile.
fn within_tile(tables: &CountTables, record: &TileRecord, parts: [Part; 3], sum: &mut Sums) {
    let count = parts.map(|p| 1 + u32::from(p.two));
    let before = parts.map(|p| p.before);
    for axis in 0..3 {
        let (u, v) = [(1, 2), (0, 2), (0, 1)][axis];
        let part = parts[axis];
        let edges = &record.edges[axis];
        let mut line = edges[part.local];
        if part.two {
            add(&mut line, &edges[part.local + 1]);
        }
        add_times(sum, &line, count[u] * count[v]);
        add_times(sum, &record.depth[axis], count[axis] * before[u] * before[v]);
        let bars = &tables.table(record.behind[axis]).bars[axis];
        add_times(sum, &bar(bars, parts[u], parts[v]), count[axis]);
    }
    if record.table == 0 {
        add_times(sum, &record.fill, before.iter().product());
    } else {
        local(tables.table(record.table), parts, sum);
    }
}

/// Table positions, offset 0 being none, of a part.
fn entries(part: Part) -> std::ops::Range<usize> {
    part.local.saturating_sub(1)..if part.two { part.local + 1 } else { part.local }
}

fn bar(bars: &[Lanes; BAR], u: Part, v: Part) -> Lanes {
    let mut out = [0; LANES];
    for row in entries(v) {
        for entry in &bars[row * INNER..(row + 1) * INNER][entries(u)] {
            add(&mut out, entry);
        }
    }
    out
}

fn local(tables: &TileTables, [x, y, z]: [Part; 3], sum: &mut Sums) {
    // Sums of eight 12-bit counts need 15 bits: every other material, 24 bits apart.
    const LANE: u64 = (1 << LANE_BITS) - 1;
    const EVEN: u64 = LANE | LANE << (2 * LANE_BITS) | 0xffff << (4 * LANE_BITS);
    const ODD: u64 = LANE | LANE << (2 * LANE_BITS);
    let (mut even, mut odd) = (0u64, 0u64);
    for lz in entries(z) {
        for ly in entries(y) {
            for word in &tables.local[(lz * INNER + ly) * INNER..][..INNER][entries(x)] {
                even += word & EVEN;
                odd += word >> LANE_BITS & ODD;
            }
        }
    }
    let wide = |word: u64, at: u32| (word >> (2 * LANE_BITS * at) & 0xff_ffff) as u32;
    add_times(sum, &[wide(even, 0), wide(odd, 0), wide(even, 1), wide(odd, 1), wide(even, 2)], 1);
}

fn add(to: &mut Lanes, counts: &Lanes) {
    for (to, count) in to.iter_mut().zip(counts) {
        *to = to.wrapping_add(*count);
    }
}

fn add_times(to: &mut Sums, counts: &Lanes, times: u32) {
    for (to, count) in to.iter_mut().zip(counts) {
        *to = to.wrapping_add(count.wrapping_mul(times));
    }
}

#[inline(always)]
pub(super) fn cell_counts(nx: usize, sums: &[Sums], columns: &mut [Sums], cells: &mut [Sums]) {
    for (j, row) in columns.chunks_exact_mut(nx).enumerate() {
        let near = &sums[j * (nx + 1)..(j + 1) * (nx + 1)];
        let far = &sums[(j + 1) * (nx + 1)..(j + 2) * (nx + 1)];
        for (i, column) in row.iter_mut().enumerate() {
            let new: Sums = std::array::from_fn(|m| {
                far[i + 1][m].wrapping_sub(far[i][m]).wrapping_sub(near[i + 1][m]).wrapping_add(near[i][m])
            });
            cells[j * nx + i] = std::array::from_fn(|m| new[m].wrapping_sub(column[m]));
            *column = new;
        }
    }
}

/// Features of the channels in the eight lanes from `at` on, each written from its start.
pub(super) fn features(
    rows: &Rows,
    materials: usize,
    at: usize,
    counts: &[Sums],
    cells: usize,
    channels: [Option<usize>; 4],
    out: &mut [f32],
) {
    let lanes = rows.features.next_power_of_two();
    for cell in 0..cells {
        let mut sums = [0.0; 8];
        for (m, row) in rows.values.chunks_exact(rows.width).take(materials).enumerate() {
            let count = f64::from(counts[m / LANES * cells + cell][m % LANES]);
            for (sum, value) in sums.iter_mut().zip(&row[at..]) {
                *sum += count * value;
            }
        }
        for (sums, start) in sums.chunks_exact(lanes).zip(channels.iter().flatten()) {
            let out = &mut out[start + cell * rows.features..][..rows.features];
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = (sum * rows.factor) as f32;
            }
        }
    }
}

const _: () = assert!(TILE == INNER + 1);
