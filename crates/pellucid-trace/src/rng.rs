//! Random numbers addressed by (seed, point, channel, sample).

use rand_pcg::Pcg32;

/// The PCG stream that every path uses; paths differ in their state.
pub(crate) const STREAM: u64 = 0x5EED_0F9E_11BC_1D00;
/// Weyl increment of SplitMix64.
pub(crate) const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
/// Multiplier of the 64-bit LCG under PCG32.
pub(crate) const PCG_MULTIPLIER: u64 = 6_364_136_223_846_793_005;
/// Increment of the LCG for [`STREAM`].
pub(crate) const PCG_INCREMENT: u64 = (STREAM << 1) | 1;

/// SplitMix64's finaliser (Steele, Lea and Flood 2014): a bijection that scatters every bit.
#[inline]
pub(crate) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Key of one point and channel of one pass; `iteration` tells repeated passes apart.
#[inline]
pub(crate) fn point_key(seed: u64, iteration: u32, channel: u32, point: u32) -> u64 {
    let pass = mix(seed.wrapping_add(GOLDEN));
    let pass = mix(pass ^ (u64::from(iteration) << 32 | u64::from(channel)));
    mix(pass.wrapping_add(u64::from(point).wrapping_mul(GOLDEN)))
}

/// Start of a path's stream: the argument `Pcg32::new` takes as its state.
#[inline]
pub(crate) fn path_state(point_key: u64, sample: u32) -> u64 {
    mix(point_key.wrapping_add(u64::from(sample).wrapping_mul(GOLDEN)))
}

/// A seed whose paths are independent of those of `seed`: those that derivatives follow.
pub(crate) fn adjoint_seed(seed: u64) -> u64 {
    mix(seed ^ 0xAD10_1275_EED5_0F9E)
}

/// A number in 0..1 of a point and channel that no path draws.
pub(crate) fn point_unit(point_key: u64) -> f64 {
    (mix(point_key ^ GOLDEN) >> 11) as f64 / (1u64 << 53) as f64
}

/// The generator of one path.
pub(crate) fn path_rng(point_key: u64, sample: u32) -> Pcg32 {
    Pcg32::new(path_state(point_key, sample), STREAM)
}
