//! The sixteen lanes on pairs of AVX2 vectors with FMA.

use std::arch::x86_64::*;
use std::array::from_fn;

use super::lanes::Lanes;
use crate::rng::{PCG_INCREMENT, PCG_MULTIPLIER};

/// Proof that the processor has AVX2 and FMA.
#[derive(Clone, Copy)]
pub(crate) struct Avx2(());

impl Avx2 {
    /// `Some` when the processor has the features.
    pub(crate) fn detect() -> Option<Self> {
        let found = is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("popcnt")
            && is_x86_feature_detected!("lzcnt");
        found.then_some(Self(()))
    }
}

type F = [__m256; 2];
type I = [__m256i; 2];
/// Vectors 0 and 1 the even and odd lanes of the lower eight, 2 and 3 of the upper eight.
type W = [__m256i; 4];

impl Lanes for Avx2 {
    type F = F;
    type I = I;
    type W = W;
    /// All bits of a lane, or none.
    type M = I;

    #[inline(always)]
    fn splat(self, v: f32) -> F {
        unsafe { [_mm256_set1_ps(v); 2] }
    }
    #[inline(always)]
    fn load(self, v: &[f32; 16]) -> F {
        unsafe { [_mm256_loadu_ps(v.as_ptr()), _mm256_loadu_ps(v[8..].as_ptr())] }
    }
    #[inline(always)]
    fn store(self, v: F) -> [f32; 16] {
        let mut out = [0.0; 16];
        unsafe {
            _mm256_storeu_ps(out.as_mut_ptr(), v[0]);
            _mm256_storeu_ps(out[8..].as_mut_ptr(), v[1]);
        }
        out
    }
    #[inline(always)]
    fn add(self, a: F, b: F) -> F {
        unsafe { [_mm256_add_ps(a[0], b[0]), _mm256_add_ps(a[1], b[1])] }
    }
    #[inline(always)]
    fn sub(self, a: F, b: F) -> F {
        unsafe { [_mm256_sub_ps(a[0], b[0]), _mm256_sub_ps(a[1], b[1])] }
    }
    #[inline(always)]
    fn mul(self, a: F, b: F) -> F {
        unsafe { [_mm256_mul_ps(a[0], b[0]), _mm256_mul_ps(a[1], b[1])] }
    }
    #[inline(always)]
    fn div(self, a: F, b: F) -> F {
        unsafe { [_mm256_div_ps(a[0], b[0]), _mm256_div_ps(a[1], b[1])] }
    }
    #[inline(always)]
    fn fma(self, a: F, b: F, c: F) -> F {
        unsafe { [_mm256_fmadd_ps(a[0], b[0], c[0]), _mm256_fmadd_ps(a[1], b[1], c[1])] }
    }
    #[inline(always)]
    fn fnma(self, a: F, b: F, c: F) -> F {
        unsafe { [_mm256_fnmadd_ps(a[0], b[0], c[0]), _mm256_fnmadd_ps(a[1], b[1], c[1])] }
    }
    #[inline(always)]
    fn min(self, a: F, b: F) -> F {
        unsafe { [_mm256_min_ps(a[0], b[0]), _mm256_min_ps(a[1], b[1])] }
    }
    #[inline(always)]
    fn max(self, a: F, b: F) -> F {
        unsafe { [_mm256_max_ps(a[0], b[0]), _mm256_max_ps(a[1], b[1])] }
    }
    #[inline(always)]
    fn sqrt(self, a: F) -> F {
        unsafe { [_mm256_sqrt_ps(a[0]), _mm256_sqrt_ps(a[1])] }
    }
    #[inline(always)]
    fn abs(self, a: F) -> F {
        unsafe {
            [_mm256_andnot_ps(_mm256_set1_ps(-0.0), a[0]), _mm256_andnot_ps(_mm256_set1_ps(-0.0), a[1])]
        }
    }
    #[inline(always)]
    fn lt(self, a: F, b: F) -> I {
        unsafe {
            [
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(a[0], b[0])),
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(a[1], b[1])),
            ]
        }
    }
    #[inline(always)]
    fn le(self, a: F, b: F) -> I {
        unsafe {
            [
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(a[0], b[0])),
                _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LE_OQ>(a[1], b[1])),
            ]
        }
    }
    #[inline(always)]
    fn select(self, m: I, a: F, b: F) -> F {
        unsafe {
            [
                _mm256_blendv_ps(b[0], a[0], _mm256_castsi256_ps(m[0])),
                _mm256_blendv_ps(b[1], a[1], _mm256_castsi256_ps(m[1])),
            ]
        }
    }
    #[inline(always)]
    fn lookup(self, table: F, i: I) -> F {
        unsafe { [lookup_half(table, i[0]), lookup_half(table, i[1])] }
    }
    #[inline(always)]
    fn splat_i(self, v: u32) -> I {
        unsafe { [_mm256_set1_epi32(v as i32); 2] }
    }
    #[inline(always)]
    fn load_i(self, v: &[u32; 16]) -> I {
        unsafe { [_mm256_loadu_si256(v.as_ptr().cast()), _mm256_loadu_si256(v[8..].as_ptr().cast())] }
    }
    #[inline(always)]
    fn store_i(self, v: I) -> [u32; 16] {
        let mut out = [0; 16];
        unsafe {
            _mm256_storeu_si256(out.as_mut_ptr().cast(), v[0]);
            _mm256_storeu_si256(out[8..].as_mut_ptr().cast(), v[1]);
        }
        out
    }
    #[inline(always)]
    fn add_i(self, a: I, b: I) -> I {
        unsafe { [_mm256_add_epi32(a[0], b[0]), _mm256_add_epi32(a[1], b[1])] }
    }
    #[inline(always)]
    fn sub_i(self, a: I, b: I) -> I {
        unsafe { [_mm256_sub_epi32(a[0], b[0]), _mm256_sub_epi32(a[1], b[1])] }
    }
    #[inline(always)]
    fn mul_i(self, a: I, b: I) -> I {
        unsafe { [_mm256_mullo_epi32(a[0], b[0]), _mm256_mullo_epi32(a[1], b[1])] }
    }
    #[inline(always)]
    fn and_i(self, a: I, b: I) -> I {
        unsafe { [_mm256_and_si256(a[0], b[0]), _mm256_and_si256(a[1], b[1])] }
    }
    #[inline(always)]
    fn or_i(self, a: I, b: I) -> I {
        unsafe { [_mm256_or_si256(a[0], b[0]), _mm256_or_si256(a[1], b[1])] }
    }
    #[inline(always)]
    fn shl<const N: u32>(self, a: I) -> I {
        unsafe {
            [
                _mm256_sll_epi32(a[0], _mm_cvtsi32_si128(N as i32)),
                _mm256_sll_epi32(a[1], _mm_cvtsi32_si128(N as i32)),
            ]
        }
    }
    #[inline(always)]
    fn shr<const N: u32>(self, a: I) -> I {
        unsafe {
            [
                _mm256_srl_epi32(a[0], _mm_cvtsi32_si128(N as i32)),
                _mm256_srl_epi32(a[1], _mm_cvtsi32_si128(N as i32)),
            ]
        }
    }
    #[inline(always)]
    fn shr_by(self, a: I, n: I) -> I {
        unsafe { [_mm256_srlv_epi32(a[0], n[0]), _mm256_srlv_epi32(a[1], n[1])] }
    }
    #[inline(always)]
    fn min_u(self, a: I, b: I) -> I {
        unsafe { [_mm256_min_epu32(a[0], b[0]), _mm256_min_epu32(a[1], b[1])] }
    }
    #[inline(always)]
    fn eq_i(self, a: I, b: I) -> I {
        unsafe { [_mm256_cmpeq_epi32(a[0], b[0]), _mm256_cmpeq_epi32(a[1], b[1])] }
    }
    #[inline(always)]
    fn to_i(self, a: F) -> I {
        unsafe { [_mm256_cvttps_epi32(a[0]), _mm256_cvttps_epi32(a[1])] }
    }
    #[inline(always)]
    fn to_f(self, a: I) -> F {
        unsafe { [_mm256_cvtepi32_ps(a[0]), _mm256_cvtepi32_ps(a[1])] }
    }
    #[inline(always)]
    fn bits(self, a: F) -> I {
        unsafe { [_mm256_castps_si256(a[0]), _mm256_castps_si256(a[1])] }
    }
    #[inline(always)]
    fn floats(self, a: I) -> F {
        unsafe { [_mm256_castsi256_ps(a[0]), _mm256_castsi256_ps(a[1])] }
    }
    #[inline(always)]
    unsafe fn gather(self, words: &[u32], i: I) -> I {
        unsafe {
            [
                _mm256_i32gather_epi32::<4>(words.as_ptr().cast(), i[0]),
                _mm256_i32gather_epi32::<4>(words.as_ptr().cast(), i[1]),
            ]
        }
    }
    #[inline(always)]
    fn load_w(self, v: &[u64; 16]) -> W {
        from_fn(|q| {
            let part: [u64; 4] = from_fn(|i| v[q / 2 * 8 + 2 * i + q % 2]);
            unsafe { _mm256_loadu_si256(part.as_ptr().cast()) }
        })
    }
    #[inline(always)]
    fn select_w(self, m: I, a: W, b: W) -> W {
        unsafe {
            [
                select_even(m[0], a[0], b[0]),
                select_odd(m[0], a[1], b[1]),
                select_even(m[1], a[2], b[2]),
                select_odd(m[1], a[3], b[3]),
            ]
        }
    }
    #[inline(always)]
    fn draw(self, s: W) -> (W, I) {
        unsafe {
            let next = [lcg(s[0]), lcg(s[1]), lcg(s[2]), lcg(s[3])];
            (next, [output(s[0], s[1]), output(s[2], s[3])])
        }
    }
    #[inline(always)]
    fn mask(self, bits: u16) -> I {
        unsafe { [mask_half(bits), mask_half(bits >> 8)] }
    }
    #[inline(always)]
    fn mask_bits(self, m: I) -> u16 {
        unsafe {
            let low = _mm256_movemask_ps(_mm256_castsi256_ps(m[0])) as u16;
            let high = _mm256_movemask_ps(_mm256_castsi256_ps(m[1])) as u16;
            low | high << 8
        }
    }
    #[inline(always)]
    fn and(self, a: I, b: I) -> I {
        self.and_i(a, b)
    }
    #[inline(always)]
    fn and_not(self, a: I, b: I) -> I {
        unsafe { [_mm256_andnot_si256(b[0], a[0]), _mm256_andnot_si256(b[1], a[1])] }
    }
}

