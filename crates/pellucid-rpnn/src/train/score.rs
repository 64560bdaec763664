//! Errors of predictions against labels.

use pellucid_core::{ErrorStats, NoisyScore};
use serde::{Deserialize, Serialize};

use crate::RpnnError;

/// Errors in linear radiance over a set of samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Score {
    /// Number of samples.
    pub samples: u64,
    /// Root of the mean squared difference from the labels, the labels' own noise taken out.
    pub rmse: f64,
    /// Mean of prediction minus label.
    pub bias: f64,
    /// 95th percentile of the absolute difference, the labels' noise included.
    pub p95: f64,
    /// Root of the mean squared standard error of the labels.
    pub label_noise: f64,
}

impl Score {
    /// Compares predictions with labels of known standard error.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths differ or there are no samples.
    ///
    /// ```
    /// use pellucid_rpnn::train::Score;
    /// let score = Score::new(&[0.5, 0.3], &[0.4, 0.4], &[0.0, 0.0]).unwrap();
    /// assert!((score.rmse - 0.1).abs() < 1e-6 && score.bias.abs() < 1e-6);
    /// ```
    pub fn new(predicted: &[f32], labels: &[f32], standard_error: &[f32]) -> Result<Self, RpnnError> {
        let n = predicted.len();
        if n == 0 || labels.len() != n || standard_error.len() != n {
            return Err(RpnnError::invalid(
                "samples",
                format!("{n} predictions, {} labels, {} errors", labels.len(), standard_error.len()),
            ));
        }
        let mut score = NoisyScore::default();
        let mut sizes = Vec::with_capacity(n);
        let mut noise = 0.0;
        for ((&predicted, &label), &error) in predicted.iter().zip(labels).zip(standard_error) {
            let (difference, variance) =
                (f64::from(predicted) - f64::from(label), f64::from(error) * f64::from(error));
            score.add_difference(difference, variance);
            sizes.push(difference.abs() as f32);
            noise += variance;
        }
        Ok(Self {
            samples: n as u64,
            rmse: score.rmse(),
            bias: score.bias(),
            p95: ErrorStats::of(sizes).p95,
            label_noise: (noise / n as f64).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_noise_is_taken_out() {
        let n = 20_000;
        // Labels off by exactly one standard error either way, predictions off by 0.03.
        let labels: Vec<f32> = (0..n).map(|i| 0.5 + if i % 2 == 0 { 0.04 } else { -0.04 }).collect();
        let predicted: Vec<f32> = (0..n).map(|i| 0.5 + if i % 4 < 2 { 0.03 } else { -0.03 }).collect();
        let score = Score::new(&predicted, &labels, &vec![0.04; n]).unwrap();
        assert!((score.rmse - 0.03).abs() < 1e-6, "{score:?}");
        assert!((score.p95 - 0.07).abs() < 1e-6 && (score.label_noise - 0.04).abs() < 1e-6);
        assert!(Score::new(&[], &[], &[]).is_err());
        assert!(Score::new(&[0.1], &[0.1], &[]).is_err());
    }
}
