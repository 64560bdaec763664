//! The AVX-512 form of the kernels: one vector holds the counts of a pair of neighbouring table
//! entries.
#![allow(unsafe_code)] // Masked loads through pointers, and calls past the run-time check.

use std::arch::x86_64::*;

use pellucid_voxel::sat::tables::{BAR, CountTables, INNER, LANE_BITS, LANES, Lanes, TileRecord, TileTables};

use super::{Plane, Rows, Sums, scalar};
use crate::axis::{Kind, Position};
use crate::window;

/// True where this module's functions may run.
pub(super) fn available() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("fma")
}

macro_rules! checked {
    ($call:expr) => {{
        assert!(available(), "AVX-512 kernels need AVX-512");
        // SAFETY: the features that the function is compiled for were found just now.
        unsafe { $call }
    }};
}

pub(super) fn corner_sums(plane: &Plane, sums: &mut [Sums]) {
    checked!(corner_sums_avx512(plane, sums))
}

pub(super) fn cell_counts(nx: usize, sums: &[Sums], columns: &mut [Sums], cells: &mut [Sums]) {
    checked!(cell_counts_avx512(nx, sums, columns, cells))
}

pub(super) fn features(
    rows: &Rows,
    materials: usize,
    at: usize,
    counts: &[Sums],
    cells: usize,
    channels: [Option<usize>; 4],
    out: &mut [f32],
) {
    checked!(features_avx512(rows, materials, at, counts, cells, channels, out))
}

pub(super) fn window_sums(
    size: [usize; 3],
    labels: &[u8],
    units: &[u64; 256],
    pair: &mut Vec<u64>,
    sums: &mut [u64],
) {
    checked!(window_sums_avx512(size, labels, units, pair, sums))
}

