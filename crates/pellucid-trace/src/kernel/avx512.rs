//! The sixteen lanes on AVX-512 (F, DQ, VL, BW).
//!
//! Safety of the intrinsics: an [`Avx512`] exists only after [`Avx512::detect`] saw the features.

use std::arch::x86_64::*;

use super::lanes::Lanes;
use crate::rng::{PCG_INCREMENT, PCG_MULTIPLIER};

/// Proof that the processor has AVX-512 F, DQ, VL and BW, and all of AVX2's companions.
#[derive(Clone, Copy)]
pub(crate) struct Avx512(());

impl Avx512 {
    /// `Some` when the processor has the features.
    pub(crate) fn detect() -> Option<Self> {
        let found = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("lzcnt");
        found.then_some(Self(()))
    }
}

/// Even lanes in the first, odd lanes in the second.
type Wide = [__m512i; 2];

impl Lanes for Avx512 {
    type F = __m512;
    type I = __m512i;
    type W = Wide;
    type M = __mmask16;

    #[inline(always)]
    fn splat(self, v: f32) -> __m512 {
        unsafe { _mm512_set1_ps(v) }
    }
    #[inline(always)]
    fn load(self, v: &[f32; 16]) -> __m512 {
        unsafe { _mm512_loadu_ps(v.as_ptr()) }
    }
    #[inline(always)]
    fn store(self, v: __m512) -> [f32; 16] {
        let mut out = [0.0; 16];
        unsafe { _mm512_storeu_ps(out.as_mut_ptr(), v) };
        out
    }
    #[inline(always)]
    fn add(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_add_ps(a, b) }
    }
    #[inline(always)]
    fn sub(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_sub_ps(a, b) }
    }
    #[inline(always)]
    fn mul(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mul_ps(a, b) }
    }
    #[inline(always)]
    fn div(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_div_ps(a, b) }
    }
    #[inline(always)]
    fn fma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        unsafe { _mm512_fmadd_ps(a, b, c) }
    }
    #[inline(always)]
    fn fnma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        unsafe { _mm512_fnmadd_ps(a, b, c) }
    }
    #[inline(always)]
    fn min(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_min_ps(a, b) }
    }
    #[inline(always)]
    fn max(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_max_ps(a, b) }
    }
    #[inline(always)]
    fn sqrt(self, a: __m512) -> __m512 {
        unsafe { _mm512_sqrt_ps(a) }
    }
    #[inline(always)]
    fn abs(self, a: __m512) -> __m512 {
        unsafe { _mm512_abs_ps(a) }
    }
    #[inline(always)]
    fn lt(self, a: __m512, b: __m512) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) }
    }
    #[inline(always)]
    fn le(self, a: __m512, b: __m512) -> __mmask16 {
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b) }
    }
    #[inline(always)]
    fn select(self, m: __mmask16, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mask_blend_ps(m, b, a) }
    }
    #[inline(always)]
    fn lookup(self, table: __m512, i: __m512i) -> __m512 {
        unsafe { _mm512_permutexvar_ps(i, table) }
    }
    #[inline(always)]
    fn splat_i(self, v: u32) -> __m512i {
        unsafe { _mm512_set1_epi32(v as i32) }
    }
    #[inline(always)]
    fn load_i(self, v: &[u32; 16]) -> __m512i {
        unsafe { _mm512_loadu_si512(v.as_ptr().cast()) }
    }
    #[inline(always)]
    fn store_i(self, v: __m512i) -> [u32; 16] {
        let mut out = [0; 16];
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().cast(), v) };
        out
    }
    #[inline(always)]
    fn add_i(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_add_epi32(a, b) }
    }
    #[inline(always)]
    fn sub_i(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_sub_epi32(a, b) }
    }
    #[inline(always)]
    fn mul_i(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_mullo_epi32(a, b) }
    }
    #[inline(always)]
    fn and_i(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_and_si512(a, b) }
    }
    #[inline(always)]
    fn or_i(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_or_si512(a, b) }
    }
    #[inline(always)]
    fn shl<const N: u32>(self, a: __m512i) -> __m512i {
        unsafe { _mm512_slli_epi32::<N>(a) }
    }
    #[inline(always)]
    fn shr<const N: u32>(self, a: __m512i) -> __m512i {
        unsafe { _mm512_srli_epi32::<N>(a) }
    }
    #[inline(always)]
    fn shr_by(self, a: __m512i, n: __m512i) -> __m512i {
        unsafe { _mm512_srlv_epi32(a, n) }
    }
    #[inline(always)]
    fn min_u(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_min_epu32(a, b) }
    }
    #[inline(always)]
    fn eq_i(self, a: __m512i, b: __m512i) -> __mmask16 {
        unsafe { _mm512_cmpeq_epi32_mask(a, b) }
    }
    #[inline(always)]
    fn to_i(self, a: __m512) -> __m512i {
        unsafe { _mm512_cvttps_epi32(a) }
    }
    #[inline(always)]
    fn to_f(self, a: __m512i) -> __m512 {
        unsafe { _mm512_cvtepi32_ps(a) }
    }
    #[inline(always)]
    fn bits(self, a: __m512) -> __m512i {
        unsafe { _mm512_castps_si512(a) }
    }
    #[inline(always)]
    fn floats(self, a: __m512i) -> __m512 {
        unsafe { _mm512_castsi512_ps(a) }
    }
    #[inline(always)]
    unsafe fn gather(self, words: &[u32], i: __m512i) -> __m512i {
        unsafe { _mm512_i32gather_epi32::<4>(i, words.as_ptr().cast()) }
    }
    #[inline(always)]
    fn load_w(self, v: &[u64; 16]) -> Wide {
        std::array::from_fn(|h| {
            let half: [u64; 8] = std::array::from_fn(|i| v[2 * i + h]);
            unsafe { _mm512_loadu_si512(half.as_ptr().cast()) }
        })
    }
    #[inline(always)]
    fn select_w(self, m: __mmask16, a: Wide, b: Wide) -> Wide {
        // Even lanes of the mask for the first half, odd lanes for the second.
        let m = u32::from(m);
        unsafe {
            [
                _mm512_mask_blend_epi64(even_bits(m), b[0], a[0]),
                _mm512_mask_blend_epi64(even_bits(m >> 1), b[1], a[1]),
            ]
        }
    }
    #[inline(always)]
    fn draw(self, s: Wide) -> (Wide, __m512i) {
        unsafe {
            let factor = _mm512_set1_epi64(PCG_MULTIPLIER as i64);
            let addend = _mm512_set1_epi64(PCG_INCREMENT as i64);
            let next = [
                _mm512_add_epi64(_mm512_mullo_epi64(s[0], factor), addend),
                _mm512_add_epi64(_mm512_mullo_epi64(s[1], factor), addend),
            ];
            let x = [
                _mm512_xor_si512(_mm512_srli_epi64::<18>(s[0]), s[0]),
                _mm512_xor_si512(_mm512_srli_epi64::<18>(s[1]), s[1]),
            ];
            let word =
                _mm512_mask_blend_epi32(0xAAAA, _mm512_srli_epi64::<27>(x[0]), _mm512_slli_epi64::<5>(x[1]));
            // The odd lanes' rotation is in the high half's low bits; counts are taken modulo 32.
            let turn =
                _mm512_mask_blend_epi32(0xAAAA, _mm512_srli_epi64::<59>(s[0]), _mm512_srli_epi64::<27>(s[1]));
            (next, _mm512_rorv_epi32(word, turn))
        }
    }
    #[inline(always)]
    fn mask(self, bits: u16) -> __mmask16 {
        bits
    }
    #[inline(always)]
    fn mask_bits(self, m: __mmask16) -> u16 {
        m
    }
    #[inline(always)]
    fn and(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a & b
    }
    #[inline(always)]
    fn and_not(self, a: __mmask16, b: __mmask16) -> __mmask16 {
        a & !b
    }
}

/// Gathers the even bits of a 16-bit number into a byte.
#[inline(always)]
fn even_bits(m: u32) -> u8 {
    let m = m & 0x5555;
    let m = (m | m >> 1) & 0x3333;
    let m = (m | m >> 2) & 0x0F0F;
    ((m | m >> 4) & 0x00FF) as u8
}
