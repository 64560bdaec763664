//! The AVX-512 form of the kernels: one vector holds the counts of a pair of neighbouring table
//! entries.
#![allow(unsafe_code, reason = "masked loads through pointers, and calls past the run-time check")]

use std::arch::x86_64::*;

use pellucid_voxel::sat::tables::{BAR, CountTables, INNER, LANE_BITS, LANES, Lanes, TileRecord, TileTables};

use super::lattice::{self, Cells, Clusters, Pass};
use super::{Plane, Rows, Sums, each_corner, scalar};
use crate::axis::{Position, each};
use crate::lattice::{BarAt, LocalAt, across};

/// Proof that the machine runs this module's functions: made by [`Avx512::detect`] alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Avx512(());

impl Avx512 {
    /// The proof, where it holds.
    pub fn detect() -> Option<Self> {
        let found = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("fma");
        found.then_some(Self(()))
    }

    pub fn corner_sums(self, plane: &Plane, sums: &mut [Sums]) {
        // SAFETY: `self` proves the features that the function is compiled for.
        unsafe { corner_sums_avx512(plane, sums) }
    }

    pub fn cell_counts(self, nx: usize, sums: &[Sums], columns: &mut [Sums], cells: &mut [Sums]) {
        // SAFETY: as above.
        unsafe { cell_counts_avx512(nx, sums, columns, cells) }
    }

    pub fn plane_sums(
        self,
        pass: &mut Pass,
        points: usize,
        k: usize,
        lead: [usize; 2],
        width: usize,
        sums: &mut [Sums],
    ) {
        // SAFETY: as above.
        unsafe { plane_sums_avx512(self, pass, points, k, lead, width, sums) }
    }

    pub fn plane_cells(self, cells: &Cells, sums: &[Sums], columns: &mut [Sums], counts: &mut [Sums]) {
        // SAFETY: as above.
        unsafe { plane_cells_avx512(cells, sums, columns, counts) }
    }

    pub fn features(
        self,
        rows: &Rows,
        materials: usize,
        at: usize,
        counts: &[Sums],
        cells: usize,
        channels: [Option<usize>; 4],
        out: &mut [f32],
    ) {
        // SAFETY: as above.
        unsafe { features_avx512(rows, materials, at, counts, cells, channels, out) }
    }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn cell_counts_avx512(nx: usize, sums: &[Sums], columns: &mut [Sums], cells: &mut [Sums]) {
    scalar::cell_counts(nx, sums, columns, cells);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn plane_sums_avx512(
    proof: Avx512,
    pass: &mut Pass,
    points: usize,
    k: usize,
    lead: [usize; 2],
    width: usize,
    sums: &mut [Sums],
) {
    lattice::plane_sums(proof, pass, points, k, lead, width, sums);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn plane_cells_avx512(cells: &Cells, sums: &[Sums], columns: &mut [Sums], counts: &mut [Sums]) {
    lattice::plane_cells(cells, sums, columns, counts);
}

impl Clusters for Avx512 {
    #[inline(always)]
    fn bar(self, bars: &[Lanes; BAR], at: &BarAt) -> Sums {
        let (u, v) = (at.u, at.v);
        // SAFETY: `self` proves the features.
        unsafe { sums(folded(bar(bars, at.entry.into(), u[0] & FIRST | u[1] & (PAIR & !FIRST), v))) }
    }

    #[inline(always)]
    fn local(self, tables: &TileTables, at: &LocalAt) -> Sums {
        let [x, y, z] = at.axes;
        // SAFETY: as above.
        unsafe { sums(local(tables, at.entry.into(), x[0] & 1 | x[1] & 2, y, z)) }
    }

    #[inline(always)]
    fn ask_bar(self, bars: &[Lanes; BAR], at: &BarAt) {
        let at = bars.as_ptr().wrapping_add(at.entry.into());
        // SAFETY: asking for an address reads nothing.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(at.cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER).cast());
        }
    }

    #[inline(always)]
    fn ask_local(self, tables: &TileTables, at: &LocalAt) {
        let at = tables.local.as_ptr().wrapping_add(at.entry.into());
        // SAFETY: as above.
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(at.cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER).cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER * INNER).cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER * INNER + INNER).cast());
        }
    }
}

