//! The logarithmic transform of features. Written so that it vectorises in whichever form it is inlined into; every
//! form gives the same bits.

/// Lanes of the widest vector.
const LANES: usize = 16;

/// The logarithmic transform of pairs (s, a).
#[inline(always)]
pub(super) fn log_features(level: &mut [f32], scale: f32) {
    let inner: [f32; LANES] = std::array::from_fn(|i| [0.2, 30.0][i % 2] * scale);
    let outer: [f32; LANES] = std::array::from_fn(|i| [1.0 / 3.0, 0.25][i % 2]);
    let (whole, rest) = level.as_chunks_mut::<LANES>();
    for values in whole {
        for i in 0..LANES {
            values[i] = ln_1p(inner[i] * values[i]) * outer[i];
        }
    }
    for (i, v) in rest.iter_mut().enumerate() {
        *v = ln_1p(inner[i] * *v) * outer[i];
    }
}

/// ln(1 + x) for finite x >= 0 to about two units in the last place, without branches.
#[inline(always)]
fn ln_1p(x: f32) -> f32 {
    let u = 1.0 + x;
    // u = m 2^e with m in [2/3, 4/3).
    let two_thirds = (2.0f32 / 3.0).to_bits();
    let e = u.to_bits().wrapping_sub(two_thirds) as i32 >> 23;
    let f = f32::from_bits(u.to_bits().wrapping_sub((e as u32) << 23)) - 1.0;
    // ln m by the series of the inverse hyperbolic tangent.
    let s = f / (2.0 + f);
    let z = s * s;
    let tail = z * (1.0 / 3.0 + z * (1.0 / 5.0 + z * (1.0 / 7.0 + z * (1.0 / 9.0))));
    let rounding = (x - (u - 1.0)) / u;
    e as f32 * std::f32::consts::LN_2 + (2.0 * (s + s * tail) + rounding)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_are_exact_to_the_last_places() {
        for i in 0..200_000 {
            let x = 1e-9 * 1.00017f32.powi(i);
            let (got, truth) = (f64::from(ln_1p(x)), f64::from(x).ln_1p());
            assert!((got - truth).abs() <= 3e-7 * truth, "{x}: {got} {truth}");
        }
        assert_eq!(ln_1p(0.0), 0.0);
    }
}
