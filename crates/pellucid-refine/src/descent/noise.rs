//! How much of the loss is noise of the prediction, and how many paths it takes to keep that small.

use pellucid_core::Control;
use pellucid_predict::{Draw, Pass};

use super::{DescentState, DescentTools};
use crate::{RefineError, Seen, Setup};

/// Steps from one measurement to the next: the loss falls, and noise stays.
const EVERY: u32 = 10;
/// The part of the loss that may be noise: steps that follow noise undo one another's gains.
const PART: f64 = 1.0 / 3.0;
/// How often paths are doubled at most.
pub(super) const MOST_DOUBLINGS: u8 = 2;

impl DescentState {
    /// The effort of predictions.
    pub(super) fn effort(&self) -> u32 {
        1 << self.doublings
    }

    /// True when the noise is to be measured: from time to time, while more effort can still be made, of predictors that
    /// have any.
    pub(super) fn asks_for_noise(&self) -> bool {
        self.doublings < MOST_DOUBLINGS && self.steps.is_multiple_of(EVERY) && self.noise != Some(0.0)
    }

    /// Takes in how much of a mean loss is noise: from now on so many paths that it would have been small. What was seen
    /// of losses before is brought to what it would have been then.
    pub(super) fn take_noise(&mut self, loss: f64, noise: f64) {
        self.noise = Some(noise);
        let before = self.doublings;
        let signal = (loss - noise).max(0.0);
        let left = |doublings: u8| noise / f64::from(1u32 << (doublings - before));
        while self.doublings < MOST_DOUBLINGS && left(self.doublings) > PART * (signal + left(self.doublings))
        {
            self.doublings += 1;
        }
        if self.doublings > before {
            self.losses.clear();
            let factor = (signal + left(self.doublings)) / (signal + noise);
            for patch in &mut self.patches {
                patch.loss *= factor as f32;
                patch.least *= factor as f32;
            }
        }
    }
}

impl DescentTools {
    /// Predicts the labels once more and gives what of the mean loss is noise.
    pub(super) fn noise(
        &self,
        setup: &Setup<'_>,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<f64, RefineError> {
        let draw = Draw { pass: Pass::Repeat(seen.iteration), ..seen.draw };
        let mut radiance = vec![0.0; seen.radiance.len()];
        seen.bound
            .predict(&setup.points, draw, &mut radiance, control)
            .map_err(|e| RefineError::predict(seen.iteration, e))?;
        self.noise_between(setup, seen, &radiance, control)
    }
}

#[cfg(test)]
mod tests {
    use super::super::patches::Patch;
    use super::*;

    fn state(doublings: u8) -> DescentState {
        let patch = Patch { length: 3.0, loss: 10.0, least: 8.0, rose: true };
        DescentState { doublings, losses: vec![5.0; 3], patches: vec![patch], ..DescentState::default() }
    }

    #[test]
    fn paths_are_doubled_until_noise_is_a_third() {
        for (doublings, noise, wanted) in [(0, 1.4, 0), (0, 1.6, 1), (0, 3.1, 2), (0, 9.0, 2), (1, 1.6, 2)] {
            let mut state = state(doublings);
            state.take_noise(3.0 + noise, noise);
            assert_eq!((state.doublings, state.noise), (wanted, Some(noise)), "{doublings} {noise}");
            assert_eq!(state.losses.is_empty(), wanted > doublings);
        }
    }

    #[test]
    fn losses_seen_before_are_brought_to_the_new_noise() {
        let mut state = state(0);
        state.take_noise(6.0, 4.0);
        assert_eq!(state.effort(), 4);
        let patch = state.patches[0];
        // 2 + 4 becomes 2 + 1.
        assert_eq!((patch.loss, patch.least, patch.length, patch.rose), (5.0, 4.0, 3.0, true));
        assert!(!state.asks_for_noise());
    }

    #[test]
    fn a_prediction_without_noise_is_measured_once() {
        let mut state = state(0);
        assert!(state.asks_for_noise());
        state.take_noise(3.0, 0.0);
        assert!(!state.asks_for_noise() && state.effort() == 1);
    }
}
