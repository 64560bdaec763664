//! Half-space radiance as a fast, smooth function of a medium's coefficients.

use crate::ColorError;
use crate::plane_parallel::Solver;

/// Segments of the tables over the similarity parameter.
const SEGMENTS: usize = 256;
/// Chebyshev nodes at which the transfer equation is solved.
const NODES: usize = 28;
/// Chebyshev nodes over g when a table's materials differ in it.
const G_NODES: usize = 5;

/// Normal radiance L of a half-space, tabulated once from the exact solution.
///
/// The argument is van de Hulst's similarity parameter s = √((1 - a) / (1 - g a)) =
/// √(σ_a / (σ_a + (1 - g) σ_s)): L has a square-root edge in the albedo at 1 but is smooth in s,
/// and depends on g only weakly at equal s. Interpolation is C¹ and within 1e-6 of the solver.
pub struct ReflectanceCurve {
    index: f64,
    g_low: f64,
    g_high: f64,
    /// Per g node, (value, slope x segment width) at each of `SEGMENTS + 1` equal steps of s.
    tables: Vec<Vec<[f64; 2]>>,
}

impl ReflectanceCurve {
    /// For a refractive index (1 to 3) and media whose g lies within `g_low..=g_high`.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] when an argument is out of range.
    pub fn new(refractive_index: f64, g_low: f64, g_high: f64) -> Result<Self, ColorError> {
        if !(g_low <= g_high && g_low >= -0.99 && g_high <= 0.99) {
            return Err(ColorError::invalid(
                "g",
                format!("{g_low}..={g_high} must lie within -0.99 to 0.99"),
            ));
        }
        let solver = Solver::new(refractive_index)?;
        let count = if g_low == g_high { 1 } else { G_NODES };
        let tables = (0..count)
            .map(|i| tabulate(&solver, g_node(i, count, g_low, g_high)))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self { index: refractive_index, g_low, g_high, tables })
    }

    /// The refractive index.
    pub fn refractive_index(&self) -> f64 {
        self.index
    }

    /// L and dL/ds at the similarity parameter `s` (clamped to 0..=1) and `g` (clamped to the
    /// curve's range).
    pub fn at_similarity(&self, s: f64, g: f64) -> (f64, f64) {
        let s = if s.is_nan() { 0.0 } else { s.clamp(0.0, 1.0) };
        if let [table] = self.tables.as_slice() {
            return hermite(table, s);
        }
        let g = g.clamp(self.g_low, self.g_high);
        let count = self.tables.len();
        let node = |i| g_node(i, count, self.g_low, self.g_high);
        let (mut value, mut slope) = (0.0, 0.0);
        for (i, table) in self.tables.iter().enumerate() {
            let weight: f64 =
                (0..count).filter(|&j| j != i).map(|j| (g - node(j)) / (node(i) - node(j))).product();
            let (v, d) = hermite(table, s);
            value += weight * v;
            slope += weight * d;
        }
        (value, slope)
    }

    /// L of a half-space of single-scattering albedo 0 to 1.
    ///
    /// ```
    /// use pellucid_color::curve::ReflectanceCurve;
    /// let curve = ReflectanceCurve::new(1.5, 0.4, 0.4)?;
    /// assert!((curve.radiance(0.999, 0.4) - 0.793_947_5).abs() < 1e-6);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    pub fn radiance(&self, albedo: f64, g: f64) -> f64 {
        self.at_similarity(similarity(albedo, g), g).0
    }

    /// The albedo whose half-space has the given radiance, 0 to 1: the inverse of
    /// [`Self::radiance`], by bisection.
    pub fn albedo_of(&self, radiance: f64, g: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let s = 0.5 * (low + high);
            if self.at_similarity(s, g).0 > radiance {
                low = s;
            } else {
                high = s;
            }
        }
        let s2 = (0.5 * (low + high)) * (0.5 * (low + high));
        (1.0 - s2) / (1.0 - g * s2)
    }
}

/// The similarity parameter √((1 - a) / (1 - g a)) of an albedo and g.
pub fn similarity(albedo: f64, g: f64) -> f64 {
    ((1.0 - albedo) / (1.0 - g * albedo)).max(0.0).sqrt()
}

fn g_node(i: usize, count: usize, low: f64, high: f64) -> f64 {
    if count == 1 {
        return low;
    }
    let x = -(std::f64::consts::PI * i as f64 / (count - 1) as f64).cos();
    low + 0.5 * (x + 1.0) * (high - low)
}

