//! Runs that are done: weights, curves and times.

use std::path::Path;
use std::sync::Arc;

use pellucid::rpnn::train::{CurvePoint, Score, Trainer};
use pellucid::rpnn::{Inference, Precision, TrainedNetwork, Variant};

use super::Error;
use super::plan::{Group, Plan};
use super::training::{Length, path, saved};

/// A trained network under study.
pub struct Finished {
    /// Volumes and seed.
    pub group: Group,
    /// The architecture.
    pub variant: Variant,
    /// Weights and what they were trained for.
    pub trained: Arc<TrainedNetwork>,
    /// A digest of the weights.
    pub digest: String,
    /// Loss and validation over the run.
    pub curve: Vec<CurvePoint>,
    /// Seconds of its steps by the clock, samples not included.
    pub seconds: f64,
    /// Validation of the run that came to rest at three quarters of the steps.
    pub three_quarters: Option<Score>,
}

impl Finished {
    /// Number format of the products, in training and prediction.
    pub const PRECISION: Precision = Precision::Bf16;

    /// Predicts stencils.
    pub fn inference(&self) -> Result<Inference, Error> {
        Ok(Inference::new(&self.trained.weights, self.trained.provenance.form, Self::PRECISION)?)
    }

    /// The last validation.
    pub fn validation(&self) -> Option<Score> {
        self.curve.iter().rev().find_map(|p| p.validation)
    }

    /// The validation nearest a step.
    pub fn validation_at(&self, step: u64) -> Option<Score> {
        let validated = self.curve.iter().filter_map(|p| Some((p.step, p.validation?)));
        validated.min_by_key(|(at, _)| at.abs_diff(step)).map(|(_, score)| score)
    }
}

/// All runs that are done, in the plan's order.
pub fn finished(plan: &Plan, folder: &Path) -> Result<Vec<Finished>, Error> {
    let mut all = Vec::new();
    for &group in &plan.groups {
        for variant in Variant::ALL {
            let weights = path(folder, group, variant, Length::Whole, "weights");
            let whole = saved(folder, group, variant, Length::Whole)?;
            let Some(whole) = whole.filter(|trainer| trainer.finished() && weights.exists()) else {
                continue;
            };
            let shorter = saved(folder, group, variant, Length::ThreeQuarters)?.filter(Trainer::finished);
            let trained = pellucid::rpnn::file::load(&weights)?;
            let last = |trainer: &Trainer| trainer.curve().points.iter().rev().find_map(|p| p.validation);
            all.push(Finished {
                group,
                variant,
                digest: trained.weights.digest(),
                trained: Arc::new(trained),
                curve: whole.curve().points.clone(),
                seconds: whole.seconds(),
                three_quarters: shorter.as_ref().and_then(last),
            });
        }
    }
    Ok(all)
}
