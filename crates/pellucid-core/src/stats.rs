//! Statistics of errors.

/// Distribution of errors that are not negative, such as CIEDE2000 differences.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ErrorStats {
    /// Number of values.
    #[cfg_attr(feature = "serde", serde(default))]
    pub count: u64,
    /// Arithmetic mean.
    pub mean: f64,
    /// 50 % quantile.
    pub median: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// Largest.
    pub max: f64,
}

impl ErrorStats {
    /// Of a list; all zero when it is empty. Quantiles interpolate linearly between the sorted values; values that
    /// are not finite sort last. The result does not depend on the order of the list.
    ///
    /// ```
    /// use pellucid_core::ErrorStats;
    /// let stats = ErrorStats::of(vec![4.0, 1.0, 2.0, 3.0]);
    /// assert_eq!((stats.mean, stats.median, stats.max, stats.count), (2.5, 2.5, 4.0, 4));
    /// ```
    pub fn of(mut values: Vec<f32>) -> Self {
        let Some(last) = values.len().checked_sub(1) else {
            return Self::default();
        };
        values.sort_unstable_by(f32::total_cmp);
        Self {
            count: values.len() as u64,
            mean: values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64,
            median: quantile(&values, 0.5),
            p95: quantile(&values, 0.95),
            max: f64::from(values[last]),
        }
    }
}

/// The quantile `q` (0 to 1) of values in ascending order, linear between them; 0 of an empty list.
pub fn quantile(sorted: &[f32], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else {
        return 0.0;
    };
    let at = q.clamp(0.0, 1.0) * last as f64;
    let low = at.floor() as usize;
    let (a, b) = (f64::from(sorted[low]), f64::from(sorted[(low + 1).min(last)]));
    a + (b - a) * (at - low as f64)
}

/// Root mean square error and bias of predictions against references that have noise of their own, whose variance is
/// estimated from two independent halves of each reference and taken out.
///
/// ```
/// use pellucid_core::NoisyScore;
/// let mut score = NoisyScore::default();
/// score.add(0.6, [0.5, 0.5]);
/// score.add(0.4, [0.5, 0.5]);
/// assert!((score.rmse() - 0.1).abs() < 1e-12 && score.bias().abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoisyScore {
    count: u64,
    sum: f64,
    squares: f64,
    noise: f64,
}

impl NoisyScore {
    /// Adds one prediction and the two halves of its reference.
    pub fn add(&mut self, predicted: f64, halves: [f64; 2]) {
        let [a, b] = halves;
        let off = predicted - 0.5 * (a + b);
        self.add_difference(off, (0.5 * (a - b)).powi(2));
    }

    /// Adds prediction less reference, and the variance of the reference.
    pub fn add_difference(&mut self, difference: f64, variance: f64) {
        self.count += 1;
        self.sum += difference;
        self.squares += difference * difference;
        self.noise += variance;
    }

    /// Adds what another one saw.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares;
        self.noise += other.noise;
    }

    /// Predictions seen.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Root mean square error without the references' noise; 0 where noise explains all of it.
    pub fn rmse(&self) -> f64 {
        ((self.squares - self.noise).max(0.0) / self.count.max(1) as f64).sqrt()
    }

    /// Root mean square difference, noise and all.
    pub fn raw_rmse(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }

    /// Mean of prediction less reference.
    pub fn bias(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Domain, uniform};

    #[test]
    fn known_quantiles_in_any_order() {
        let mut values: Vec<f32> = (0..=100).map(|i| i as f32).collect();
        let stats = ErrorStats::of(values.clone());
        assert_eq!(stats, ErrorStats { count: 101, mean: 50.0, median: 50.0, p95: 95.0, max: 100.0 });
        values.reverse();
        assert_eq!(ErrorStats::of(values), stats);
        assert_eq!(ErrorStats::of(vec![]), ErrorStats::default());
    }

    #[test]
    fn noise_of_known_size_is_taken_out() {
        let n = 40_000;
        let mut score = NoisyScore::default();
        let noise = |i: u64, k: u64| 0.2 * (uniform(3, Domain::new("noise"), i, k) - 0.5);
        for i in 0..n {
            score.add(0.53, [0.5 + noise(i, 0), 0.5 + noise(i, 1)]);
        }
        // Noise of the mean: 0.2 / sqrt(24) = 0.041, over the root of n: 0.0002; four of them.
        assert!((score.bias() - 0.03).abs() < 0.0008, "{}", score.bias());
        assert!((score.rmse() - 0.03).abs() < 0.002, "{}", score.rmse());
        assert!(score.raw_rmse() > 0.048);
    }
}
