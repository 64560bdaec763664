//! The AVX-512 form of the window's kernels, and features eight cells at a time.
#![allow(unsafe_code, reason = "loads and stores through pointers, and calls past the run-time check")]

use std::arch::x86_64::*;

use pellucid_voxel::sat::tables::LANES;

use super::avx512::Avx512;
use super::{Rows, Sums, packed};

impl Avx512 {
    /// Two features a channel of one group of materials; at least eight cells.
    pub fn paired_features(
        self,
        rows: &Rows,
        materials: usize,
        counts: &[Sums],
        starts: impl Iterator<Item = usize>,
        out: &mut [f32],
    ) {
        assert!(materials <= LANES && rows.features == 2 && counts.len() >= 8);
        for (channel, start) in starts.enumerate() {
            let mut values = [[0.0; 2]; LANES];
            for (m, values) in values.iter_mut().enumerate().take(materials) {
                values.copy_from_slice(&rows.values[m * rows.width + 2 * channel..][..2]);
            }
            let out = &mut out[start..start + 2 * counts.len()];
            // SAFETY: `self` proves the features that the function is compiled for.
            unsafe { paired_features(&values, rows.factor, counts, out) }
        }
    }

    pub fn window_sums(
        self,
        size: [usize; 3],
        labels: &[u8],
        units: &[u64; 256],
        pair: &mut Vec<u64>,
        sums: &mut [u64],
    ) {
        // SAFETY: as above.
        unsafe { window_sums_avx512(size, labels, units, pair, sums) }
    }

    pub fn window_cells(self, n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [u64]) {
        // SAFETY: as above.
        unsafe { window_cells_avx512(n, strides, sums, cells) }
    }