#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn sums(lanes: __m256i) -> Sums {
    let mut out = Sums::default();
    store(&mut out, lanes);
    out
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn corner_sums_avx512(plane: &Plane, sums: &mut [Sums]) {
    let [nx, ny] = plane.n;
    let mut views = Views::new(plane.tables);
    let zs = plane.axes[2].corner(plane.k);
    each_corner(plane, sums, |sums, [i, j, word], fresh, [sx, sy, sz]| {
        let (xs, ys) = (&plane.axes[0].corner(i)[64 * word..], &plane.axes[1].corner(j)[64 * word..]);
        let zs = &zs[64 * word..];
        let sums = &mut sums[64 * word * nx * ny + j * nx + i..];
        // The entries lie scattered over hundreds of megabytes: ask for all before using any.
        each(fresh, |p| {
            let (x, y, z) = (&xs[p], &ys[p], &zs[p]);
            let view = views.at(x.record + y.record + z.record, [x.slot, y.slot, z.slot]);
            view.prefetch(x.local.into(), y.local.into(), z.local.into());
        });
        // Each kind of corner by itself: no branch depends on where a point lies in its tile.
        each(fresh & !sx & !sy & !sz, |p| {
            let (x, y, z) = (&xs[p], &ys[p], &zs[p]);
            let view = views.at(x.record + y.record + z.record, [x.slot, y.slot, z.slot]);
            store(&mut sums[p * nx * ny], view.whole(x, y, z));
        });
        each(fresh & sx & !sy & !sz, |p| {
            store(&mut sums[p * nx * ny], split_once::<0>(&mut views, [&xs[p], &ys[p], &zs[p]]));
        });
        each(fresh & !sx & sy & !sz, |p| {
            store(&mut sums[p * nx * ny], split_once::<1>(&mut views, [&xs[p], &ys[p], &zs[p]]));
        });
        each(fresh & !sx & !sy & sz, |p| {
            store(&mut sums[p * nx * ny], split_once::<2>(&mut views, [&xs[p], &ys[p], &zs[p]]));
        });
        each(fresh & (sx & sy | sx & sz | sy & sz), |p| {
            store(&mut sums[p * nx * ny], split(&mut views, [&xs[p], &ys[p], &zs[p]]));
        });
    });
}

#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn store(to: &mut Sums, sum: __m256i) {
    // SAFETY: a `Sums` is 32 bytes.
    unsafe { _mm256_storeu_si256(to.as_mut_ptr().cast(), sum) };
}

/// What the corners in one tile look up.
#[derive(Clone, Copy)]
struct View<'a> {
    at: u32,
    /// Whether constant tiles lie behind.
    deep: bool,
    filled: bool,
    record: &'a TileRecord,
    tables: Option<&'a TileTables>,
    /// Bars behind, where there are any.
    bars: [Option<&'a [Lanes; BAR]>; 3],
}

/// The views of 4 x 4 x 4 tiles: neighbouring points take turns between a few.
struct Views<'a> {
    tables: &'a CountTables,
    views: [View<'a>; 64],
}

impl<'a> Views<'a> {
    fn new(tables: &'a CountTables) -> Self {
        let view = View::new(tables, 0);
        Self { tables, views: [View { at: u32::MAX, ..view }; 64] }
    }

    #[inline(always)]
    fn at(&mut self, record: u32, slots: [u8; 3]) -> &View<'a> {
        let view = &mut self.views[usize::from(slots[0] | slots[1] << 2 | slots[2] << 4) & 63];
        if view.at != record {
            *view = View::new(self.tables, record);
        }
        view
    }
}

