//! Sums of path contributions that do not depend on their order.

use std::ops::AddAssign;

/// Contributions of paths and their squares, in units of 2^-32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tally {
    sum: u64,
    squares: u64,
}

const UNIT: f64 = 4_294_967_296.0;

impl Tally {
    /// Adds one path's contribution, within 0..=1.
    #[inline]
    pub(crate) fn add(&mut self, weight: f32) {
        let w = f64::from(weight);
        self.sum += (w * UNIT) as u64;
        self.squares += (w * w * UNIT) as u64;
    }

    /// Variance of one path's contribution, from `n` paths.
    ///
    /// Few paths may all agree by chance: two more at the ends of the range keep the estimate
    /// from calling a point done that is not.
    pub(crate) fn cautious_variance(&self, n: u32) -> f64 {
        let n = f64::from(n) + 2.0;
        let mean = (self.sum as f64 / UNIT + 1.0) / n;
        ((self.squares as f64 / UNIT + 1.0) / n - mean * mean).max(0.0)
    }

    /// Mean over `n` paths.
    pub(crate) fn mean(&self, n: u32) -> f64 {
        self.sum as f64 / UNIT / f64::from(n)
    }

    /// Standard error of the mean over `n` paths; infinite for fewer than two.
    pub(crate) fn std_error(&self, n: u32) -> f64 {
        if n < 2 {
            return f64::INFINITY;
        }
        let mean = self.mean(n);
        let variance = (self.squares as f64 / UNIT / f64::from(n) - mean * mean).max(0.0);
        (variance / f64::from(n - 1)).sqrt()
    }
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.sum += other.sum;
        self.squares += other.squares;
    }
}
