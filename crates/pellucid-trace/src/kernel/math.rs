//! Elementary functions on sixteen lanes, as polynomials near minimax.

use super::lanes::Lanes;

/// Uniform numbers strictly between 0 and 1, multiples of 2^-24, from random bits.
#[inline(always)]
pub(super) fn unit<L: Lanes>(l: L, bits: L::I) -> L::F {
    let scale = l.splat(1.0 / (1u32 << 23) as f32);
    let half = l.splat(0.5 / (1u32 << 23) as f32);
    l.fma(l.to_f(l.shr::<9>(bits)), scale, half)
}

/// -ln(u) for normal positive `u`, to 3e-7 of u's distance from 1 or of the result.
#[inline(always)]
pub(super) fn neg_ln<L: Lanes>(l: L, u: L::F) -> L::F {
    // u = 2^e m with m from sqrt(1/2) to sqrt(2).
    let bias = l.splat_i(0x3F35_04F3);
    let shifted = l.sub_i(l.bits(u), bias);
    let e = l.to_f(l.sub_i(l.shr::<23>(l.add_i(shifted, l.splat_i(0x4000_0000))), l.splat_i(128)));
    let mantissa = l.add_i(l.and_i(shifted, l.splat_i(0x007F_FFFF)), bias);
    let x = l.sub(l.floats(mantissa), l.splat(1.0));
    let mut p = l.splat(-0.103_783_146);
    for c in [
        0.163_379_88_f32,
        -0.172_124_87,
        0.198_842_57,
        -0.249_715_57,
        0.333_356_08,
        -0.500_003_46,
        0.999_999_9,
    ] {
        p = l.fma(p, x, l.splat(c));
    }
    let ln_m = l.mul(p, x);
    l.fnma(e, l.splat(std::f32::consts::LN_2), l.sub(l.splat(0.0), ln_m))
}

/// (sin 2πa, cos 2πa) for a from -1/2 to 1/2, to 1e-6.
#[inline(always)]
pub(super) fn sin_cos_turn<L: Lanes>(l: L, a: L::F) -> (L::F, L::F) {
    let z = l.mul(a, a);
    let mut s = l.splat(0.077_659_406);
    for c in [-0.598_292_2_f32, 2.550_077_7, -5.167_71, std::f32::consts::PI] {
        s = l.fma(s, z, l.splat(c));
    }
    let s = l.mul(s, a);
    let mut c = l.splat(0.219_696_78);
    for k in [-1.331_880_2_f32, 4.058_412, -4.934_793, 0.999_999_95] {
        c = l.fma(c, z, l.splat(k));
    }
    let twice = l.add(s, s);
    (l.mul(twice, c), l.fnma(twice, s, l.splat(1.0)))
}
