//! What passes have found a predictor's error to be, and how it is written down.

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
            values: self.identity().to_vec(),
            singles: values,
        }
    }

    /// Errors from what [`Owner::write`] made.
    pub(super) fn read(&self, learned: &Learned) -> Result<Errors, PredictError> {
        let wrong = |reason: String| Err(PredictError::invalid("learned values", reason));
        if learned.predictor != self.predictor {
            return wrong(format!("of {}; this predictor is {}", learned.predictor, self.predictor));
        }
        if learned.passes.is_empty() || !learned.passes.is_sorted_by(|a, b| a < b) {
            return wrong("without passes, or passes that do not ascend".into());
        }
        if learned.values != self.identity() {
            return wrong("of another object".into());
        }
        if learned.singles.len() != self.values {
            return wrong(format!("{} in number instead of {}", learned.singles.len(), self.values));
        }
        if learned.singles.iter().any(|v| !v.is_finite()) {
            return wrong("that are not finite".into());
        }
        Ok(Errors { passes: learned.passes.clone(), values: learned.singles.clone() })
    }

    fn identity(&self) -> [f64; 2] {
        let ObjectId(id) = self.object;
        [(id >> 32) as f64, (id & 0xffff_ffff) as f64]
    }
}
