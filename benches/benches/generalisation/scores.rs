//! Errors of a network on labelled points.

use pellucid::color::Viewing;
use pellucid::core::{ErrorStats, NoisyScore};
use pellucid_benches::appearance::mean_delta_e;
use serde::{Deserialize, Serialize};

use super::finished::Finished;

/// One network on one set or model, or on one shape family of a set.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Row {
    /// Set or model.
    pub set: String,
    /// Shape family; empty for all.
    pub class: String,
    /// Name of the volumes trained on.
    pub shapes: String,
    pub seed: u64,
    /// Name of the architecture.
    pub variant: String,
    pub samples: u64,
    pub rmse: f64,
    pub bias: f64,
    /// 95th percentile of the absolute difference, the reference's noise included.
    pub p95: f64,
    /// Mean CIEDE2000, relative to the print's white, the reference's noise included.
    pub delta_e: f64,
    /// Root of the mean squared standard error of the reference.
    pub noise: f64,
}

/// Labelled points, `[point][channel]`.
pub struct Labels<'a> {
    pub radiance: &'a [f32],
    pub std_error: &'a [f32],
    pub viewing: &'a Viewing,
}

impl Row {
    /// Compares predictions with labels.
    pub fn of(set: &str, class: &str, network: &Finished, predicted: &[f32], labels: &Labels<'_>) -> Self {
        let mut score = NoisyScore::default();
        let mut sizes = Vec::with_capacity(predicted.len());
        let mut noise = 0.0;
        for ((&p, &l), &e) in predicted.iter().zip(labels.radiance).zip(labels.std_error) {
            let (difference, variance) = (f64::from(p) - f64::from(l), f64::from(e).powi(2));
            score.add_difference(difference, variance);
            sizes.push(difference.abs() as f32);
            noise += variance;
        }
        Self {
            set: set.to_owned(),
            class: class.to_owned(),
            shapes: network.group.shapes.name().to_owned(),
            seed: network.group.seed,
            variant: network.variant.name().to_owned(),
            samples: score.count(),
            rmse: score.rmse(),
            bias: score.bias(),
            p95: ErrorStats::of(sizes).p95,
            delta_e: mean_delta_e(predicted, labels.radiance, labels.viewing),
            noise: (noise / predicted.len().max(1) as f64).sqrt(),
        }
    }
}
