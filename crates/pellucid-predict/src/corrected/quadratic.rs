//! The part of an error that all points of a brightness share.

/// Coefficients of the error as a quadratic in the predicted value.
pub(super) const TERMS: usize = 3;
/// Numbers of a [`Quadratic`].
pub(super) const SUMS: usize = 3 * TERMS - 1;

/// Sums for a least-squares quadratic.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Quadratic {
    /// Σ v^k, k = 0..=4.
    moments: [f64; 2 * TERMS - 1],
    /// Σ v^k e.
    products: [f64; TERMS],
}

impl Quadratic {
    /// `self * memory + new`.
    pub(super) fn absorb(&mut self, memory: f64, new: &Self) {
        let own = self.moments.iter_mut().chain(&mut self.products);
        own.zip(new.moments.iter().chain(&new.products)).for_each(|(s, n)| *s = *s * memory + n);
    }

    pub(super) fn add(&mut self, value: f32, error: f32) {
        let (value, error) = (f64::from(value), f64::from(error));
        let mut power = 1.0;
        for (k, moment) in self.moments.iter_mut().enumerate() {
            *moment += power;
            if let Some(product) = self.products.get_mut(k) {
                *product += power * error;
            }
            power *= value;
        }
    }

    pub(super) fn sums(&self) -> impl Iterator<Item = f64> {
        self.moments.into_iter().chain(self.products)
    }

    pub(super) fn from_sums(sums: &[f64; SUMS]) -> Self {
        Self {
            moments: std::array::from_fn(|i| sums[i]),
            products: std::array::from_fn(|i| sums[2 * TERMS - 1 + i]),
        }
    }

    /// The coefficients. A thousandth of the weight pulls each towards zero, which decides where all values are
    /// alike.
    pub(super) fn solve(&self) -> [f64; TERMS] {
        let mut rows: [[f64; TERMS + 1]; TERMS] = std::array::from_fn(|i| {
            std::array::from_fn(|j| if j < TERMS { self.moments[i + j] } else { self.products[i] })
        });
        for (i, row) in rows.iter_mut().enumerate() {
            row[i] += 1e-3 * self.moments[0] + f64::MIN_POSITIVE;
        }
        // Positive definite: elimination needs no exchange of rows.
        for i in 0..TERMS {
            for j in i + 1..TERMS {
                let factor = rows[j][i] / rows[i][i];
                for k in i..=TERMS {
                    rows[j][k] -= factor * rows[i][k];
                }
            }
        }
        let mut solution = [0.0; TERMS];
        for i in (0..TERMS).rev() {
            let known: f64 = (i + 1..TERMS).map(|j| rows[i][j] * solution[j]).sum();
            solution[i] = (rows[i][TERMS] - known) / rows[i][i];
        }
        solution
    }
}

/// The quadratic at a value.
pub(super) fn evaluate(coefficients: &[f64; TERMS], value: f32) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * f64::from(value) + c)
}
