//! What passes have found a predictor's error to be, and how it is written down.

use crate::pair::{check_learned, halves, not_learned};
use crate::{Learned, ObjectId, PredictError};

/// The mean error of some passes.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Errors {
    /// The passes in it, by number, ascending; none yet where empty.
    pub(super) passes: Vec<u32>,
    /// `[point][channel]`, empty without passes.
    pub(super) values: Vec<f32>,
}

/// Whose errors they are: those of another predictor or object mean nothing here.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Owner {
    pub(super) predictor: String,
    pub(super) object: ObjectId,
    /// Numbers that a pass learns.
    pub(super) values: usize,
}

impl Errors {
    /// The share of further `passes` in the mean: 2 / (n + 1) of the n-th, so that weights rise with their number, and at
    /// least `newest` a pass.
    pub(super) fn share_of(&self, passes: usize, newest: f64) -> f32 {
        let before = self.passes.len();
        let kept = (before..before + passes).map(|n| 1.0 - (2.0 / (n as f64 + 2.0)).max(newest));
        (1.0 - kept.product::<f64>()) as f32
    }

    /// Takes in what later passes found.
    pub(super) fn absorb(&mut self, later: Self, newest: f64) {
        if self.passes.is_empty() {
            *self = later;
            return;
        }
        let share = self.share_of(later.passes.len(), newest);
        self.values.iter_mut().zip(&later.values).for_each(|(own, later)| *own += share * (later - *own));
        self.passes.extend(&later.passes);
        self.passes.sort_unstable();
    }
}

impl Owner {
    /// Values: the object's identity in two halves; the errors are the singles.
    pub(super) fn write(&self, errors: Errors) -> Learned {
        let Errors { passes, values } = errors;
        Learned {
            predictor: self.predictor.clone(),
            passes,
            values: halves(self.object).to_vec(),
            singles: values,
        }
    }

    /// Errors from what [`Owner::write`] made.
    pub(super) fn read(&self, learned: &Learned) -> Result<Errors, PredictError> {
        check_learned(learned, &self.predictor)?;
        let Learned { passes, values, singles, .. } = learned;
        if *values != halves(self.object) {
            return Err(not_learned("of another object"));
        }
        if singles.len() != self.values {
            return Err(not_learned(format!("{} in number instead of {}", singles.len(), self.values)));
        }
        if singles.iter().any(|v| !v.is_finite()) {
            return Err(not_learned("that are not finite"));
        }
        Ok(Errors { passes: passes.clone(), values: singles.clone() })
    }
}