/// Solves at Chebyshev nodes in s and resamples value and slope to equal steps.
fn tabulate(solver: &Solver, g: f64) -> Result<Vec<[f64; 2]>, ColorError> {
    let angle = |k: usize| std::f64::consts::PI * (k as f64 + 0.5) / NODES as f64;
    let values = (0..NODES)
        .map(|k| {
            let s = 0.5 * (angle(k).cos() + 1.0);
            solver.half_space((1.0 - s * s) / (1.0 - g * s * s), g)
        })
        .collect::<Result<Vec<f64>, _>>()?;
    let coefficient: Vec<f64> = (0..NODES)
        .map(|n| {
            let sum: f64 = (0..NODES).map(|k| values[k] * (n as f64 * angle(k)).cos()).sum();
            sum * if n == 0 { 1.0 } else { 2.0 } / NODES as f64
        })
        .collect();
    Ok((0..=SEGMENTS)
        .map(|i| {
            let x = 2.0 * i as f64 / SEGMENTS as f64 - 1.0;
            // T_n and its derivative by recurrence.
            let (mut t0, mut t1, mut d0, mut d1) = (1.0, x, 0.0, 1.0);
            let (mut value, mut slope) = (coefficient[0] + coefficient[1] * x, coefficient[1]);
            for c in &coefficient[2..] {
                (t0, t1, d0, d1) = (t1, 2.0 * x * t1 - t0, d1, 2.0 * t1 + 2.0 * x * d1 - d0);
                value += c * t1;
                slope += c * d1;
            }
            [value, slope * 2.0 / SEGMENTS as f64]
        })
        .collect())
}

/// Cubic Hermite interpolation: value and derivative by s.
fn hermite(table: &[[f64; 2]], s: f64) -> (f64, f64) {
    let scaled = s * SEGMENTS as f64;
    let i = (scaled as usize).min(SEGMENTS - 1);
    let t = scaled - i as f64;
    let ([v0, m0], [v1, m1]) = (table[i], table[i + 1]);
    let rise = v1 - v0;
    let (c2, c3) = (3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise);
    let value = v0 + t * (m0 + t * (c2 + t * c3));
    let slope = m0 + t * (2.0 * c2 + 3.0 * t * c3);
    (value, slope * SEGMENTS as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolates_the_solver() {
        for (index, low, high) in [(1.0, 0.4, 0.4), (1.5, 0.4, 0.4), (1.5, 0.0, 0.6)] {
            let solver = Solver::new(index).unwrap();
            let curve = ReflectanceCurve::new(index, low, high).unwrap();
            for albedo in [0.0, 0.03, 0.1, 0.351, 0.5, 0.77, 0.9, 0.98, 0.9957, 0.999, 0.9999, 0.99999, 1.0] {
                for g in [low, 0.6 * low + 0.4 * high, high] {
                    let exact = solver.half_space(albedo, g).unwrap();
                    let ours = curve.radiance(albedo, g);
                    let tolerance = if low == high { 1e-6 } else { 1e-4 };
                    assert!(
                        (ours - exact).abs() < tolerance,
                        "n {index} g {g} albedo {albedo}: {ours} {exact}"
                    );
                }
            }
        }
    }

    #[test]
    fn slope_is_the_derivative_and_never_positive() {
        let curve = ReflectanceCurve::new(1.5, 0.4, 0.4).unwrap();
        for i in 1..1000 {
            let s = i as f64 / 1000.0;
            let (_, slope) = curve.at_similarity(s, 0.4);
            let difference =
                (curve.at_similarity(s + 1e-6, 0.4).0 - curve.at_similarity(s - 1e-6, 0.4).0) / 2e-6;
            assert!((slope - difference).abs() < 1e-4 * (1.0 + slope.abs()), "s {s}: {slope} {difference}");
            assert!(slope <= 1e-6, "s {s}: {slope}");
        }
    }

    #[test]
    fn inverse_returns_the_albedo() {
        let curve = ReflectanceCurve::new(1.5, 0.4, 0.4).unwrap();
        for albedo in [0.1, 0.5, 0.9, 0.999, 0.99999] {
            let back = curve.albedo_of(curve.radiance(albedo, 0.4), 0.4);
            assert!((back - albedo).abs() < 1e-9, "{albedo} {back}");
        }
    }

    #[test]
    fn published_fit_of_the_materials_source_is_near() {
        // Elek et al. 2017, Eq. 4, a hemispherical albedo fitted to the same physics; the normal
        // radiance runs 0.005 to 0.013 below it between albedo 0.5 and 0.98.
        let fit = |a: f64| {
            0.065773 * a.powf(1.569383)
                + 0.201198 * a.powf(6.802855)
                + 0.279264 * a.powf(28.61815)
                + 0.251997 * a.powf(142.0079)
                + 0.201767 * a.powf(1393.165)
        };
        let curve = ReflectanceCurve::new(1.5, 0.4, 0.4).unwrap();
        for albedo in [0.1, 0.3, 0.5, 0.7, 0.9, 0.97] {
            let gap = fit(albedo) - curve.radiance(albedo, 0.4);
            assert!((-0.001..0.016).contains(&gap), "albedo {albedo}: {gap}");
        }
    }
}
