//! The products in AVX2 with FMA: term by term the sums of the AVX-512 form on f32, so both give the same bits.
#![allow(unsafe_code, reason = "vector intrinsics, by a proof that the machine has them")]

use std::arch::x86_64::*;

use super::compiled::compile_plain_work;
use super::optimiser::{self, Update};
use super::tiles::{Lanes, Step, Tile, Work};
use super::{Left, Matrix, Packed, Target, features, pack};
use crate::Precision;

/// Rows of a tile: six times two accumulators leave four registers for the factors, four times two leave eight for
/// factors that are widened.
const ROWS: usize = 6;
const WIDENED_ROWS: usize = 4;

/// Proof that this machine has the instructions used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Proof(());

impl Proof {
    /// `None` on machines without AVX2 or FMA.
    pub(super) fn detect() -> Option<Self> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Self(()))
    }
}

compile_plain_work!("avx2,fma");

/// `target = left right`, finished. Pairs of bf16 are widened and multiplied as f32.
pub(super) fn product(_: Proof, mut target: Target<'_>, left: Left<'_>, right: &Packed) {
    let work = Work::new(&mut target, &left, right);
    // SAFETY: the machine has the features by the proof; the tiles are the product's own.
    let rows = if right.precision == Precision::F32 { ROWS } else { WIDENED_ROWS };
    work.each_tile(rows, Vectors::LANES, |t| unsafe {
        match right.precision {
            Precision::F32 => tile::<Single>(&work, t),
            Precision::Bf16 => tile::<Widened>(&work, t),
        }
    });
}

/// # Safety
/// As [`Work::tile`].
#[target_feature(enable = "avx2,fma")]
unsafe fn tile<S: Step<Vectors>>(work: &Work<'_>, tile: Tile) {
    // SAFETY: the caller's promise.
    unsafe {
        match tile.rows {
            1 => work.tile::<Vectors, S, 1>(tile),
            2 => work.tile::<Vectors, S, 2>(tile),
            3 => work.tile::<Vectors, S, 3>(tile),
            4 => work.tile::<Vectors, S, 4>(tile),
            5 => work.tile::<Vectors, S, 5>(tile),
            _ => work.tile::<Vectors, S, ROWS>(tile),
        }
    }
}

/// Eight lanes.
struct Vectors;

impl Vectors {
    /// Signs set in the first `count` lanes.
    #[inline(always)]
    unsafe fn first(count: usize) -> __m256i {
        // SAFETY: the caller's promise, here and below.
        unsafe {
            let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            _mm256_cmpgt_epi32(_mm256_set1_epi32(count as i32), lane)
        }
    }
}

impl Lanes for Vectors {
    type Sums = __m256;
    type Words = __m256i;
    const LANES: usize = 8;

    #[inline(always)]
    unsafe fn zero() -> __m256 {
        unsafe { _mm256_setzero_ps() }
    }

    #[inline(always)]
    unsafe fn splat(word: u32) -> __m256i {
        unsafe { _mm256_set1_epi32(word as i32) }
    }

    #[inline(always)]
    unsafe fn words(at: *const u32) -> __m256i {
        unsafe { _mm256_loadu_si256(at.cast()) }
    }

    #[inline(always)]
    unsafe fn load(at: *const f32, count: usize) -> __m256 {
        // Masked reads and writes are slow on some processors.
        unsafe {
            if count >= Self::LANES {
                _mm256_loadu_ps(at)
            } else {
                _mm256_maskload_ps(at, Self::first(count))
            }
        }
    }

    #[inline(always)]
    unsafe fn store(at: *mut f32, count: usize, v: __m256) {
        unsafe {
            if count >= Self::LANES {
                _mm256_storeu_ps(at, v);
            } else {
                _mm256_maskstore_ps(at, Self::first(count), v);
            }
        }
    }

    #[inline(always)]
    unsafe fn add(a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_add_ps(a, b) }
    }

    #[inline(always)]
    unsafe fn relu(v: __m256) -> __m256 {
        unsafe { _mm256_max_ps(v, _mm256_setzero_ps()) }
    }

    #[inline(always)]
    unsafe fn keep(v: __m256, mask: __m256) -> __m256 {
        unsafe { _mm256_and_ps(v, _mm256_cmp_ps::<_CMP_GT_OQ>(mask, _mm256_setzero_ps())) }
    }
}

/// Words are f32.
struct Single;

impl Step<Vectors> for Single {
    #[inline(always)]
    unsafe fn accumulate(sum: __m256, a: __m256i, b: __m256i) -> __m256 {
        unsafe { _mm256_fmadd_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), sum) }
    }
}

/// Words are pairs of bf16.
struct Widened;

impl Step<Vectors> for Widened {
    #[inline(always)]
    unsafe fn accumulate(sum: __m256, a: __m256i, b: __m256i) -> __m256 {
        unsafe {
            let high = _mm256_set1_epi32(0xffff_0000_u32 as i32);
            let odd = |v| _mm256_castsi256_ps(_mm256_and_si256(v, high));
            let even = |v| _mm256_castsi256_ps(_mm256_slli_epi32::<16>(v));
            _mm256_fmadd_ps(even(a), even(b), _mm256_fmadd_ps(odd(a), odd(b), sum))
        }
    }
}