impl<'a> View<'a> {
    #[inline(never)]
    fn new(tables: &'a CountTables, at: u32) -> Self {
        let record = &tables.records()[at as usize];
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

    /// Asks for what a cluster at these offsets looks up.
    #[inline]
    #[target_feature(enable = "avx512f")]
    fn prefetch(&self, lx: usize, ly: usize, lz: usize) {
        for (axis, lu, lv) in [(0, ly, lz), (1, lx, lz), (2, lx, ly)] {
            if let Some(bars) = self.bars[axis] {
                let at = bars.as_ptr().wrapping_add(lv * INNER + lu);
                _mm_prefetch::<_MM_HINT_T0>(at.cast());
                _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER).cast());
            }
        }
        if let Some(tables) = self.tables {
            let at = tables.local.as_ptr().wrapping_add((lz * INNER + ly) * INNER + lx);
            _mm_prefetch::<_MM_HINT_T0>(at.cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER).cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER * INNER).cast());
            _mm_prefetch::<_MM_HINT_T0>(at.wrapping_sub(INNER * INNER + INNER).cast());
        }
    }

    /// The sum over a 2 x 2 x 2 cluster of voxel corners within the tile.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn whole(&self, x: &Position, y: &Position, z: &Position) -> __m256i {
        let (lx, ly, lz) = (usize::from(x.local), usize::from(y.local), usize::from(z.local));
        debug_assert!(lx < INNER && ly < INNER && lz < INNER);
        let mut pairs = _mm512_add_epi32(self.line(0, lx, PAIR), self.line(1, ly, PAIR));
        pairs = _mm512_add_epi32(pairs, self.line(2, lz, PAIR));
        pairs = _mm512_add_epi32(pairs, pairs);
        if let Some(bars) = self.bars[0] {
            pairs = _mm512_add_epi32(pairs, bar_around(bars, [ly, lz], [y.inner, z.inner], [true; 2]));
        }
        if let Some(bars) = self.bars[1] {
            pairs = _mm512_add_epi32(pairs, bar_around(bars, [lx, lz], [x.inner, z.inner], [true; 2]));
        }
        if let Some(bars) = self.bars[2] {
            pairs = _mm512_add_epi32(pairs, bar_around(bars, [lx, ly], [x.inner, y.inner], [true; 2]));
        }
        pairs = _mm512_add_epi32(pairs, pairs);
        let mut sum = folded(pairs);
        let (bx, by, bz) = (i32::from(x.before), i32::from(y.before), i32::from(z.before));
        if self.deep {
            sum = _mm256_add_epi32(sum, times(&self.record.depth[0], 2 * by * bz));
            sum = _mm256_add_epi32(sum, times(&self.record.depth[1], 2 * bx * bz));
            sum = _mm256_add_epi32(sum, times(&self.record.depth[2], 2 * bx * by));
        }
        if let Some(tables) = self.tables {
            sum = _mm256_add_epi32(
                sum,
                local_around(tables, [lx, ly, lz], [x.inner, y.inner, z.inner], [true; 3]),
            );
        } else if self.filled {
            sum = _mm256_add_epi32(sum, times(&self.record.fill, bx * by * bz));
        }
        sum
    }

    /// Edge counts at an offset and the next one, or the first alone.
    #[inline]
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
    fn line(&self, axis: usize, local: usize, mask: u16) -> __m512i {
        debug_assert!(local + usize::from(mask == PAIR) <= INNER);
        // SAFETY: the mask keeps to five counts a voxel corner of the tile.
        unsafe { _mm512_maskz_loadu_epi32(mask, self.record.edges[axis].as_ptr().add(local).cast()) }
    }
}

/// The lanes of two neighbouring entries, and of the first alone.
const PAIR: u16 = 0x3ff;
const FIRST: u16 = 0x1f;

/// Adds the second entry's lanes to the first's.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn folded(pairs: __m512i) -> __m256i {
    _mm512_castsi512_si256(_mm512_add_epi32(pairs, _mm512_alignr_epi32::<5>(pairs, pairs)))
}

