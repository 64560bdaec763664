//! What the judge hands back.

use pellucid_core::NoisyScore;

use super::StateErrors;
use super::noise::mean_of;
use crate::RefineError;

/// What the judge found.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Judged {
    /// The errors.
    pub errors: StateErrors,
    /// The surface voxels drawn for per-voxel errors, ascending.
    pub points: Vec<u32>,
    /// Absolute radiance of those by either half of the passes, `[point][channel]`; alike without random error.
    pub halves: [Vec<f32>; 2],
    /// What every surface voxel shows by either half of the passes over all, linear RGB relative to the print's white;
    /// alike without random error.
    pub shown: [Vec<[f32; 3]>; 2],
}

impl Judged {
    /// What every surface voxel shows: the mean of the passes over all.
    pub fn appearance(&self) -> Vec<[f32; 3]> {
        mean_of(&self.shown)
    }

    /// How far a prediction of [`Judged::points`], `[point][channel]`, is off what the judge saw, whose noise is taken
    /// out.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when there are not as many values.
    pub fn prediction_error(&self, radiance: &[f32]) -> Result<NoisyScore, RefineError> {
        let [first, second] = &self.halves;
        if radiance.len() != first.len() {
            return Err(RefineError::invalid(
                "radiance",
                format!("{} values; the judge has {}", radiance.len(), first.len()),
            ));
        }
        let mut score = NoisyScore::default();
        for ((&predicted, &a), &b) in radiance.iter().zip(first).zip(second) {
            score.add(f64::from(predicted), [f64::from(a), f64::from(b)]);
        }
        Ok(score)
    }
}
