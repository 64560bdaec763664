//! The Henyey-Greenstein phase function.

/// Below this |g| the closed form loses digits and the expansion about g = 0 is used.
pub const NEAR_ISOTROPIC: f64 = 2e-3;

/// Density per unit cosine of a scattering angle, for mean cosine `g`; integrates to 1 over -1..=1.
pub fn cosine_density(cosine: f64, g: f64) -> f64 {
    let d = 1.0 + g * g - 2.0 * g * cosine;
    0.5 * (1.0 - g * g) / (d * d.sqrt())
}

/// Cosine of a scattering angle by inverting the distribution at `u` in 0..=1.
///
/// ```
/// use pellucid_trace::phase::sample_cosine;
/// assert!((sample_cosine(0.0, 0.4) + 1.0).abs() < 1e-12);
/// assert!((sample_cosine(1.0, 0.4) - 1.0).abs() < 1e-12);
/// ```
pub fn sample_cosine(u: f64, g: f64) -> f64 {
    if g.abs() < NEAR_ISOTROPIC {
        let z = 2.0 * u - 1.0;
        return z + 1.5 * g * (1.0 - z * z);
    }
    let s = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
    ((1.0 + g * g - s * s) / (2.0 * g)).clamp(-1.0, 1.0)
}

/// A unit vector at angle acos(`cosine`) to the unit vector `d`, turned by `turn` of a full circle.
pub fn deflect(d: [f64; 3], cosine: f64, turn: f64) -> [f64; 3] {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
    let (p, q) = (sine * cos, sine * sin);
    // The frame of Duff et al. 2017, with q's sign absorbed by the uniform turn.
    let sign = if d[2] < 0.0 { -1.0 } else { 1.0 };
    let k = -(d[0] * p + d[1] * q) / (1.0 + d[2].abs());
    let s = cosine + k;
    let e = [s * d[0] + p, s * d[1] + q, s * d[2] + k * sign];
    let scale = 1.0 / (e[0] * e[0] + e[1] * e[1] + e[2] * e[2]).sqrt();
    e.map(|v| v * scale)
}