/// Half of [`Lanes::lookup`]: bit 3 of the index, moved to the sign, chooses the table's half.
#[target_feature(enable = "avx2")]
#[inline]
fn lookup_half(table: F, i: __m256i) -> __m256 {
    let low = _mm256_permutevar8x32_ps(table[0], i);
    let high = _mm256_permutevar8x32_ps(table[1], i);
    _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(i)))
}

/// Chooses by the mask of the even lanes.
#[target_feature(enable = "avx2")]
#[inline]
fn select_even(m: __m256i, a: __m256i, b: __m256i) -> __m256i {
    _mm256_blendv_epi8(b, a, _mm256_shuffle_epi32::<0b10_10_00_00>(m))
}

/// Chooses by the mask of the odd lanes.
#[target_feature(enable = "avx2")]
#[inline]
fn select_odd(m: __m256i, a: __m256i, b: __m256i) -> __m256i {
    _mm256_blendv_epi8(b, a, _mm256_shuffle_epi32::<0b11_11_01_01>(m))
}

/// The next PCG state: a 64-bit product from three 32-bit ones.
#[target_feature(enable = "avx2")]
#[inline]
fn lcg(s: __m256i) -> __m256i {
    let low = _mm256_set1_epi64x((PCG_MULTIPLIER & 0xFFFF_FFFF) as i64);
    let high = _mm256_set1_epi64x((PCG_MULTIPLIER >> 32) as i64);
    let cross =
        _mm256_add_epi64(_mm256_mul_epu32(_mm256_srli_epi64::<32>(s), low), _mm256_mul_epu32(s, high));
    let product = _mm256_add_epi64(_mm256_mul_epu32(s, low), _mm256_slli_epi64::<32>(cross));
    _mm256_add_epi64(product, _mm256_set1_epi64x(PCG_INCREMENT as i64))
}

/// PCG's XSH RR output of the even and the odd lanes' states.
#[target_feature(enable = "avx2")]
#[inline]
fn output(even: __m256i, odd: __m256i) -> __m256i {
    let xe = _mm256_xor_si256(_mm256_srli_epi64::<18>(even), even);
    let xo = _mm256_xor_si256(_mm256_srli_epi64::<18>(odd), odd);
    let word = _mm256_blend_epi32::<0xAA>(_mm256_srli_epi64::<27>(xe), _mm256_slli_epi64::<5>(xo));
    let turn = _mm256_blend_epi32::<0xAA>(_mm256_srli_epi64::<59>(even), _mm256_srli_epi64::<27>(odd));
    let turn = _mm256_and_si256(turn, _mm256_set1_epi32(31));
    // A shift by 32, for a turn of 0, gives 0.
    let left = _mm256_sub_epi32(_mm256_set1_epi32(32), turn);
    _mm256_or_si256(_mm256_srlv_epi32(word, turn), _mm256_sllv_epi32(word, left))
}

/// Eight bits as a mask.
#[target_feature(enable = "avx2")]
#[inline]
fn mask_half(bits: u16) -> __m256i {
    let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(i32::from(bits)), lane), lane)
}
