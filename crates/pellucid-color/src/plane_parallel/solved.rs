//! Layers that are solved once and stacked as often as wanted.

use nalgebra::{DMatrix, DVector};

use super::modes::Symmetry;
use super::{Layer, Solver, solve};
use crate::ColorError;

/// What a layer does to light that comes upon it, for one [`Solver`]'s directions.
#[derive(Clone, Debug)]
pub struct SolvedLayer(pub(super) Response);

/// Matrices act on radiances scaled by √(wµ).
#[derive(Clone, Debug)]
pub(super) enum Response {
    /// Nothing happens: no thickness, or a clear medium.
    Clear,
    /// What is sent back and what is let through.
    Slab { reflect: DMatrix<f64>, transmit: DMatrix<f64> },
    /// No far side.
    Thick { reflect: DMatrix<f64> },
}

impl Solver {
    /// Layers of the medium of `layer` at several thicknesses (mm, infinity for a bottom without a far side): one
    /// decomposition serves all of them. The layer's own thickness is not looked at.
    ///
    /// ```
    /// use pellucid_color::plane_parallel::{Layer, Solver};
    /// let solver = Solver::new(1.5)?;
    /// let (ink, black) = (Layer::from_albedo(0.7, 4.5, 0.4, 0.1), Layer::from_albedo(0.35, 5.5, 0.4, f64::INFINITY));
    /// let (layers, below) = (solver.solve_layers(&ink, &[0.1, 0.2])?, solver.solve_layers(&black, &[f64::INFINITY])?);
    /// let stacked = solver.radiance_of_solved(&[&layers[0], &below[0]])?;
    /// assert_eq!(stacked, solver.radiance_normal(&[ink, black])?);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Solver::radiance_normal`].
    pub fn solve_layers(&self, layer: &Layer, thickness_mm: &[f64]) -> Result<Vec<SolvedLayer>, ColorError> {
        for &thickness_mm in thickness_mm {
            Layer { thickness_mm, ..*layer }.check(true)?;
        }
        let extinction = layer.sigma_s + layer.sigma_a;
        if extinction == 0.0 {
            return Ok(vec![SolvedLayer(Response::Clear); thickness_mm.len()]);
        }
        let modes = self.modes_of(layer)?;
        let solved = thickness_mm.iter().map(|&mm| {
            if mm == f64::INFINITY {
                return Ok(SolvedLayer(Response::Thick { reflect: modes.response(Symmetry::HalfSpace)? }));
            }
            let half = 0.5 * extinction * mm * modes.extinction_scale;
            if half == 0.0 {
                return Ok(SolvedLayer(Response::Clear));
            }
            let (sum, difference) =
                (modes.response(Symmetry::Even(half))?, modes.response(Symmetry::Odd(half))?);
            let (reflect, transmit) = ((&sum + &difference) * 0.5, (sum - difference) * 0.5);
            Ok(SolvedLayer(Response::Slab { reflect, transmit }))
        });
        solved.collect()
    }

    /// [`Solver::radiance_normal`] of layers solved by this solver, top first, in 0..=1.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] for an empty stack, a thick layer above another one, and layers of a solver with
    /// other directions.
    pub fn radiance_of_solved(&self, layers: &[&SolvedLayer]) -> Result<f64, ColorError> {
        let (Some(base), above) = (layers.last(), &layers[..layers.len().saturating_sub(1)]) else {
            return Err(ColorError::invalid("layers", "a stack needs at least one"));
        };
        let count = self.directions.len();
        let one = self.unit_radiance();
        let fresnel = DVector::from_column_slice(&self.directions.fresnel);
        let entering = one.component_mul(&fresnel.map(|f| 1.0 - f));
        // Below the layers handled so far, upward = `reflect` downward + `glow`.
        let mut reflect = DMatrix::from_diagonal(&fresnel);
        let mut glow = entering.clone();
        if let Response::Thick { reflect: own } = &base.0 {
            (reflect, glow) = (self.of_own_directions(own)?.clone(), DVector::zeros(count));
        } else {
            self.add_layer(base, &mut reflect, &mut glow)?;
        }
        for layer in above.iter().rev() {
            self.add_layer(layer, &mut reflect, &mut glow)?;
        }
        let mut system = DMatrix::identity(count, count);
        for (j, f) in fresnel.iter().enumerate() {
            for i in 0..count {
                system[(i, j)] -= reflect[(i, j)] * f;
            }
        }
        let out = solve(system, &DMatrix::from_columns(&[&reflect * entering + glow]))?;
        Ok((out[count - 1] / one[count - 1]).clamp(0.0, 1.0))
    }

    fn add_layer(
        &self,
        layer: &SolvedLayer,
        reflect: &mut DMatrix<f64>,
        glow: &mut DVector<f64>,
    ) -> Result<(), ColorError> {
        let (r, t) = match &layer.0 {
            Response::Clear => return Ok(()),
            Response::Slab { reflect, transmit } => (self.of_own_directions(reflect)?, transmit),
            Response::Thick { .. } => {
                return Err(ColorError::invalid("layer thickness", "only the last layer may be infinite"));
            }
        };
        let count = r.nrows();
        let system = DMatrix::identity(count, count) - &*reflect * r;
        let mut right = DMatrix::zeros(count, count + 1);
        right.columns_mut(0, count).copy_from(&(&*reflect * t));
        right.set_column(count, glow);
        let solved = solve(system, &right)?;
        *reflect = r + t * solved.columns(0, count);
        *glow = t * solved.column(count);
        Ok(())
    }

    fn of_own_directions<'m>(&self, matrix: &'m DMatrix<f64>) -> Result<&'m DMatrix<f64>, ColorError> {
        if matrix.nrows() == self.directions.len() {
            return Ok(matrix);
        }
        Err(ColorError::invalid("layer", "it was solved for other directions; use one solver for a stack"))
    }
}