    /// [`packed::unpack`] of each word.
    pub fn unpack(self, words: &[u64], cells: &mut [Sums]) {
        // SAFETY: as above.
        unsafe { unpack(words, cells) }
    }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn window_sums_avx512(
    size: [usize; 3],
    labels: &[u8],
    units: &[u64; 256],
    pair: &mut Vec<u64>,
    sums: &mut [u64],
) {
    packed::sum_labels(size, labels, units, pair, sums);
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn window_cells_avx512(n: [usize; 3], strides: [usize; 3], sums: &[u64], cells: &mut [u64]) {
    packed::cells_between(n, strides, sums, cells);
}

/// Columns of eight rows of four words each: the first words of all rows, the second and so on.
#[inline]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn transposed(rows: [__m256i; 8]) -> [__m512i; 4] {
    let two = |a: usize, b: usize| _mm512_inserti64x4::<1>(_mm512_castsi256_si512(rows[a]), rows[b]);
    // Rows 0 and 4, 1 and 5, 2 and 6, 3 and 7.
    let (r0, r1, r2, r3) = (two(0, 4), two(1, 5), two(2, 6), two(3, 7));
    let (a, b) = (_mm512_unpacklo_epi64(r0, r1), _mm512_unpackhi_epi64(r0, r1));
    let (c, d) = (_mm512_unpacklo_epi64(r2, r3), _mm512_unpackhi_epi64(r2, r3));
    let low = _mm512_set_epi64(13, 12, 5, 4, 9, 8, 1, 0);
    let high = _mm512_set_epi64(15, 14, 7, 6, 11, 10, 3, 2);
    [
        _mm512_permutex2var_epi64(a, low, c),
        _mm512_permutex2var_epi64(b, low, d),
        _mm512_permutex2var_epi64(a, high, c),
        _mm512_permutex2var_epi64(b, high, d),
    ]
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,fma")]
fn paired_features(values: &[[f64; 2]; LANES], factor: f64, counts: &[Sums], out: &mut [f32]) {
    let (cells, factor) = (counts.len(), _mm512_set1_pd(factor));
    assert!(cells >= 8 && out.len() >= 2 * cells);
    for block in 0..cells.div_ceil(8) {
        // The last block overlaps the one before, with the same values.
        let first = (8 * block).min(cells - 8);
        // SAFETY: eight cells of 32 bytes from `first` on.
        let rows =
            std::array::from_fn(|i| unsafe { _mm256_loadu_si256(counts.as_ptr().add(first + i).cast()) });
        // Two materials a column.
        let columns = transposed(rows);
        let mut sums = [_mm512_setzero_pd(); 2];
        for (m, values) in values.iter().enumerate() {
            let column = columns[m / 2];
            let count = if m % 2 == 0 { column } else { _mm512_srli_epi64::<32>(column) };
            let count = _mm512_cvtepu32_pd(_mm512_cvtepi64_epi32(count));
            // Counts below 2^28 times f32 coefficients are exact: fusing changes no bit.
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum = _mm512_fmadd_pd(count, _mm512_set1_pd(*value), *sum);
            }
        }
        let [s, a] = sums.map(|sum| _mm512_castps256_ps512(_mm512_cvtpd_ps(_mm512_mul_pd(sum, factor))));
        let turns = _mm512_set_epi32(23, 7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
        // SAFETY: two values of each of eight cells from `first` on.
        unsafe {
            _mm512_storeu_ps(out.as_mut_ptr().add(2 * first), _mm512_permutex2var_ps(s, turns, a));
        }
    }
}

#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw")]
fn unpack(words: &[u64], cells: &mut [Sums]) {
    assert_eq!(words.len(), cells.len());
    let (blocks, rest) = words.as_chunks::<8>();
    let (wide, narrow) = cells.split_at_mut(8 * blocks.len());
    let mask = _mm512_set1_epi64((1 << packed::FIELD) - 1);
    let most = _mm512_set1_epi64(packed::MAX_COUNT.into());
    for (words, cells) in blocks.iter().zip(wide.chunks_exact_mut(8)) {
        // SAFETY: eight words.
        let word = unsafe { _mm512_loadu_si512(words.as_ptr().cast()) };
        const F: u32 = packed::FIELD;
        let a = _mm512_and_si512(word, mask);
        let b = _mm512_and_si512(_mm512_srli_epi64::<F>(word), mask);
        let c = _mm512_and_si512(_mm512_srli_epi64::<{ 2 * F }>(word), mask);
        let d = _mm512_and_si512(_mm512_srli_epi64::<{ 3 * F }>(word), mask);
        // All of both bits set: only a cell full of the last material.
        let full = _mm512_and_si512(_mm512_and_si512(a, b), most);
        let last = _mm512_or_si512(_mm512_srli_epi64::<{ 4 * F }>(word), full);
        let (a, b) = (_mm512_sub_epi64(a, last), _mm512_sub_epi64(b, last));
        let pair = |low, high| _mm512_or_si512(low, _mm512_slli_epi64::<32>(high));
        let (ab, cd) = (pair(a, b), pair(c, d));
        // Rows of four words: ab, cd, last and nothing.
        let (even, odd) = (_mm512_unpacklo_epi64(ab, cd), _mm512_unpackhi_epi64(ab, cd));
        let zero = _mm512_setzero_si512();
        let (even_last, odd_last) = (_mm512_unpacklo_epi64(last, zero), _mm512_unpackhi_epi64(last, zero));
        let halves = |first, second| {
            [
                _mm512_shuffle_i64x2::<0b01_00_01_00>(first, second),
                _mm512_shuffle_i64x2::<0b11_10_11_10>(first, second),
            ]
        };
        let order = _mm512_set_epi64(7, 6, 3, 2, 5, 4, 1, 0);
        let [e0, e1] = halves(even, even_last);
        let [o0, o1] = halves(odd, odd_last);
        // Each holds two cells: 0 and 2, 4 and 6, 1 and 3, 5 and 7.
        for (cell, two) in [(0, e0), (4, e1), (1, o0), (5, o1)] {
            let two = _mm512_permutexvar_epi64(order, two);
            // SAFETY: a `Sums` is 32 bytes.
            unsafe {
                _mm256_storeu_si256(cells[cell].as_mut_ptr().cast(), _mm512_castsi512_si256(two));
                let second = _mm512_extracti64x4_epi64::<1>(two);
                _mm256_storeu_si256(cells[cell + 2].as_mut_ptr().cast(), second);
            }
        }
    }
    for (word, cell) in rest.iter().zip(narrow) {
        *cell = packed::unpack(*word);
    }
}
