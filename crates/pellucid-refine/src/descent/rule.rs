//! Rules that turn a derivative into a step.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::patches;
use super::state::{Cells, DescentState, MOVE};

/// How far descent steps; `benches/descent_variants.sh` compares what the rules reach.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum StepRule {
    /// In proportion to the step that a separable quadratic bound of the loss's curvature makes safe (De Pierro 1995),
    /// patch by patch of the surface, with momentum.
    Bound,
    /// By running means of derivatives and of their squares (Kingma and Ba 2015), every share by itself; the momentum is
    /// the first mean's share of the past. Steps grow over the first few, and go down a line to nothing at the last.
    #[default]
    Adam,
    /// Against the bound, by one length for all that the last move and what it did to the derivative give (Barzilai and
    /// Borwein 1988, their first); no momentum.
    BarzilaiBorwein,
}

/// Share of the past in the running mean of squares: of a hundred steps, since there are few.
const SQUARES: f32 = 0.99;
/// The longest step of [`StepRule::Adam`], as a share of a cell.
const ADAM_STEP: f32 = 0.1;
/// Steps until it is reached, of many: the first derivatives say which way, but not yet how surely.
const WARM_UP: u32 = 8;
/// Steps that follow once the loss no longer falls, ever shorter: what is left of noise goes.
const LAST_STEPS: u32 = 6;
/// A mean is at most so many root mean squares long: by Cauchy and Schwarz, without momentum 1 / sqrt(1 - [`SQUARES`]).
const LONGEST: f32 = 10.0;

/// When the steps of [`StepRule::Adam`] end: their lengths go down a line to nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    /// All steps that there are iterations for.
    steps: u32,
    /// Those before the loss no longer fell.
    settled: Option<u32>,
}

impl Schedule {
    pub(super) fn new(steps: u32, settled: Option<u32>) -> Self {
        Self { steps, settled }
    }

    /// True when nothing is left to gain of a step and those after it.
    pub(super) fn is_over(self, step: u32) -> bool {
        self.settled.is_some_and(|settled| step >= settled + LAST_STEPS)
    }

    /// The length of a step, as a share of a cell.
    pub(super) fn length(self, step: u32) -> f32 {
        let left = |step: u32, steps: u32| 1.0 - step as f32 / (steps as f32 + 1.0);
        let left = match self.settled {
            Some(settled) if step > settled => left(settled, self.steps) * left(step - settled, LAST_STEPS),
            _ => left(step, self.steps),
        };
        let warm = (step + 1) as f32 / (self.steps / 3).clamp(1, WARM_UP) as f32;
        ADAM_STEP * warm.min(1.0) * left.max(0.0)
    }
}

/// [`StepRule::Adam`] at one of its steps.
pub(super) struct Adam {
    momentum: f32,
    length: f32,
    /// What the means lack, since they begin with nothing.
    corrections: [f32; 2],
}

impl Adam {
    /// Its step after `steps`.
    pub(super) fn new(momentum: f32, steps: u32, schedule: Schedule) -> Self {
        let whole = |share: f32| 1.0 - share.powf(steps as f32 + 1.0);
        Self { momentum, length: schedule.length(steps), corrections: [whole(momentum), whole(SQUARES)] }
    }

    /// The root mean square after a derivative.
    pub(super) fn root_mean_square(&self, before: f32, derivative: f32) -> f32 {
        (SQUARES * before * before + (1.0 - SQUARES) * derivative * derivative).sqrt()
    }

    /// The step by a derivative, given the root mean squares before and after it as they are kept, and the mean, which
    /// is kept over its root mean square.
    pub(super) fn step(&self, mean: &mut i16, before: f32, after: f32, derivative: f32) -> f32 {
        let unit = MOVE / LONGEST;
        let last = f32::from(*mean) / unit * before;
        let next = self.momentum * last + (1.0 - self.momentum) * derivative;
        let over = (next / after.max(f32::MIN_POSITIVE)).clamp(-LONGEST, LONGEST);
        *mean = (over * unit).round() as i16;
        let [first, second] = self.corrections;
        -self.length * over / first * second.sqrt()
    }
}

/// The length of the next step by [`StepRule::BarzilaiBorwein`]: over the bound D, with s the last move and y what it did
/// to the derivative, (s D s) / (s y). Where y says nothing, 1: what the bound calls safe.
pub(super) fn barzilai_borwein(state: &DescentState, gradient: &[f32], cells: Cells) -> f32 {
    let row = cells.row();
    let rows = state.moves.par_chunks_exact(row).zip(state.curvatures.par_chunks_exact(row));
    let derivatives = gradient.par_chunks_exact(row).zip(state.last_gradient.par_chunks_exact(row));
    let sums: Vec<[f64; 2]> = rows
        .zip(derivatives)
        .map(|((moves, kept), (now, last))| {
            let mut sums = [0.0; 2];
            for k in 0..row {
                let s = f32::from(moves[k]) / MOVE;
                sums[0] += f64::from(s * s * DescentState::curvature(state.most_curvature, kept[k]));
                sums[1] += f64::from(s * (now[k] - last[k]));
            }
            sums
        })
        .collect();
    let [over, under] = sums.iter().fold([0.0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let length = if over > 0.0 && under > 0.0 { (over / under) as f32 } else { 1.0 };
    length.clamp(patches::LEAST, patches::FIRST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adam_steps_as_its_paper_says() {
        let derivatives = [0.3f64, -0.2, 0.25, 0.4, 0.1, -0.05, 0.3, 0.2];
        let (mut m, mut v, mut mean, mut root) = (0.0f64, 0.0f64, 0i16, 0.0f32);
        for (t, g) in derivatives.into_iter().enumerate() {
            (m, v) = (0.9 * m + 0.1 * g, 0.99 * v + 0.01 * g * g);
            let power = t as i32 + 1;
            let (m_hat, v_hat) = (m / (1.0 - 0.9f64.powi(power)), v / (1.0 - 0.99f64.powi(power)));
            let schedule = Schedule::new(20, None);
            let adam = Adam::new(0.9, t as u32, schedule);
            let after = adam.root_mean_square(root, g as f32);
            let step = adam.step(&mut mean, root, after, g as f32);
            root = after;
            let wanted = -f64::from(schedule.length(t as u32)) * m_hat / v_hat.sqrt();
            assert!((f64::from(step) - wanted).abs() < 1e-4, "{t}: {step} {wanted}");
        }
    }

    #[test]
    fn steps_grow_then_shrink_to_nothing() {
        let all = Schedule::new(12, None);
        let lengths: Vec<f32> = (0..12).map(|step| all.length(step)).collect();
        assert!(lengths[..4].is_sorted() && lengths[3..].is_sorted_by(|a, b| a > b), "{lengths:?}");
        assert!(lengths.iter().all(|l| (0.0..=ADAM_STEP).contains(l)) && lengths[11] < 0.02, "{lengths:?}");
        assert!(!all.is_over(11));
    }

    #[test]
    fn steps_end_soon_after_the_loss_has_settled() {
        let [all, early] = [None, Some(10)].map(|settled| Schedule::new(40, settled));
        assert!((0..=10).all(|step| early.length(step) == all.length(step)));
        assert!(early.length(11) < all.length(11) && early.length(16) < 0.15 * early.length(10));
        assert!(!early.is_over(15) && early.is_over(16));
    }
}
