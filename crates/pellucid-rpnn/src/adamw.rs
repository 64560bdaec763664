//! AdamW (Loshchilov & Hutter 2019) over a flat parameter vector, with gradient clipping and a moving
//! average of the weights.

use pellucid_core::InstructionSet;

use crate::RpnnError;
use crate::kernel::{self, Update};

/// Settings of [`AdamW`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct AdamWSettings {
    /// Decay of the first moment.
    pub beta1: f64,
    /// Decay of the second moment.
    pub beta2: f64,
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// Decoupled weight decay, times the learning rate.
    pub weight_decay: f64,
    /// Gradients longer than this are scaled to it.
    pub clip_norm: f64,
    /// Decay of the moving average of the weights; 0 follows them at once.
    pub average_decay: f64,
}

impl Default for AdamWSettings {
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.99,
            epsilon: 1e-8,
            weight_decay: 0.0,
            clip_norm: 0.5,
            average_decay: 0.999,
        }
    }
}

/// The optimiser's state: moments, step count and averaged weights.
#[derive(Clone, Debug, PartialEq)]
pub struct AdamW {
    settings: AdamWSettings,
    /// Steps taken.
    pub step: u64,
    /// First moment, one value a parameter.
    pub first: Vec<f32>,
    /// Second moment, one value a parameter.
    pub second: Vec<f32>,
    /// Moving average of the parameters.
    pub average: Vec<f32>,
}

impl AdamW {
    /// A fresh state for `parameters`.
    pub fn new(settings: AdamWSettings, parameters: &[f32]) -> Self {
        let zeros = vec![0.0; parameters.len()];
        Self { settings, step: 0, first: zeros.clone(), second: zeros, average: parameters.to_vec() }
    }

    /// One step at `rate`; returns the gradient's norm before clipping.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when lengths differ or the gradient is not finite; nothing changes then.
    pub fn step(&mut self, parameters: &mut [f32], gradient: &[f32], rate: f64) -> Result<f64, RpnnError> {
        if parameters.len() != self.first.len() || gradient.len() != self.first.len() {
            return Err(RpnnError::invalid("gradient", "its length is not the optimiser's"));
        }
        let set = InstructionSet::chosen();
        let norm = kernel::sum_of_squares(set, gradient).sqrt();
        if !norm.is_finite() {
            return Err(RpnnError::invalid("gradient", "it is not finite; lower the learning rate"));
        }
        let s = self.settings;
        self.step += 1;
        let t = self.step.min(1 << 30) as i32;
        // Early averages follow the weights closely, or the random start would linger.
        let keep = s.average_decay.min((1.0 + t as f64) / (10.0 + t as f64));
        let update = Update {
            scale: (s.clip_norm / norm.max(1e-30)).min(1.0) as f32,
            first_rate: 1.0 - s.beta1 as f32,
            second_rate: 1.0 - s.beta2 as f32,
            first_scale: (1.0 / (1.0 - s.beta1.powi(t))) as f32,
            second_scale: (1.0 / (1.0 - s.beta2.powi(t))) as f32,
            rate: rate as f32,
            epsilon: s.epsilon as f32,
            decay: (rate * s.weight_decay) as f32,
            average_rate: 1.0 - keep as f32,
        };
        let (first, second, average) = (&mut self.first, &mut self.second, &mut self.average);
        kernel::update(set, update, parameters, gradient, first, second, average);
        Ok(norm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the formulas written out in f64.
    #[test]
    fn follows_the_published_update() {
        let settings = AdamWSettings { weight_decay: 0.01, clip_norm: 1.0, ..Default::default() };
        let mut p = vec![0.5f32, -1.0, 2.0];
        let mut adam = AdamW::new(settings, &p);
        let (mut q, mut m, mut v) = ([0.5f64, -1.0, 2.0], [0.0; 3], [0.0; 3]);
        for t in 1..=50 {
            let g: Vec<f32> =
                (0..3).map(|i| ((t * 3 + i) as f32).sin() * if t == 7 { 40.0 } else { 0.3 }).collect();
            let norm = g.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
            let got = adam.step(&mut p, &g, 1e-2).unwrap();
            assert!((got - norm).abs() < 1e-9);
            for i in 0..3 {
                let g = f64::from(g[i]) * (1.0 / norm).min(1.0);
                m[i] = 0.9 * m[i] + 0.1 * g;
                v[i] = 0.99 * v[i] + 0.01 * g * g;
                let (mh, vh) = (m[i] / (1.0 - 0.9f64.powi(t)), v[i] / (1.0 - 0.99f64.powi(t)));
                q[i] -= 1e-2 * (mh / (vh.sqrt() + 1e-8) + 0.01 * q[i]);
                assert!((f64::from(p[i]) - q[i]).abs() < 1e-5, "step {t}: {} {}", p[i], q[i]);
            }
        }
    }

    #[test]
    fn refuses_gradients_that_are_not_finite() {
        let mut p = vec![1.0f32; 2];
        let mut adam = AdamW::new(AdamWSettings::default(), &p);
        let before = adam.clone();
        assert!(adam.step(&mut p, &[f32::NAN, 0.0], 1e-3).is_err());
        assert_eq!((p, adam), (vec![1.0; 2], before));
    }
}
