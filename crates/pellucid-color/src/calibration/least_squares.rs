//! Least squares in a few unknowns, by Levenberg and Marquardt's steps.

use nalgebra::{DMatrix, DVector};

use crate::ColorError;

/// Largest change of an unknown in one step.
const MOST_STEP: f64 = 1.5;
const MAX_STEPS: usize = 80;

/// A problem: residuals, each in units of its standard error, and their derivatives.
pub(super) trait Problem {
    /// Residuals at `unknowns`.
    fn residuals(&mut self, unknowns: &[f64]) -> Result<DVector<f64>, ColorError>;
    /// `[residual][unknown]`, at the place that residuals were last asked for.
    fn jacobian(&mut self, unknowns: &[f64]) -> Result<DMatrix<f64>, ColorError>;
}

/// Where the sum of squares is least.
pub(super) struct Solution {
    pub unknowns: Vec<f64>,
    pub sum_of_squares: f64,
}

/// Walks from `start` to a minimum within `low..=high`.
pub(super) fn minimise(
    problem: &mut dyn Problem,
    start: &[f64],
    low: f64,
    high: f64,
) -> Result<Solution, ColorError> {
    let mut at: Vec<f64> = start.iter().map(|v| v.clamp(low, high)).collect();
    let mut residuals = problem.residuals(&at)?;
    let mut best = residuals.norm_squared();
    let mut damping = 1e-2;
    for _ in 0..MAX_STEPS {
        let jacobian = problem.jacobian(&at)?;
        let normal = jacobian.tr_mul(&jacobian);
        let gradient = jacobian.tr_mul(&residuals);
        let mut moved = false;
        while damping < 1e8 {
            let mut damped = normal.clone();
            for i in 0..at.len() {
                damped[(i, i)] += damping * normal[(i, i)] + 1e-12;
            }
            let Some(factors) = damped.cholesky() else {
                damping *= 10.0;
                continue;
            };
            let step = factors.solve(&gradient);
            let next: Vec<f64> = at
                .iter()
                .zip(step.iter())
                .map(|(v, d)| (v - d.clamp(-MOST_STEP, MOST_STEP)).clamp(low, high))
                .collect();
            let tried = problem.residuals(&next)?;
            let value = tried.norm_squared();
            if value < best {
                let gain = best - value;
                (at, residuals, best) = (next, tried, value);
                damping = (0.2 * damping).max(1e-10);
                moved = gain > 1e-9 * (1.0 + best);
                break;
            }
            damping *= 5.0;
        }
        if !moved {
            break;
        }
    }
    Ok(Solution { unknowns: at, sum_of_squares: best })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley as two residuals.
    struct Valley;

    impl Problem for Valley {
        fn residuals(&mut self, x: &[f64]) -> Result<DVector<f64>, ColorError> {
            Ok(DVector::from_vec(vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]))
        }
        fn jacobian(&mut self, x: &[f64]) -> Result<DMatrix<f64>, ColorError> {
            Ok(DMatrix::from_row_slice(2, 2, &[-20.0 * x[0], 10.0, -1.0, 0.0]))
        }
    }

    #[test]
    fn finds_the_end_of_a_bent_valley_and_keeps_to_bounds() {
        let found = minimise(&mut Valley, &[-1.2, 1.0], -5.0, 5.0).unwrap();
        assert!(found.sum_of_squares < 1e-10, "{:?}", found.unknowns);
        let bounded = minimise(&mut Valley, &[-1.2, 1.0], -5.0, 0.5).unwrap();
        assert!(bounded.unknowns.iter().all(|v| *v <= 0.5));
        assert!(bounded.sum_of_squares >= 0.25 - 1e-9);
    }
}
