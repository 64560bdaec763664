//! Directions inside the medium: nodes and weights over the cosine to the normal.

use std::f64::consts::PI;

/// Nodes `mu` in (0, 1] with weights of ∫₀¹ dµ; the last node is exactly the normal, µ = 1.
///
/// Without an index step one Gauss-Radau rule covers (0, 1]. With one, the critical angle
/// splits the range: a Gauss rule below it, where reflection is total, and above it a
/// Gauss-Radau rule in the cosine *outside*, in which Fresnel's reflectance is smooth (it has a
/// square-root kink in µ).
#[derive(Clone, Debug)]
pub(crate) struct Directions {
    pub mu: Vec<f64>,
    pub weight: Vec<f64>,
    /// Internal Fresnel reflectance at each node.
    pub fresnel: Vec<f64>,
}

impl Directions {
    pub fn new(index: f64, count: usize) -> Self {
        let mut out = Self { mu: Vec::new(), weight: Vec::new(), fresnel: Vec::new() };
        if index == 1.0 {
            for (t, w) in unit_interval(gauss_radau_end(count)) {
                // Crowding the nodes to grazing directions, where the field bends most.
                out.push(t * t, 2.0 * t * w, 0.0);
            }
            return out;
        }
        let critical = (1.0 - 1.0 / (index * index)).sqrt();
        let below = count * 2 / 5;
        for (t, w) in unit_interval(gauss_legendre(below)) {
            out.push(critical * t * t, critical * 2.0 * t * w, 1.0);
        }
        for (outside, w) in unit_interval(gauss_radau_end(count - below)) {
            let mu = (1.0 - (1.0 - outside * outside) / (index * index)).sqrt();
            out.push(mu, w * outside / (index * index * mu), fresnel_internal(mu, index));
        }
        out
    }

    fn push(&mut self, mu: f64, weight: f64, fresnel: f64) {
        self.mu.push(mu);
        self.weight.push(weight);
        self.fresnel.push(fresnel);
    }

    pub fn len(&self) -> usize {
        self.mu.len()
    }
}

/// Unpolarised Fresnel reflectance met from inside a dielectric of the given refractive index,
/// at the cosine `mu` (0 to 1) to the normal; 1 beyond the critical angle.
///
/// ```
/// use pellucid_color::plane_parallel::fresnel_internal;
/// assert!((fresnel_internal(1.0, 1.5) - 0.04).abs() < 1e-12);
/// assert_eq!(fresnel_internal(0.5, 1.5), 1.0);
/// assert_eq!(fresnel_internal(0.5, 1.0), 0.0);
/// ```
pub fn fresnel_internal(mu: f64, index: f64) -> f64 {
    if index == 1.0 {
        return 0.0;
    }
    let sin2_outside = index * index * (1.0 - mu * mu);
    if sin2_outside >= 1.0 {
        return 1.0;
    }
    let outside = (1.0 - sin2_outside).sqrt();
    let s = (index * mu - outside) / (index * mu + outside);
    let p = (mu - index * outside) / (mu + index * outside);
    0.5 * (s * s + p * p)
}

/// Legendre polynomials P₀..=P_degree at `x`.
pub(crate) fn legendre(x: f64, degree: usize) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for l in 1..degree {
        let lf = l as f64;
        p.push(((2.0 * lf + 1.0) * x * p[l] - lf * p[l - 1]) / (lf + 1.0));
    }
    p.truncate(degree + 1);
    p
}

/// Gauss-Legendre nodes and weights on [-1, 1], ascending.
fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    (0..count)
        .map(|i| {
            let mut x = -(PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let p = legendre(x, count);
                slope = n * (x * p[count] - p[count - 1]) / (x * x - 1.0);
                let step = p[count] / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// Gauss-Radau nodes and weights on [-1, 1] with the fixed node +1 last, ascending.
///
/// The free nodes are the roots of (P_{n-1} - P_n) / (1 - x); each is bracketed by the sign
/// changes of P_{n-1} - P_n on a fine cosine grid and found by bisection, then polished.
fn gauss_radau_end(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    let f = |x: f64| {
        let p = legendre(x, count);
        (p[count - 1] - p[count]) / (1.0 - x)
    };
    let grid = 40 * count;
    let at = |i: usize| -(PI * i as f64 / grid as f64).cos();
    let mut rule = Vec::with_capacity(count);
    for i in 0..grid - 1 {
        let (mut lo, mut hi) = (at(i), at(i + 1));
        let (mut f_lo, f_hi) = (f(lo), f(hi));
        if f_lo.signum() == f_hi.signum() {
            continue;
        }
        while hi - lo > 4.0 * f64::EPSILON {
            let mid = 0.5 * (lo + hi);
            let f_mid = f(mid);
            if mid <= lo || mid >= hi {
                break;
            }
            if f_mid.signum() == f_lo.signum() {
                (lo, f_lo) = (mid, f_mid);
            } else {
                hi = mid;
            }
        }
        let x = 0.5 * (lo + hi);
        let p = legendre(x, count)[count - 1];
        rule.push((x, (1.0 + x) / (n * n * p * p)));
    }
    rule.push((1.0, 2.0 / (n * n)));
    rule
}

/// Maps a rule from [-1, 1] to [0, 1].
fn unit_interval(rule: Vec<(f64, f64)>) -> impl Iterator<Item = (f64, f64)> {
    rule.into_iter().map(|(x, w)| (0.5 * (x + 1.0), 0.5 * w))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_integrate_polynomials_exactly() {
        for count in [3, 8, 16, 31] {
            for (rule, exact_to) in
                [(gauss_legendre(count), 2 * count - 1), (gauss_radau_end(count), 2 * count - 2)]
            {
                assert_eq!(rule.len(), count);
                for degree in 0..=exact_to {
                    let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(degree as i32)).sum();
                    let exact = if degree % 2 == 0 { 2.0 / (degree as f64 + 1.0) } else { 0.0 };
                    assert!((sum - exact).abs() < 1e-13, "{count} nodes, degree {degree}: {sum} {exact}");
                }
            }
        }
    }

    #[test]
    fn directions_integrate_fresnel_transmission() {
        // 2 ∫ (1 - F) µ dµ, met from inside, is the outside one divided by n² (reciprocity);
        // 0.0918 is the diffuse external reflectance of n = 1.5 (Walsh's formula).
        let d = Directions::new(1.5, 40);
        assert_eq!(*d.mu.last().unwrap(), 1.0);
        let inside: f64 = (0..d.len()).map(|i| 2.0 * d.weight[i] * d.mu[i] * (1.0 - d.fresnel[i])).sum();
        let n = 1.5_f64;
        let (n2, n4) = (n * n, n.powi(4));
        let walsh = 0.5
            + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0) * (n + 1.0))
            + n2 * (n2 - 1.0) * (n2 - 1.0) / (n2 + 1.0).powi(3) * ((n - 1.0) / (n + 1.0)).ln()
            - 2.0 * n.powi(3) * (n2 + 2.0 * n - 1.0) / ((n2 + 1.0) * (n4 - 1.0))
            + 8.0 * n4 * (n4 + 1.0) / ((n2 + 1.0) * (n4 - 1.0).powi(2)) * n.ln();
        assert!((inside * n2 - (1.0 - walsh)).abs() < 1e-12, "{} {}", inside * n2, 1.0 - walsh);
        let total: f64 = d.weight.iter().sum();
        assert!((total - 1.0).abs() < 1e-12, "{total}");
    }
}
