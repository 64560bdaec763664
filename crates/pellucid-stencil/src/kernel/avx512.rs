//! The AVX-512 form of the kernels: one vector holds the counts of a pair of neighbouring table
//! entries.
#![allow(unsafe_code)] // Masked loads through pointers, and calls past the run-time check.

use std::arch::x86_64::*;

use pellucid_voxel::TILE;
use pellucid_voxel::sat::tables::{CountTables, INNER, LANE_BITS, LANES, TileRecord, TileTables};

use super::{Plane, Rows, Sums, scalar};
use crate::axis::{Kind, Position};

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

pub(super) fn cell_counts(nx: usize, sums: &[Sums], columns: &mut [Sums], cells: Option<&mut [Sums]>) {
    checked!(cell_counts_avx512(nx, sums, columns, cells))
}

pub(super) fn features(rows: &Rows, materials: usize, counts: &[Sums], out: &mut [f32]) {
    checked!(features_avx512(rows, materials, counts, out))
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn cell_counts_avx512(nx: usize, sums: &[Sums], columns: &mut [Sums], cells: Option<&mut [Sums]>) {
    scalar::cell_counts(nx, sums, columns, cells);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn corner_sums_avx512(plane: &Plane, sums: &mut [Sums]) {
    let (nx, ny) = (plane.xs.len(), plane.ys.len());
    let strides = plane.tables.strides();
    let points = sums.len() / (nx * ny);
    for j in 0..ny {
        for i in 0..nx {
            let (xs, ys, zs) = (&plane.xs[i][..points], &plane.ys[j][..points], &plane.z[..points]);
            for p in 0..points {
                let at = [&xs[p], &ys[p], &zs[p]];
                let to = p * nx * ny + j * nx + i;
                match at.map(|a| a.kind) {
                    [Kind::Fresh, Kind::Fresh, Kind::Fresh] => {
                        let sum = around(plane.tables, strides, at);
                        // SAFETY: a `Sums` is 32 bytes.
                        unsafe { _mm256_storeu_si256(sums[to].as_mut_ptr().cast(), sum) };
                    }
                    [_, _, Kind::Same] => {}
                    [Kind::Zero, ..] | [_, Kind::Zero, _] | [.., Kind::Zero] => sums[to] = [0; 8],
                    [Kind::Same, ..] => sums[to] = sums[to - 1],
                    _ => sums[to] = sums[to - nx],
                }
            }
        }
    }
}

/// The part of a 2 x 2 x 2 cluster of voxel corners that lies in one tile, along one axis.
#[derive(Clone, Copy)]
struct Part {
    local: usize,
    before: u32,
    /// Voxel corners in the tile: the first alone (1) or both (2).
    count: u32,
    /// Whether the first, and the second, voxel corner has an entry in tables without offset 0.
    has: [bool; 2],
}

impl Part {
    #[inline(always)]
    fn first(at: &Position, split: bool) -> Self {
        let local = usize::from(at.local);
        Self { local, before: at.before.into(), count: 2 - u32::from(split), has: [local > 0, !split] }
    }

    const NEXT: Self = Self { local: 0, before: 0, count: 1, has: [false, false] };
}

#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn around(tables: &CountTables, strides: [usize; 3], at: [&Position; 3]) -> __m256i {
    let record = at[0].record as usize + at[1].record as usize + at[2].record as usize;
    let split = at.map(|p| usize::from(p.local) == INNER);
    if split == [false; 3] {
        return within_tile::<true>(tables, &tables.records()[record], at.map(|p| Part::first(p, false)));
    }
    let mut sum = _mm256_setzero_si256();
    for step in 0..8usize {
        if (0..3).any(|a| step >> a & 1 == 1 && !split[a]) {
            continue;
        }
        let mut at_record = record;
        let parts = std::array::from_fn(|a| {
            if step >> a & 1 == 1 {
                at_record += strides[a];
                Part::NEXT
            } else {
                Part::first(at[a], split[a])
            }
        });
        let part = within_tile::<false>(tables, &tables.records()[at_record], parts);
        sum = _mm256_add_epi32(sum, part);
    }
    sum
}

/// The sum over the voxel corners that lie in one tile: `WHOLE` when all eight do.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn within_tile<const WHOLE: bool>(tables: &CountTables, record: &TileRecord, parts: [Part; 3]) -> __m256i {
    let before = parts.map(|p| p.before);
    let count = if WHOLE { [2; 3] } else { parts.map(|p| p.count) };
    let (mut edges, mut bars) = (_mm512_setzero_si512(), _mm512_setzero_si512());
    let mut sum = _mm256_setzero_si256();
    for axis in 0..3 {
        let (u, v) = [(1, 2), (0, 2), (0, 1)][axis];
        let part = parts[axis];
        debug_assert!(part.local + usize::from(part.has[1]) < TILE);
        let mask = if WHOLE || part.has[1] { 0x3ff } else { 0x1f };
        // SAFETY: the mask keeps to entry `local` and, where the tile has it, `local + 1`.
        let pair =
            unsafe { _mm512_maskz_loadu_epi32(mask, record.edges[axis].as_ptr().add(part.local).cast()) };
        let bar = bar(tables.table(record.behind[axis]), axis, parts[u], parts[v]);
        if WHOLE {
            edges = _mm512_add_epi32(edges, pair);
            bars = _mm512_add_epi32(bars, bar);
        } else {
            edges = _mm512_add_epi32(
                edges,
                _mm512_mullo_epi32(pair, _mm512_set1_epi32((count[u] * count[v]) as i32)),
            );
            bars = _mm512_add_epi32(bars, _mm512_mullo_epi32(bar, _mm512_set1_epi32(count[axis] as i32)));
        }
        // SAFETY: the mask keeps to the five counts.
        let depth = unsafe { _mm256_maskz_loadu_epi32(0x1f, record.depth[axis].as_ptr().cast()) };
        let area = (count[axis] * before[u] * before[v]) as i32;
        sum = _mm256_add_epi32(sum, _mm256_mullo_epi32(depth, _mm256_set1_epi32(area)));
    }
    let pairs = if WHOLE {
        _mm512_add_epi32(_mm512_slli_epi32::<2>(edges), _mm512_slli_epi32::<1>(bars))
    } else {
        _mm512_add_epi32(edges, bars)
    };
    let folded = _mm512_add_epi32(pairs, _mm512_alignr_epi32::<5>(pairs, pairs));
    sum = _mm256_add_epi32(sum, _mm512_castsi512_si256(folded));
    if record.table == 0 {
        // SAFETY: the mask keeps to the five counts.
        let fill = unsafe { _mm256_maskz_loadu_epi32(0x1f, record.fill.as_ptr().cast()) };
        let volume = (before[0] * before[1] * before[2]) as i32;
        _mm256_add_epi32(sum, _mm256_mullo_epi32(fill, _mm256_set1_epi32(volume)))
    } else {
        _mm256_add_epi32(sum, local(tables.table(record.table), parts))
    }
}

