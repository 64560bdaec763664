//! The products in AVX-512.
#![allow(unsafe_code, reason = "vector intrinsics, by a proof that the machine has them")]

use std::arch::x86_64::*;

use super::compiled::compile_plain_work;
use super::optimiser::{self, Update};
use super::tiles::{Lanes, Step, Tile, Work};
use super::{Left, Matrix, Packed, Target, features, pack};
use crate::Precision;

/// Rows of a tile: twelve times two accumulators leave registers for the factors.
const ROWS: usize = 12;

/// Proof that this machine has the instructions used here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Proof {
    /// Whether it multiplies bf16.
    bf16: bool,
}

impl Proof {
    /// `None` on machines without AVX-512. Products of bf16 are made by f32 ones unless `bf16` allows for them.
    pub(super) fn detect(bf16: bool) -> Option<Self> {
        let all = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("fma");
        all.then(|| Self { bf16: bf16 && is_x86_feature_detected!("avx512bf16") })
    }

    /// Whether it multiplies bf16.
    pub(super) fn bf16(self) -> bool {
        self.bf16
    }
}

compile_plain_work!("avx512f,avx512bw,avx512vl,fma");

/// `target = left right`, finished.
pub(super) fn product(proof: Proof, mut target: Target<'_>, left: Left<'_>, right: &Packed) {
    let work = Work::new(&mut target, &left, right);
    // SAFETY: the machine has the features by the proof; the tiles are the product's own.
    work.each_tile(ROWS, Vectors::LANES, |t| unsafe {
        match (right.precision, proof.bf16) {
            (Precision::F32, _) => tile::<Single>(&work, t),
            (Precision::Bf16, true) => tile_bf16(&work, t),
            (Precision::Bf16, false) => tile::<Widened>(&work, t),
        }
    });
}

/// # Safety
/// As [`Work::tile`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl,fma")]
unsafe fn tile<S: Step<Vectors>>(work: &Work<'_>, tile: Tile) {
    // SAFETY: the caller's promise.
    unsafe { any_rows::<S>(work, tile) }
}

/// # Safety
/// As [`Work::tile`].
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512bf16,fma")]
unsafe fn tile_bf16(work: &Work<'_>, tile: Tile) {
    // SAFETY: the caller's promise.
    unsafe { any_rows::<Pairs>(work, tile) }
}

/// # Safety
/// As [`Work::tile`].
#[inline(always)]
unsafe fn any_rows<S: Step<Vectors>>(work: &Work<'_>, tile: Tile) {
    // SAFETY: the caller's promise.
    unsafe {
        match tile.rows {
            1 => work.tile::<Vectors, S, 1>(tile),
            2 => work.tile::<Vectors, S, 2>(tile),
            3 => work.tile::<Vectors, S, 3>(tile),
            4 => work.tile::<Vectors, S, 4>(tile),
            5 => work.tile::<Vectors, S, 5>(tile),
            6 => work.tile::<Vectors, S, 6>(tile),
            7 => work.tile::<Vectors, S, 7>(tile),
            8 => work.tile::<Vectors, S, 8>(tile),
            9 => work.tile::<Vectors, S, 9>(tile),
            10 => work.tile::<Vectors, S, 10>(tile),
            11 => work.tile::<Vectors, S, 11>(tile),
            _ => work.tile::<Vectors, S, ROWS>(tile),
        }
    }
}

/// Sixteen lanes.
struct Vectors;

impl Vectors {
    #[inline(always)]
    fn first(count: usize) -> __mmask16 {
        if count >= Self::LANES { !0 } else { (1 << count) - 1 }
    }
}

impl Lanes for Vectors {
    type Sums = __m512;
    type Words = __m512i;
    const LANES: usize = 16;

    #[inline(always)]
    unsafe fn zero() -> __m512 {
        // SAFETY: the caller's promise, here and below.
        unsafe { _mm512_setzero_ps() }
    }

    #[inline(always)]
    unsafe fn splat(word: u32) -> __m512i {
        unsafe { _mm512_set1_epi32(word as i32) }
    }

    #[inline(always)]
    unsafe fn words(at: *const u32) -> __m512i {
        unsafe { _mm512_loadu_epi32(at.cast()) }
    }

    #[inline(always)]
    unsafe fn load(at: *const f32, count: usize) -> __m512 {
        unsafe { _mm512_maskz_loadu_ps(Self::first(count), at) }
    }

    #[inline(always)]
    unsafe fn store(at: *mut f32, count: usize, v: __m512) {
        unsafe { _mm512_mask_storeu_ps(at, Self::first(count), v) }
    }

    #[inline(always)]
    unsafe fn add(a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_add_ps(a, b) }
    }

    #[inline(always)]
    unsafe fn relu(v: __m512) -> __m512 {
        unsafe { _mm512_max_ps(v, _mm512_setzero_ps()) }
    }

    #[inline(always)]
    unsafe fn keep(v: __m512, mask: __m512) -> __m512 {
        unsafe { _mm512_maskz_mov_ps(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(mask, _mm512_setzero_ps()), v) }
    }
}

/// Words are f32.
struct Single;

impl Step<Vectors> for Single {
    #[inline(always)]
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512 {
        unsafe { _mm512_fmadd_ps(_mm512_castsi512_ps(a), _mm512_castsi512_ps(b), sum) }
    }
}

/// Words are pairs of bf16 on a machine that multiplies f32 only.
struct Widened;

impl Step<Vectors> for Widened {
    #[inline(always)]
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512 {
        unsafe {
            let high = _mm512_set1_epi32(0xffff_0000_u32 as i32);
            let odd = |v| _mm512_castsi512_ps(_mm512_and_si512(v, high));
            let even = |v| _mm512_castsi512_ps(_mm512_slli_epi32::<16>(v));
            _mm512_fmadd_ps(even(a), even(b), _mm512_fmadd_ps(odd(a), odd(b), sum))
        }
    }
}

/// Words are pairs of bf16.
struct Pairs;

impl Step<Vectors> for Pairs {
    #[inline(always)]
    unsafe fn accumulate(sum: __m512, a: __m512i, b: __m512i) -> __m512 {
        // SAFETY: the caller's promise; both types are 64 bytes of plain data.
        unsafe {
            let pairs = |v| std::mem::transmute::<__m512i, __m512bh>(v);
            _mm512_dpbf16_ps(sum, pairs(a), pairs(b))
        }
    }
}
