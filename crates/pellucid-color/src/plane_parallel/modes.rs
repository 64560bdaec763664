//! The field of one homogeneous layer, in closed form, for any thickness.
//!
//! With u± the radiances along ±µ at the nodes, s = u⁺ + u⁻ and d = u⁺ - u⁻ obey
//! µ s' = -A d and µ d' = -B s, where A = 1 - ω O w, B = 1 - ω E w and E, O collect the even and
//! odd Legendre terms of the phase function. Scaled by √(wµ) both matrices are symmetric, and
//! the layer's modes are the eigenvectors of Lᵀ B L = Q K² Qᵀ with A = L Lᵀ, taken as singular
//! vectors of Mᵀ L with B = M Mᵀ. Fields even about
//! the mid-plane obey d = -G s at the surface with G = L⁻ᵀ Q K tanh(K h) Qᵀ L⁻¹ (half thickness
//! h), odd ones the same with coth, and a half-space with K alone. So R ± T are the Cayley
//! transforms (1 - G)(1 + G)⁻¹: no start-up layer, no doubling, no growing exponentials, and no
//! loss at albedo 1. After Stamnes and Swanson (1981) and Chandrasekhar (1960), ch. III.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::jacobi::singular_values;
use super::quadrature::{Directions, legendre};
use crate::ColorError;

/// Beyond this the diffusion mode is lost in rounding; the radiance is then within 2e-6 of albedo 1's.
const MOST_ALBEDO: f64 = 1.0 - 1e-13;

/// Modes of a homogeneous medium in units of its scaled optical depth.
pub(crate) struct Modes {
    /// L⁻ᵀ Q.
    basis: DMatrix<f64>,
    /// K ≥ 0 per mode.
    rate: DVector<f64>,
    /// Optical depth of the delta-scaled medium per 1/mm of true extinction.
    pub extinction_scale: f64,
}

/// What lies behind a surface.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Symmetry {
    /// A layer lit equally from both sides; half its optical thickness.
    Even(f64),
    /// A layer lit oppositely from its sides.
    Odd(f64),
    /// No far side.
    HalfSpace,
}

impl Modes {
    /// Of a medium with single-scattering `albedo` in 0..=1 and Henyey-Greenstein `g`.
    pub fn new(
        directions: &Directions,
        polynomials: &[Vec<f64>],
        albedo: f64,
        g: f64,
    ) -> Result<Self, ColorError> {
        let count = directions.len();
        let terms = polynomials[0].len();
        // Delta-M (Wiscombe 1977): what the nodes cannot resolve of a sharp forward peak goes straight on.
        let forward = g.abs().powi(terms as i32);
        let forward = if g > 0.0 { forward } else { 0.0 };
        let extinction_scale = 1.0 - albedo * forward;
        let albedo = (albedo * (1.0 - forward) / extinction_scale).min(MOST_ALBEDO);
        let moment: Vec<f64> =
            (0..terms).map(|l| (2 * l + 1) as f64 * (g.powi(l as i32) - forward) / (1.0 - forward)).collect();
        let sum = |i: usize, j: usize, first: usize| -> f64 {
            (first..terms).step_by(2).map(|l| moment[l] * polynomials[i][l] * polynomials[j][l]).sum()
        };
        let w = &directions.weight;
        let mut even = DMatrix::from_fn(count, count, |i, j| sum(i, j, 0));
        for i in 0..count {
            // Rounds the rule's last error into the forward direction, so that energy is kept exactly.
            let scattered: f64 = (0..count).map(|j| even[(i, j)] * w[j]).sum();
            even[(i, i)] += (1.0 - scattered) / w[i];
        }
        let scaled = |i: usize, j: usize, phase: f64| {
            let own = if i == j { 1.0 / directions.mu[i] } else { 0.0 };
            own - albedo * phase * (w[i] / directions.mu[i]).sqrt() * (w[j] / directions.mu[j]).sqrt()
        };
        let a = DMatrix::from_fn(count, count, |i, j| scaled(i, j, sum(i, j, 1)));
        let b = DMatrix::from_fn(count, count, |i, j| scaled(i, j, even[(i, j)]));
        let unstable = || ColorError::invalid("phase function", format!("g = {g} gives no stable field"));
        let lower = Cholesky::new(a).ok_or_else(unstable)?.l();
        let lower_b = Cholesky::new(b).ok_or_else(unstable)?.l();
        let (rate, q) = singular_values(lower_b.transpose() * &lower);
        let basis = lower.tr_solve_lower_triangular(&q).ok_or_else(unstable)?;
        Ok(Self { basis, rate, extinction_scale })
    }

    /// G with d = -G s (scaled by √(wµ)) at a surface of the layer.
    pub fn surface_operator(&self, symmetry: Symmetry) -> DMatrix<f64> {
        let gain = self.rate.map(|k| match symmetry {
            Symmetry::HalfSpace => k,
            Symmetry::Even(half) => k * (k * half).tanh(),
            Symmetry::Odd(half) if k * half < 1e-8 => 1.0 / half,
            Symmetry::Odd(half) => k / (k * half).tanh(),
        });
        let mut right = self.basis.transpose();
        for (mut row, gain) in right.row_iter_mut().zip(gain.iter()) {
            row *= *gain;
        }
        &self.basis * right
    }

    /// R ± T (or R of a half-space), acting on radiances scaled by √(wµ).
    pub fn response(&self, symmetry: Symmetry) -> Result<DMatrix<f64>, ColorError> {
        let mut shifted = self.surface_operator(symmetry);
        let count = shifted.nrows();
        for i in 0..count {
            shifted[(i, i)] += 1.0;
        }
        let inverse = Cholesky::new(shifted)
            .ok_or_else(|| ColorError::invalid("layer", "its coefficients are too far apart to solve"))?
            .inverse();
        Ok(inverse * 2.0 - DMatrix::identity(count, count))
    }
}

/// P_l(µ) for every node, to the degree the rule resolves.
pub(crate) fn polynomial_table(directions: &Directions) -> Vec<Vec<f64>> {
    let degree = directions.len() * 4 / 5 - 1;
    directions.mu.iter().map(|&mu| legendre(mu, degree)).collect()
}