pub(super) fn window_cells(n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [Sums]) {
    checked!(window_cells_avx512(n, strides, sums, cells))
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn window_sums_avx512(
    size: [usize; 3],
    labels: &[u8],
    units: &[u64; 256],
    pair: &mut Vec<u64>,
    sums: &mut [u64],
) {
    window::sum_labels(size, labels, units, pair, sums);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn window_cells_avx512(n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [Sums]) {
    window::cells_between(n, strides, sums, cells);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn cell_counts_avx512(nx: usize, sums: &[Sums], columns: &mut [Sums], cells: &mut [Sums]) {
    scalar::cell_counts(nx, sums, columns, cells);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn corner_sums_avx512(plane: &Plane, sums: &mut [Sums]) {
    let (nx, ny) = (plane.xs.len(), plane.ys.len());
    let points = sums.len() / (nx * ny);
    let mut view = View::new(plane.tables, 0);
    for j in 0..ny {
        for i in 0..nx {
            let (xs, ys, zs) = (&plane.xs[i][..points], &plane.ys[j][..points], &plane.z[..points]);
            for p in 0..points {
                let (x, y, z) = (&xs[p], &ys[p], &zs[p]);
                let to = p * nx * ny + j * nx + i;
                if (x.kind, y.kind, z.kind) == (Kind::Fresh, Kind::Fresh, Kind::Fresh) {
                    let record = x.record as usize + y.record as usize + z.record as usize;
                    if record != view.at {
                        view = View::new(plane.tables, record);
                    }
                    let last = INNER as u8;
                    let sum = if x.local != last && y.local != last && z.local != last {
                        view.whole(x, y, z)
                    } else {
                        split(plane.tables, record, [x, y, z])
                    };
                    // SAFETY: a `Sums` is 32 bytes.
                    unsafe { _mm256_storeu_si256(sums[to].as_mut_ptr().cast(), sum) };
                } else if z.kind == Kind::Same {
                } else if x.kind == Kind::Zero || y.kind == Kind::Zero || z.kind == Kind::Zero {
                    sums[to] = [0; 8];
                } else if x.kind == Kind::Same {
                    sums[to] = sums[to - 1];
                } else {
                    sums[to] = sums[to - nx];
                }
            }
        }
    }
}

/// What the corners in one tile look up; most points of a batch share it.
struct View<'a> {
    at: usize,
    record: &'a TileRecord,
    tables: Option<&'a TileTables>,
    /// Bars behind, where there are any.
    bars: [Option<&'a [Lanes; BAR]>; 3],
    /// Whether constant tiles lie behind.
    deep: bool,
    filled: bool,
}

impl<'a> View<'a> {
    #[inline]
    fn new(tables: &'a CountTables, at: usize) -> Self {
        let record = &tables.records()[at];
        let bars = std::array::from_fn(|axis| {
            let behind = record.behind[axis];
            (behind != 0).then(|| &tables.table(behind).bars[axis])
        });
        Self {
            at,
            record,
            tables: (record.table != 0).then(|| tables.table(record.table)),
            bars,
            deep: record.depth != [[0; LANES]; 3],
            filled: record.fill != [0; LANES],
        }
    }

    /// The sum over a 2 x 2 x 2 cluster of voxel corners within the tile.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn whole(&self, x: &Position, y: &Position, z: &Position) -> __m256i {
        let record = self.record;
        let (lx, ly, lz) = (usize::from(x.local), usize::from(y.local), usize::from(z.local));
        debug_assert!(lx < INNER && ly < INNER && lz < INNER);
        // SAFETY: entries `local` and `local + 1` of 16, five counts each.
        let mut pairs = unsafe {
            let line = |axis: usize, l: usize| {
                _mm512_maskz_loadu_epi32(0x3ff, record.edges[axis].as_ptr().add(l).cast())
            };
            _mm512_add_epi32(_mm512_add_epi32(line(0, lx), line(1, ly)), line(2, lz))
        };
        pairs = _mm512_add_epi32(pairs, pairs);
        for (axis, lu, lv) in [(0, ly, lz), (1, lx, lz), (2, lx, ly)] {
            if let Some(bars) = self.bars[axis] {
                pairs = _mm512_add_epi32(pairs, bar(bars, lu, lv));
            }
        }
        pairs = _mm512_add_epi32(pairs, pairs);
        let folded = _mm512_add_epi32(pairs, _mm512_alignr_epi32::<5>(pairs, pairs));
        let mut sum = _mm512_castsi512_si256(folded);
        let (bx, by, bz) = (i32::from(x.before), i32::from(y.before), i32::from(z.before));
        if self.deep {
            for (axis, area) in [(0, by * bz), (1, bx * bz), (2, bx * by)] {
                // SAFETY: the mask keeps to the five counts.
                let depth = unsafe { _mm256_maskz_loadu_epi32(0x1f, record.depth[axis].as_ptr().cast()) };
                sum = _mm256_add_epi32(sum, _mm256_mullo_epi32(depth, _mm256_set1_epi32(2 * area)));
            }
        }
        if let Some(tables) = self.tables {
            sum = _mm256_add_epi32(sum, local(tables, lx, ly, lz));
        } else if self.filled {
            // SAFETY: the mask keeps to the five counts.
            let fill = unsafe { _mm256_maskz_loadu_epi32(0x1f, record.fill.as_ptr().cast()) };
            sum = _mm256_add_epi32(sum, _mm256_mullo_epi32(fill, _mm256_set1_epi32(bx * by * bz)));
        }
        sum
    }
}

/// The sum over the bar entries of two neighbouring offsets on both axes.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn bar(bars: &[Lanes; BAR], lu: usize, lv: usize) -> __m512i {
    bar_part(bars, lu, lv, false, false)
}

/// The same where a split axis has its first offset alone.
#[inline(always)]
fn bar_part(bars: &[Lanes; BAR], lu: usize, lv: usize, split_u: bool, split_v: bool) -> __m512i {
    let near = bars.as_ptr().wrapping_add((lv * INNER + lu).wrapping_sub(INNER + 1));
    let mask = if split_u { 0 } else { 0x3e0 } | if lu > 0 { 0x1f } else { 0 };
    let (first, second) = (if lv > 0 { mask } else { 0 }, if split_v { 0 } else { mask });
    // SAFETY: the masks keep to offsets 1..=15 on both axes, so what is read lies in the table;
    // callers are compiled for AVX-512.
    unsafe {
        let first = _mm512_maskz_loadu_epi32(first, near.cast());
        _mm512_add_epi32(first, _mm512_maskz_loadu_epi32(second, near.wrapping_add(INNER).cast()))
    }
}

/// The sum over the local counts of a cluster.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn local(tables: &TileTables, lx: usize, ly: usize, lz: usize) -> __m256i {
    local_part(tables, [lx, ly, lz], [false; 3])
}

/// The same where a split axis has its first offset alone.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn local_part(tables: &TileTables, [lx, ly, lz]: [usize; 3], split: [bool; 3]) -> __m256i {
    let start = ((lz * INNER + ly) * INNER + lx).wrapping_sub(INNER * INNER + INNER + 1);
    let base = tables.local.as_ptr().wrapping_add(start);
    let mask = u8::from(!split[0]) << 1 | u8::from(lx > 0);
    let all = |keep: bool| if keep { 0xff } else { 0 };
    let (y0, z0, y1, z1) = (all(ly > 0), all(lz > 0), all(!split[1]), all(!split[2]));
    // Row `r` of the four goes to words 2 r and 2 r + 1.
    let from = |r: usize, offset: usize| base.wrapping_add(offset).wrapping_sub(2 * r).cast::<i64>();
    // SAFETY: the masks keep to offsets 1..=15 on all axes, so what is read lies in the table.
    let words = unsafe {
        let words = _mm512_maskz_loadu_epi64(mask & y0 & z0, from(0, 0));
        let words = _mm512_mask_loadu_epi64(words, (mask & y1 & z0) << 2, from(1, INNER));
        let words = _mm512_mask_loadu_epi64(words, (mask & y0 & z1) << 4, from(2, INNER * INNER));
        _mm512_mask_loadu_epi64(words, (mask & y1 & z1) << 6, from(3, INNER * INNER + INNER))
    };
    // Sums of eight 12-bit counts need 15 bits: every other material, 24 bits apart.
    const LANE: i64 = (1 << LANE_BITS) - 1;
    let odd_mask = _mm512_set1_epi64(LANE | LANE << (2 * LANE_BITS));
    let even_mask = _mm512_set1_epi64(LANE | LANE << (2 * LANE_BITS) | 0xffff << (4 * LANE_BITS));
    let even = _mm512_and_si512(words, even_mask);
    let odd = _mm512_and_si512(_mm512_srli_epi64::<LANE_BITS>(words), odd_mask);
    let halves = |v: __m512i| _mm256_add_epi64(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64::<1>(v));
    let (even, odd) = (halves(even), halves(odd));
    let both = _mm256_add_epi64(_mm256_unpacklo_epi64(even, odd), _mm256_unpackhi_epi64(even, odd));
    let both = _mm_add_epi64(_mm256_castsi256_si128(both), _mm256_extracti128_si256::<1>(both));
    // Lanes even, odd, even, odd, even: shift each material down to its own lane.
    let spread = _mm512_broadcast_i64x2(both);
    let shift = _mm512_set_epi64(0, 0, 0, 48, 24, 24, 0, 0);
    let lanes = _mm512_and_si512(_mm512_srlv_epi64(spread, shift), _mm512_set1_epi64(0xff_ffff));
    _mm512_cvtepi64_epi32(lanes)
}

