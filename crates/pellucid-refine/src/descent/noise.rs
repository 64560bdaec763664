//! How much of the loss is noise of the prediction, and how many paths it takes to keep that small.

use pellucid_core::Control;
use pellucid_predict::{Draw, Pass};

use super::{DescentState, DescentTools};
use crate::{RefineError, Seen, Setup};

/// Steps from one measurement to the next: the loss falls, and noise stays.
const EVERY: u32 = 10;
/// The part of the loss that may be noise, of coarse steps and of fine ones: steps that follow noise undo one another's
/// gains, and leave grain.
const PARTS: [f64; 2] = [2.0 / 3.0, 1.0 / 3.0];
/// How often paths are doubled at most.
pub(super) const MOST_DOUBLINGS: u8 = 3;
/// The first of so many parts of all steps is coarse: steps are long, and what noise does to them is undone by those that
/// follow. From there on paths are at least doubled.
const COARSE: u32 = 2;
/// The loss no longer falls when its mean over the last steps lies by less than this part below that of as many before
/// them.
const SETTLED: f64 = 0.01;
const LOOK_BACK: usize = 6;

impl DescentState {
    /// The effort of predictions.
    pub(super) fn effort(&self) -> u32 {
        1 << self.doublings
    }

    /// The effort of gradients, whose noise running means take away.
    pub(super) fn gradient_effort(&self) -> u32 {
        1 << self.doublings.min(1)
    }

    /// Makes steps fine once so many of all `steps` are taken, or the loss no longer falls: it may be the noise of few
    /// paths that keeps it up.
    pub(super) fn refine_paths(&mut self, steps: u32) {
        if self.fine.is_some() || COARSE * self.steps < steps && !flat(&self.losses) {
            return;
        }
        self.fine = Some(self.steps);
        self.losses.drain(..self.losses.len().saturating_sub(LOOK_BACK));
        if self.doublings == 0 {
            self.doublings = 1;
            let gone = self.noise.unwrap_or(0.0) / 2.0;
            self.losses.iter_mut().for_each(|loss| *loss -= gone);
        }
    }

    /// Notes when the loss no longer falls by paths of the fine steps.
    pub(super) fn settle(&mut self) {
        if self.settled.is_none() && self.fine.is_some() && flat(&self.losses) {
            self.settled = Some(self.steps);
        }
    }

    /// True when the noise is to be measured: from time to time, while more effort can still be made, of predictors that
    /// have any.
    pub(super) fn asks_for_noise(&self) -> bool {
        let due = (self.steps - self.fine.unwrap_or(0)).is_multiple_of(EVERY);
        due && self.doublings < MOST_DOUBLINGS && self.noise != Some(0.0)
    }

    /// Takes in how much of a mean loss is noise: from now on so many paths that it would have been small. What was seen
    /// of losses before is brought to what it would have been then.
    pub(super) fn take_noise(&mut self, loss: f64, noise: f64) {
        self.noise = Some(noise);
        let part = PARTS[usize::from(self.fine.is_some())];
        let before = self.doublings;
        let signal = (loss - noise).max(0.0);
        let left = |doublings: u8| noise / f64::from(1u32 << (doublings - before));
        while self.doublings < MOST_DOUBLINGS && left(self.doublings) > part * (signal + left(self.doublings))
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

/// True when the last losses lie hardly below as many before them.
fn flat(losses: &[f64]) -> bool {
    let Some(before) = losses.len().checked_sub(2 * LOOK_BACK) else { return false };
    let sum = |losses: &[f64]| losses.iter().sum::<f64>();
    let (earlier, later) = losses[before..].split_at(LOOK_BACK);
    sum(later) > (1.0 - SETTLED) * sum(earlier)
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
    fn paths_are_doubled_until_noise_is_a_third_and_of_coarse_steps_two_thirds() {
        let fine = [(1, 1.4, 1), (1, 1.6, 2), (1, 3.1, 3), (1, 9.0, 3), (2, 1.6, 3)];
        let coarse = [(0, 5.9, 0), (0, 6.1, 1), (0, 12.1, 2), (1, 90.0, 3)];
        for (cases, fine) in [(&fine[..], Some(0)), (&coarse[..], None)] {
            for &(doublings, noise, wanted) in cases {
                let mut state = DescentState { fine, ..state(doublings) };
                state.take_noise(3.0 + noise, noise);
                assert_eq!((state.doublings, state.noise), (wanted, Some(noise)), "{doublings} {noise}");
                assert_eq!(state.losses.is_empty(), wanted > doublings);
            }
        }
    }

    #[test]
    fn losses_seen_before_are_brought_to_the_new_noise() {
        let mut state = DescentState { fine: Some(0), ..state(1) };
        state.take_noise(6.0, 4.0);
        assert_eq!((state.effort(), state.gradient_effort()), (8, 2));
        let patch = state.patches[0];
        // 2 + 4 becomes 2 + 1.
        assert_eq!((patch.loss, patch.least, patch.length, patch.rose), (5.0, 4.0, 3.0, true));
        assert!(!state.asks_for_noise());
    }

    #[test]
    fn a_prediction_without_noise_is_measured_once() {
        let mut state = DescentState { fine: Some(0), ..state(1) };
        assert!(state.asks_for_noise());
        state.take_noise(3.0, 0.0);
        assert!(!state.asks_for_noise() && state.effort() == 2);
    }

    #[test]
    fn paths_are_doubled_for_the_fine_steps_and_noise_is_asked_for_in_both() {
        for noisy in [false, true] {
            let mut state = DescentState { losses: Vec::new(), ..state(0) };
            let mut asked = Vec::new();
            for step in 0..29 {
                state.steps = step;
                state.refine_paths(29);
                if state.asks_for_noise() {
                    asked.push(step);
                    state.take_noise(3.0, if noisy && step == 0 { 2.2 } else { 0.5 });
                }
                assert_eq!(state.effort(), if step < 15 && !noisy { 1 } else { 2 }, "{step}");
            }
            assert_eq!((asked, state.fine), (vec![0, 10, 15, 25], Some(15)));
        }
        // Losses of the coarse steps had twice the noise.
        let mut state = DescentState { steps: 15, losses: vec![7.0, 5.0], noise: Some(1.0), ..state(0) };
        state.refine_paths(29);
        assert_eq!(state.losses, [6.5, 4.5]);
    }

    #[test]
    fn a_loss_that_is_flat_by_few_paths_makes_steps_fine_and_must_stay_flat() {
        let mut state = DescentState { losses: Vec::new(), ..state(0) };
        for step in 0..60 {
            state.steps = step;
            state.losses.push(5.0);
            state.settle();
            state.steps += 1;
            state.refine_paths(100);
        }
        let look_back = LOOK_BACK as u32;
        assert_eq!((state.fine, state.settled), (Some(2 * look_back), Some(3 * look_back - 1)));
        assert_eq!(state.effort(), 2);
    }
}