/// The sum over the rows of the bar entries of two parts, in pairs along the faster one.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn bar(tables: &TileTables, axis: usize, u: Part, v: Part) -> __m512i {
    let start = (v.local * INNER + u.local).wrapping_sub(INNER + 1);
    let near = tables.bars[axis].as_ptr().wrapping_add(start);
    let mask = (if u.has[0] { 0x1f } else { 0 }) | (if u.has[1] { 0x3e0 } else { 0 });
    // SAFETY: the masks keep to entries of offsets 1..=15 on both axes, which lie in the table.
    unsafe {
        let first = _mm512_maskz_loadu_epi32(if v.has[0] { mask } else { 0 }, near.cast());
        let second =
            _mm512_maskz_loadu_epi32(if v.has[1] { mask } else { 0 }, near.wrapping_add(INNER).cast());
        _mm512_add_epi32(first, second)
    }
}

/// The sum over the local counts.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn local(tables: &TileTables, [x, y, z]: [Part; 3]) -> __m256i {
    let start = ((z.local * INNER + y.local) * INNER + x.local).wrapping_sub(INNER * INNER + INNER + 1);
    let base = tables.local.as_ptr().wrapping_add(start);
    let mask = u8::from(x.has[0]) | u8::from(x.has[1]) << 1;
    let mut words = _mm512_setzero_si512();
    for row in 0..4 {
        let (dy, dz) = (row & 1, row >> 1);
        let keep = if y.has[dy] && z.has[dz] { mask << (2 * row) } else { 0 };
        let from = base.wrapping_add(dz * INNER * INNER + dy * INNER).wrapping_sub(2 * row);
        // SAFETY: the mask keeps to entries of offsets 1..=15 on all axes, which lie in the table.
        words = unsafe { _mm512_mask_loadu_epi64(words, keep, from.cast()) };
    }
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

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,fma")]
fn features_avx512(rows: &Rows, materials: usize, counts: &[Sums], out: &mut [f32]) {
    let (width, cells) = (rows.width, out.len() / rows.width);
    assert!(width % 8 == 0 && rows.values.len() >= materials * width);
    assert!(counts.len() >= materials.div_ceil(LANES) * cells);
    let factor = _mm512_set1_pd(rows.factor);
    for (cell, out) in out.chunks_exact_mut(width).enumerate() {
        for at in (0..width).step_by(8) {
            let mut sum = _mm512_setzero_pd();
            for m in 0..materials {
                let count = _mm512_set1_pd(f64::from(counts[m / LANES * cells + cell][m % LANES]));
                // SAFETY: row `m` has `width` values and eight are left.
                let row = unsafe { _mm512_loadu_pd(rows.values.as_ptr().add(m * width + at)) };
                // Counts below 2^28 times f32 coefficients are exact, so fusing changes no bit.
                sum = _mm512_fmadd_pd(count, row, sum);
            }
            let value = _mm512_cvtpd_ps(_mm512_mul_pd(sum, factor));
            // SAFETY: `out` has `width` values and eight are left.
            unsafe { _mm256_storeu_ps(out.as_mut_ptr().add(at), value) };
        }
    }
}