/// Counts times a number.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn times(counts: &Lanes, by: i32) -> __m256i {
    // SAFETY: the mask keeps to the five counts.
    let counts = unsafe { _mm256_maskz_loadu_epi32(FIRST as u8, counts.as_ptr().cast()) };
    _mm256_mullo_epi32(counts, _mm256_set1_epi32(by))
}

/// The sum over bar entries: of those before `entry` and its row and from there on, as far as the
/// lanes `u` and the rows `v` ask for them.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn bar(bars: &[Lanes; BAR], entry: usize, u: u16, v: [u16; 2]) -> __m512i {
    let near = bars.as_ptr().wrapping_add(entry).wrapping_sub(INNER + 1);
    // SAFETY: the masks keep to places 1..=15 on both axes, so what is read lies in the table.
    unsafe {
        let first = _mm512_maskz_loadu_epi32(u & v[0], near.cast());
        _mm512_add_epi32(first, _mm512_maskz_loadu_epi32(u & v[1], near.wrapping_add(INNER).cast()))
    }
}

/// The sum over the bar entries of two neighbouring offsets on both axes; of the first alone where
/// the axis has not `two`.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn bar_around(bars: &[Lanes; BAR], l: [usize; 2], inner: [u16; 2], two: [bool; 2]) -> __m512i {
    let both = two.map(|two| if two { u16::MAX } else { 0 });
    let mask = both[0] & PAIR & !FIRST | inner[0] & FIRST;
    bar(bars, l[1] * INNER + l[0], mask, [inner[1], both[1]])
}

/// The sum over the local counts of two neighbouring offsets on each axis; of the first alone where
/// the axis has not `two`.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn local_around(tables: &TileTables, l: [usize; 3], inner: [u16; 3], two: [bool; 3]) -> __m256i {
    let axis = |a: usize| [inner[a] as u8, if two[a] { u8::MAX } else { 0 }];
    let [x, y, z] = [axis(0), axis(1), axis(2)];
    local(tables, (l[2] * INNER + l[1]) * INNER + l[0], x[0] & 1 | x[1] & 2, y, z)
}

/// The sum over local counts, as [`bar`].
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn local(tables: &TileTables, entry: usize, x: u8, y: [u8; 2], z: [u8; 2]) -> __m256i {
    let base = tables.local.as_ptr().wrapping_add(entry).wrapping_sub(INNER * INNER + INNER + 1);
    // SAFETY: the masks keep to places 1..=15 on all axes, so what is read lies in the table.
    let rows = unsafe {
        let row = |keep: u8, offset: usize| _mm_maskz_loadu_epi64(x & keep, base.wrapping_add(offset).cast());
        [
            row(y[0] & z[0], 0),
            row(y[1] & z[0], INNER),
            row(y[0] & z[1], INNER * INNER),
            row(y[1] & z[1], INNER * INNER + INNER),
        ]
    };
    let near = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(rows[0]), rows[1]);
    let far = _mm256_inserti128_si256::<1>(_mm256_castsi128_si256(rows[2]), rows[3]);
    // Sums of eight 12-bit counts need 15 bits: every other material, 24 bits apart.
    const LANE: i64 = (1 << LANE_BITS) - 1;
    let odd_mask = _mm256_set1_epi64x(LANE | LANE << (2 * LANE_BITS));
    let even_mask = _mm256_set1_epi64x(LANE | LANE << (2 * LANE_BITS) | 0xffff << (4 * LANE_BITS));
    let even = _mm256_add_epi64(_mm256_and_si256(near, even_mask), _mm256_and_si256(far, even_mask));
    let odd = |v: __m256i| _mm256_and_si256(_mm256_srli_epi64::<{ LANE_BITS as i32 }>(v), odd_mask);
    let odd = _mm256_add_epi64(odd(near), odd(far));
    let both = _mm256_add_epi64(_mm256_unpacklo_epi64(even, odd), _mm256_unpackhi_epi64(even, odd));
    let both = _mm_add_epi64(_mm256_castsi256_si128(both), _mm256_extracti128_si256::<1>(both));
    // Lanes even, odd, even, odd, even: shift each material down to its own lane.
    let spread = _mm512_broadcast_i64x2(both);
    let shift = _mm512_set_epi64(0, 0, 0, 48, 24, 24, 0, 0);
    let lanes = _mm512_and_si512(_mm512_srlv_epi64(spread, shift), _mm512_set1_epi64(0xff_ffff));
    _mm512_cvtepi64_epi32(lanes)
}

