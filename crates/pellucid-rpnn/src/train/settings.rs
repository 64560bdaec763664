//! What a training run does.

use pellucid_core::InstructionSet;
use serde::{Deserialize, Serialize};

use crate::adamw::AdamWSettings;
use crate::transform::{FeatureTransform, InputForm, LevelOrder};
use crate::variant::Head;
use crate::{Precision, RpnnError, Variant};

/// Settings of a [`Trainer`](super::Trainer). The defaults are for the shipped network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainSettings {
    /// The architecture.
    pub variant: Variant,
    /// What the last layer gives; checkpoints of before there was a choice give radiance.
    #[serde(default)]
    pub head: Head,
    /// Steps of the whole run; the schedule ends there.
    pub steps: u64,
    /// Samples a step.
    pub batch: usize,
    /// Highest learning rate.
    pub peak_rate: f64,
    /// Steps over which the rate rises linearly to its peak.
    pub warm_up: u64,
    /// The optimiser.
    pub optimiser: AdamWSettings,
    /// Whether every sample is mirrored along random axes.
    pub mirror: bool,
    /// Seed of the initial weights and the mirrors.
    pub seed: u64,
    /// What is done to the stencils.
    #[serde(flatten)]
    pub form: InputForm,
    /// Number format of the products.
    pub precision: Precision,
    /// What the untrained network's outputs start near: the mean radiance, or the mean throughput after the first
    /// flight.
    #[serde(alias = "mean_radiance")]
    pub mean_output: f32,
    /// Instruction set of this crate's own engine, or `None` for [`InstructionSet::chosen`]. Runs on different sets
    /// drift apart by rounding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instruction_set: Option<InstructionSet>,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            variant: Variant::SharedLevelsAndOctants,
            head: Head::FirstFlight,
            steps: 60_000,
            batch: 256,
            peak_rate: 1.5e-3,
            warm_up: 200,
            optimiser: AdamWSettings::default(),
            mirror: true,
            seed: 1,
            form: InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine },
            precision: Precision::F32,
            mean_output: Head::FirstFlight.mean_output(),
            instruction_set: None,
        }
    }
}

impl TrainSettings {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] naming the field, [`RpnnError::Unsupported`] for an instruction set that this processor
    /// lacks.
    pub fn check(&self) -> Result<(), RpnnError> {
        let a = &self.optimiser;
        let decays = [("beta1", a.beta1), ("beta2", a.beta2), ("average decay", a.average_decay)];
        if let Some((field, value)) = decays.iter().find(|(_, v)| !(0.0..1.0).contains(v)) {
            return Err(RpnnError::invalid(*field, format!("{value}; must lie within 0 and below 1")));
        }
        let rates = [("peak rate", self.peak_rate), ("epsilon", a.epsilon), ("clip norm", a.clip_norm)];
        if let Some((field, value)) = rates.iter().find(|(_, v)| !(*v > 0.0 && v.is_finite())) {
            return Err(RpnnError::invalid(*field, format!("{value}; must be above 0")));
        }
        if !(a.weight_decay >= 0.0 && a.weight_decay.is_finite()) {
            return Err(RpnnError::invalid("weight decay", format!("{}; must be 0 or more", a.weight_decay)));
        }
        if !(1..=65_536).contains(&self.batch) {
            return Err(RpnnError::invalid("batch", format!("{}; 1 to 65536 are possible", self.batch)));
        }
        if self.steps == 0 || self.steps >= 1 << 30 || self.warm_up >= self.steps {
            return Err(RpnnError::invalid(
                "steps",
                format!("{} with {} of warm-up; at least one must follow", self.steps, self.warm_up),
            ));
        }
        if !self.mean_output.is_finite() {
            return Err(RpnnError::invalid("mean output", "must be a number"));
        }
        if let Some(set) = self.instruction_set {
            set.require().map_err(RpnnError::Unsupported)?;
        }
        Ok(())
    }

    /// Learning rate of a step, counted from 0: linear warm-up, then a half cosine to zero.
    pub fn rate(&self, step: u64) -> f64 {
        if step < self.warm_up {
            return self.peak_rate * (step + 1) as f64 / self.warm_up as f64;
        }
        let span = self.steps.saturating_sub(self.warm_up).max(1);
        let passed = (step - self.warm_up).min(span) as f64 / span as f64;
        0.5 * self.peak_rate * (1.0 + (std::f64::consts::PI * passed).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_rises_then_falls_to_zero() {
        let s = TrainSettings { steps: 1200, warm_up: 200, peak_rate: 2e-3, ..Default::default() };
        assert!((s.rate(0) - 1e-5).abs() < 1e-12);
        assert!((s.rate(199) - 2e-3).abs() < 1e-12);
        assert!((s.rate(700) - 1e-3).abs() < 1e-9, "half way down the cosine");
        assert!(s.rate(1199) < 1e-8 && s.rate(1199) > 0.0);
        assert_eq!(s.rate(5000), 0.0);
        assert!((201..1200).all(|i| s.rate(i) < s.rate(i - 1)));
    }

    #[test]
    fn refuses_what_cannot_train() {
        let good = TrainSettings::default();
        good.check().unwrap();
        let bad = [
            TrainSettings { batch: 0, ..good.clone() },
            TrainSettings { steps: 200, ..good.clone() },
            TrainSettings { peak_rate: f64::NAN, ..good.clone() },
            TrainSettings { mean_output: f32::INFINITY, ..good.clone() },
            TrainSettings { optimiser: AdamWSettings { beta2: 1.0, ..Default::default() }, ..good.clone() },
            TrainSettings { optimiser: AdamWSettings { weight_decay: -1.0, ..Default::default() }, ..good },
        ];
        assert!(bad.iter().all(|s| s.check().is_err()));
    }
}