/// The sum over a cluster that reaches into the next tile along an axis or more.
///
/// In the next tile its voxel corner has offset 0, where bars and local counts on that axis are
/// none: only edges and the bars along the axis count there.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn split(tables: &CountTables, record: usize, at: [&Position; 3]) -> __m256i {
    let strides = tables.strides();
    let splits = at.map(|p| usize::from(p.local) == INNER);
    let mut pairs = _mm512_setzero_si512();
    let mut sum = _mm256_setzero_si256();
    for step in 0..8usize {
        if (0..3).any(|a| step >> a & 1 == 1 && !splits[a]) {
            continue;
        }
        let next: [bool; 3] = std::array::from_fn(|a| step >> a & 1 == 1);
        let here = record + (0..3).map(|a| if next[a] { strides[a] } else { 0 }).sum::<usize>();
        let record = &tables.records()[here];
        let local: [usize; 3] = std::array::from_fn(|a| if next[a] { 0 } else { at[a].local.into() });
        let before: [i32; 3] = std::array::from_fn(|a| if next[a] { 0 } else { at[a].before.into() });
        let count = splits.map(|split| if split { 1 } else { 2 });
        for axis in 0..3 {
            let (u, v) = [(1, 2), (0, 2), (0, 1)][axis];
            // SAFETY: entry `local` of 16, and the one after it unless the axis is split.
            let line = unsafe {
                let keep = if splits[axis] { 0x1f } else { 0x3ff };
                _mm512_maskz_loadu_epi32(keep, record.edges[axis].as_ptr().add(local[axis]).cast())
            };
            pairs = _mm512_add_epi32(pairs, _mm512_mullo_epi32(line, _mm512_set1_epi32(count[u] * count[v])));
            if next[u] || next[v] {
                continue;
            }
            let behind = &tables.table(record.behind[axis]).bars[axis];
            let bars = bar_part(behind, local[u], local[v], splits[u], splits[v]);
            pairs = _mm512_add_epi32(pairs, _mm512_mullo_epi32(bars, _mm512_set1_epi32(count[axis])));
            // SAFETY: the mask keeps to the five counts.
            let depth = unsafe { _mm256_maskz_loadu_epi32(0x1f, record.depth[axis].as_ptr().cast()) };
            let area = _mm256_set1_epi32(count[axis] * before[u] * before[v]);
            sum = _mm256_add_epi32(sum, _mm256_mullo_epi32(depth, area));
        }
        if step > 0 {
            continue;
        }
        if record.table != 0 {
            sum = _mm256_add_epi32(sum, local_part(tables.table(record.table), local, splits));
        } else {
            // SAFETY: the mask keeps to the five counts.
            let fill = unsafe { _mm256_maskz_loadu_epi32(0x1f, record.fill.as_ptr().cast()) };
            let volume = _mm256_set1_epi32(before.iter().product());
            sum = _mm256_add_epi32(sum, _mm256_mullo_epi32(fill, volume));
        }
    }
    let folded = _mm512_add_epi32(pairs, _mm512_alignr_epi32::<5>(pairs, pairs));
    _mm256_add_epi32(sum, _mm512_castsi512_si256(folded))
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,fma")]
fn features_avx512(
    rows: &Rows,
    materials: usize,
    at: usize,
    counts: &[Sums],
    cells: usize,
    channels: [Option<usize>; 4],
    out: &mut [f32],
) {
    let f = rows.features;
    assert!(f == 2 || f == 3);
    assert!(at + 8 <= rows.width && rows.values.len() >= materials * rows.width);
    assert!(counts.len() >= materials.div_ceil(LANES) * cells);
    assert!(channels.iter().flatten().all(|start| start + cells * f <= out.len()));
    let factor = _mm512_set1_pd(rows.factor);
    let out = out.as_mut_ptr();
    for cell in 0..cells {
        let mut sum = _mm512_setzero_pd();
        for first in (0..materials).step_by(LANES) {
            // SAFETY: a `Sums` is 32 bytes, and there is one a group and cell.
            let lanes =
                unsafe { _mm256_loadu_si256(counts.as_ptr().add(first / LANES * cells + cell).cast()) };
            let lanes = _mm512_cvtepu32_pd(lanes);
            for m in 0..LANES.min(materials - first) {
                let count = _mm512_permutexvar_pd(_mm512_set1_epi64(m as i64), lanes);
                // SAFETY: each of the `materials` rows has eight values from `at` on.
                let row = unsafe { _mm512_loadu_pd(rows.values.as_ptr().add((first + m) * rows.width + at)) };
                // Counts below 2^28 times f32 coefficients are exact: fusing changes no bit.
                sum = _mm512_fmadd_pd(count, row, sum);
            }
        }
        let value = _mm512_cvtpd_ps(_mm512_mul_pd(sum, factor));
        let halves = [_mm256_castps256_ps128(value), _mm256_extractf128_ps::<1>(value)];
        // SAFETY: `f` values of each cell lie in `out` from each channel's start on.
        unsafe {
            for (half, channels) in halves.into_iter().zip(channels.chunks_exact(2)) {
                if f == 2 {
                    if let Some(start) = channels[0] {
                        _mm_storel_pd(out.add(start + cell * 2).cast(), _mm_castps_pd(half));
                    }
                    if let Some(start) = channels[1] {
                        _mm_storeh_pd(out.add(start + cell * 2).cast(), _mm_castps_pd(half));
                    }
                }
            }
            if f == 3 {
                for (half, start) in halves.into_iter().zip(channels.iter().flatten()) {
                    _mm_mask_storeu_ps(out.add(start + cell * 3), 7, half);
                }
            }
        }
    }
}