/// The sum over a cluster that reaches into the next tile along axis `A` alone; see [`split`].
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn split_once<const A: usize>(views: &mut Views, at: [&Position; 3]) -> __m256i {
    let (u, v) = across(A);
    let record = at[0].record + at[1].record + at[2].record;
    let mut slots = at.map(|p| p.slot);
    let here = *views.at(record, slots);
    slots[A] = (slots[A] + 1) & 3;
    let next = *views.at(record + views.tables.strides()[A] as u32, slots);
    let l = at.map(|p| usize::from(p.local));
    let (before, inner) = (at.map(|p| i32::from(p.before)), at.map(|p| p.inner));
    let mut two = [true; 3];
    two[A] = false;
    let ends = _mm512_add_epi32(here.line(A, INNER, FIRST), next.line(A, 0, FIRST));
    let mut pairs = _mm512_add_epi32(ends, ends);
    for axis in [u, v] {
        pairs = _mm512_add_epi32(pairs, here.line(axis, l[axis], PAIR));
        pairs = _mm512_add_epi32(pairs, next.line(axis, l[axis], PAIR));
        if let Some(bars) = here.bars[axis] {
            let (a, b) = across(axis);
            pairs = _mm512_add_epi32(
                pairs,
                bar_around(bars, [l[a], l[b]], [inner[a], inner[b]], [two[a], two[b]]),
            );
        }
    }
    pairs = _mm512_add_epi32(pairs, pairs);
    let mut sum = _mm256_setzero_si256();
    for view in [&here, &next] {
        if let Some(bars) = view.bars[A] {
            pairs = _mm512_add_epi32(pairs, bar_around(bars, [l[u], l[v]], [inner[u], inner[v]], [true; 2]));
        }
        if view.deep {
            sum = _mm256_add_epi32(sum, times(&view.record.depth[A], before[u] * before[v]));
        }
    }
    if here.deep {
        sum = _mm256_add_epi32(sum, times(&here.record.depth[u], 2 * before[A] * before[v]));
        sum = _mm256_add_epi32(sum, times(&here.record.depth[v], 2 * before[A] * before[u]));
    }
    if let Some(tables) = here.tables {
        sum = _mm256_add_epi32(sum, local_around(tables, l, inner, two));
    } else if here.filled {
        sum = _mm256_add_epi32(sum, times(&here.record.fill, before[0] * before[1] * before[2]));
    }
    _mm256_add_epi32(sum, folded(pairs))
}

