//! One channel of some materials, fitted while the others stay.

use nalgebra::{DMatrix, DVector};

use super::least_squares::{Problem, minimise};
use super::model::{Coefficients, Model, State};
use crate::ColorError;

/// What is known of a coefficient before anything was measured: its usual size in 1/mm (scattering, absorption), and
/// that a factor of e³ either way is no surprise. It decides only what measurements leave open.
const USUAL: Coefficients = [2.0, 0.3];
const USUAL_WIDTH: f64 = 3.0;
/// Bounds of the logarithms: 1e-7 to 1e3 per mm.
const LOW: f64 = -16.2;
const HIGH: f64 = 6.91;
/// Step of the logarithms in derivatives.
const STEP: f64 = 1e-4;
/// How many of the starting points are followed to their minimum.
const FOLLOWED: usize = 3;

/// Measured patches of one channel.
pub(super) struct Measured<'a> {
    /// By patch of the model.
    pub radiance: &'a [f64],
    /// Standard errors.
    pub error: &'a [f64],
}

/// The unknowns are logarithms of (scattering, absorption) of `materials`, in order.
pub(super) struct Stage<'a> {
    pub model: &'a Model<'a>,
    pub state: &'a mut State,
    pub materials: &'a [usize],
    /// Patches by position in the model.
    pub patches: &'a [usize],
    pub measured: Measured<'a>,
}

/// What is known of the unknowns after a fit.
pub(super) struct Spread {
    /// Covariance of the logarithms by this stage's measurements alone.
    pub own: DMatrix<f64>,
    /// Derivative of the unknowns by the logarithms of materials that were held.
    pub by_held: DMatrix<f64>,
}

impl Stage<'_> {
    /// Moves the materials to where measurements are met best, from the best of `starts` (coefficients by material of
    /// the stage).
    pub fn solve(&mut self, starts: &[Vec<Coefficients>]) -> Result<(), ColorError> {
        let mut ranked = Vec::with_capacity(starts.len());
        for start in starts {
            let unknowns: Vec<f64> = start.iter().flatten().map(|v| v.ln()).collect();
            ranked.push((self.residuals(&unknowns)?.norm_squared(), unknowns));
        }
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best = None;
        for (_, start) in ranked.iter().take(FOLLOWED) {
            let found = minimise(self, start, LOW, HIGH)?;
            if best.as_ref().is_none_or(|(least, _)| found.sum_of_squares < *least) {
                best = Some((found.sum_of_squares, found.unknowns));
            }
        }
        if let Some((_, unknowns)) = best {
            self.apply(&unknowns)?;
        }
        Ok(())
    }

    /// Uncertainty where the state is. More scatter than the stated errors counts in proportion.
    pub fn spread(&mut self, held: &[usize]) -> Result<Spread, ColorError> {
        let unknowns = self.unknowns();
        let residuals = self.residuals(&unknowns)?;
        let jacobian = self.derivatives(self.materials)?;
        let rows = self.patches.len();
        let misfit = residuals.rows(0, rows).norm_squared();
        let freedom = rows as f64 - unknowns.len() as f64;
        let scale = if freedom > 0.0 { (misfit / freedom).max(1.0) } else { 1.0 };
        let mut normal = jacobian.tr_mul(&jacobian) / scale;
        for i in 0..unknowns.len() {
            normal[(i, i)] += USUAL_WIDTH.powi(-2);
        }
        let own = normal
            .try_inverse()
            .ok_or_else(|| ColorError::invalid("measurements", "they do not determine the materials"))?;
        let by_held = -(&own / scale) * jacobian.tr_mul(&self.derivatives(held)?);
        Ok(Spread { own, by_held })
    }

    fn unknowns(&self) -> Vec<f64> {
        self.materials.iter().flat_map(|&m| self.state.coefficients[m].map(f64::ln)).collect()
    }

    fn apply(&mut self, unknowns: &[f64]) -> Result<(), ColorError> {
        for (pair, &material) in unknowns.chunks_exact(2).zip(self.materials) {
            self.model.set(self.state, material, [pair[0].exp(), pair[1].exp()])?;
        }
        Ok(())
    }

    fn radiances(&self) -> Result<Vec<f64>, ColorError> {
        self.patches.iter().map(|&patch| self.model.radiance(self.state, patch)).collect()
    }

    /// Of the patches' residuals by the logarithms of materials' coefficients.
    fn derivatives(&mut self, materials: &[usize]) -> Result<DMatrix<f64>, ColorError> {
        let base = self.radiances()?;
        let mut jacobian = DMatrix::zeros(self.patches.len(), 2 * materials.len());
        for (k, &material) in materials.iter().enumerate() {
            for which in 0..2 {
                let mut moved = self.state.coefficients[material];
                moved[which] *= STEP.exp();
                let old = self.model.set(self.state, material, moved)?;
                for (row, &patch) in self.patches.iter().enumerate() {
                    if self.model.contains(patch, material) {
                        let change = self.model.radiance(self.state, patch)? - base[row];
                        jacobian[(row, 2 * k + which)] = change / STEP / self.measured.error[patch];
                    }
                }
                Model::put_back(self.state, material, old);
            }
        }
        Ok(jacobian)
    }
}

impl Problem for Stage<'_> {
    fn residuals(&mut self, unknowns: &[f64]) -> Result<DVector<f64>, ColorError> {
        self.apply(unknowns)?;
        let mut residuals = Vec::with_capacity(self.patches.len() + unknowns.len());
        for &patch in self.patches {
            let off = self.model.radiance(self.state, patch)? - self.measured.radiance[patch];
            residuals.push(off / self.measured.error[patch]);
        }
        let usual = |i: usize| USUAL[i % 2].ln();
        residuals.extend(unknowns.iter().enumerate().map(|(i, v)| (v - usual(i)) / USUAL_WIDTH));
        Ok(DVector::from_vec(residuals))
    }

    fn jacobian(&mut self, unknowns: &[f64]) -> Result<DMatrix<f64>, ColorError> {
        self.apply(unknowns)?;
        let patches = self.derivatives(self.materials)?;
        let rows = patches.nrows();
        let mut jacobian = patches.resize_vertically(rows + unknowns.len(), 0.0);
        for i in 0..unknowns.len() {
            jacobian[(rows + i, i)] = 1.0 / USUAL_WIDTH;
        }
        Ok(jacobian)
    }
}
