//! Runs that are done: weights, curves and times.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use pellucid::rpnn::train::{CurvePoint, Score, Trainer};
use pellucid::rpnn::{Inference, Precision, TrainedNetwork, Variant};

use super::Error;
use super::plan::{Group, Plan};
use super::runs::Runs;
use super::scores::Row;
use super::training::{Length, path, saved};

/// A trained network under study.
pub struct Finished {
    /// Volumes and seed.
    pub group: Group,
    /// The architecture.
    pub variant: Variant,
    /// Weights and what they were trained for; none of a run that is only kept by what it came to.
    pub trained: Option<Arc<TrainedNetwork>>,
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

    /// Weights and what they were trained for.
    pub fn network(&self) -> Result<&Arc<TrainedNetwork>, Error> {
        self.trained.as_ref().ok_or_else(|| format!("{self}: its weights are not in the state").into())
    }

    /// Predicts stencils.
    pub fn inference(&self) -> Result<Inference, Error> {
        let network = self.network()?;
        Ok(Inference::new(&network.weights, network.provenance.form, Self::PRECISION)?)
    }

    /// Whether a row is of this network.
    pub fn is_of(&self, row: &Row) -> bool {
        row.shapes == self.group.shapes.name()
            && row.seed == self.group.seed
            && row.variant == self.variant.name()
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

impl fmt::Display for Finished {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} on {}, seed {}", self.variant.name(), self.group.shapes.name(), self.group.seed)
    }
}

/// All runs that are done, in the plan's order: those of the state, and those that are kept.
pub fn finished(plan: &Plan, folder: &Path, kept: &Runs) -> Result<Vec<Finished>, Error> {
    let mut all = Vec::new();
    for &group in &plan.groups {
        for variant in Variant::ALL {
            let here = trained(folder, group, variant)?;
            all.extend(here.or_else(|| of_kept(kept, group, variant)));
        }
    }
    Ok(all)
}

/// A run of the state, if it is done.
fn trained(folder: &Path, group: Group, variant: Variant) -> Result<Option<Finished>, Error> {
    let weights = path(folder, group, variant, Length::Whole, "weights");
    let whole = saved(folder, group, variant, Length::Whole)?;
    let Some(whole) = whole.filter(|trainer| trainer.finished() && weights.exists()) else {
        return Ok(None);
    };
    let shorter = saved(folder, group, variant, Length::ThreeQuarters)?.filter(Trainer::finished);
    let trained = pellucid::rpnn::file::load(&weights)?;
    let last = |trainer: &Trainer| trainer.curve().points.iter().rev().find_map(|p| p.validation);
    Ok(Some(Finished {
        group,
        variant,
        digest: trained.weights.digest(),
        trained: Some(Arc::new(trained)),
        curve: whole.curve().points.clone(),
        seconds: whole.seconds(),
        three_quarters: shorter.as_ref().and_then(last),
    }))
}

/// A run that is kept.
fn of_kept(kept: &Runs, group: Group, variant: Variant) -> Option<Finished> {
    let run = kept.find(group.shapes.name(), group.seed, variant.name())?;
    Some(Finished {
        group,
        variant,
        digest: run.digest.clone(),
        trained: None,
        curve: run.curve.clone(),
        seconds: run.seconds,
        three_quarters: run.three_quarters,
    })
}