/// The sum over a cluster that reaches into the next tile along an axis or more.
///
/// In the next tile its voxel corner has offset 0, where bars and local counts on that axis are
/// none: only edges and the bars along the axis count there.
#[inline(never)]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn split(views: &mut Views, at: [&Position; 3]) -> __m256i {
    let strides = views.tables.strides();
    let two = at.map(|p| usize::from(p.local) != INNER);
    let shift = two.map(u32::from);
    let inner = at.map(|p| p.inner);
    let masks = two.map(|two| if two { PAIR } else { FIRST });
    let mut pairs = _mm512_setzero_si512();
    let mut sum = _mm256_setzero_si256();
    for step in 0..8usize {
        let next = [step & 1 == 1, step & 2 == 2, step & 4 == 4];
        if next[0] && two[0] || next[1] && two[1] || next[2] && two[2] {
            continue;
        }
        let mut record = 0;
        let mut slots = [0; 3];
        for a in 0..3 {
            record += at[a].record + if next[a] { strides[a] as u32 } else { 0 };
            slots[a] = (at[a].slot + u8::from(next[a])) & 3;
        }
        let view = views.at(record, slots);
        let l: [usize; 3] = std::array::from_fn(|a| if next[a] { 0 } else { at[a].local.into() });
        let b: [i32; 3] = std::array::from_fn(|a| if next[a] { 0 } else { at[a].before.into() });
        let mut add = |counts: __m512i, shift: u32| {
            let shift = _mm_cvtsi32_si128(shift as i32);
            pairs = _mm512_add_epi32(pairs, _mm512_sll_epi32(counts, shift));
        };
        add(view.line(0, l[0], masks[0]), shift[1] + shift[2]);
        add(view.line(1, l[1], masks[1]), shift[0] + shift[2]);
        add(view.line(2, l[2], masks[2]), shift[0] + shift[1]);
        if let (Some(bars), false, false) = (view.bars[0], next[1], next[2]) {
            add(bar_around(bars, [l[1], l[2]], [inner[1], inner[2]], [two[1], two[2]]), shift[0]);
        }
        if let (Some(bars), false, false) = (view.bars[1], next[0], next[2]) {
            add(bar_around(bars, [l[0], l[2]], [inner[0], inner[2]], [two[0], two[2]]), shift[1]);
        }
        if let (Some(bars), false, false) = (view.bars[2], next[0], next[1]) {
            add(bar_around(bars, [l[0], l[1]], [inner[0], inner[1]], [two[0], two[1]]), shift[2]);
        }
        if view.deep {
            sum = _mm256_add_epi32(sum, times(&view.record.depth[0], (b[1] * b[2]) << shift[0]));
            sum = _mm256_add_epi32(sum, times(&view.record.depth[1], (b[0] * b[2]) << shift[1]));
            sum = _mm256_add_epi32(sum, times(&view.record.depth[2], (b[0] * b[1]) << shift[2]));
        }
        if step > 0 {
            continue;
        }
        if let Some(tables) = view.tables {
            sum = _mm256_add_epi32(sum, local_around(tables, l, inner, two));
        } else if view.filled {
            sum = _mm256_add_epi32(sum, times(&view.record.fill, b[0] * b[1] * b[2]));
        }
    }
    _mm256_add_epi32(sum, folded(pairs))
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
    // The rows of the first group stay in registers.
    let near: [__m512d; LANES] = std::array::from_fn(|m| {
        if m < materials {
            // SAFETY: each of the `materials` rows has eight values from `at` on.
            unsafe { _mm512_loadu_pd(rows.values.as_ptr().add(m * rows.width + at)) }
        } else {
            _mm512_setzero_pd()
        }
    });
    for cell in 0..cells {
        // SAFETY: a `Sums` is 32 bytes, and there is one a group and cell.
        let lanes = _mm512_cvtepu32_pd(unsafe { _mm256_loadu_si256(counts.as_ptr().add(cell).cast()) });
        let mut sum = _mm512_setzero_pd();
        for m in 0..LANES {
            let count = _mm512_permutexvar_pd(_mm512_set1_epi64(m as i64), lanes);
            // Counts below 2^28 times f32 coefficients are exact: fusing changes no bit.
            sum = _mm512_fmadd_pd(count, near[m], sum);
        }
        for first in (LANES..materials).step_by(LANES) {
            // SAFETY: a `Sums` is 32 bytes, and there is one a group and cell.
            let lanes =
                unsafe { _mm256_loadu_si256(counts.as_ptr().add(first / LANES * cells + cell).cast()) };
            let lanes = _mm512_cvtepu32_pd(lanes);
            for m in 0..LANES.min(materials - first) {
                let count = _mm512_permutexvar_pd(_mm512_set1_epi64(m as i64), lanes);
                // SAFETY: each of the `materials` rows has eight values from `at` on.
                let row = unsafe { _mm512_loadu_pd(rows.values.as_ptr().add((first + m) * rows.width + at)) };
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
