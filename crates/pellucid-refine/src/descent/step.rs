//! One step of all cells.

use pellucid_core::{Cancelled, Control};
use rayon::prelude::*;

use super::patches::Patches;
use super::rule::{Adam, Schedule, StepRule, barzilai_borwein};
use super::state::{Cells, DescentState, MOVE, WHOLE};
use super::{Descent, DescentTools};
use crate::SurfaceSmoother;
use crate::problem::MAX_LABELS;

/// Inks that are smoothed together.
const TOGETHER: usize = 4;
/// Steps by the bound after which lengths are half of the first: what is left is smaller, and noise averages out.
const DECAY: f32 = 20.0;
/// The most that a share changes in a step.
const MOST: f32 = 0.25;

/// Moves every cell against smooth derivatives; returns the mean change of a share.
pub(super) fn take(
    descent: &Descent,
    cells: Cells,
    state: &mut DescentState,
    tools: &DescentTools,
    schedule: Schedule,
    gradient: Vec<f32>,
) -> f64 {
    let by = By::of(descent, tools, state, schedule, &gradient, cells);
    let row = cells.row();
    let most = state.most_curvature;
    let known = &state.patches;
    let shorter = 1.0 + state.steps as f32 / DECAY;
    let moved: Vec<f64> = state
        .inks
        .par_chunks_exact_mut(row)
        .zip(state.moves.par_chunks_exact_mut(row))
        .zip(state.curvatures.par_chunks_exact_mut(row).zip(gradient.par_chunks_exact(row)))
        .enumerate()
        .map(|(point, ((inks, moves), (kept, gradient)))| {
            let (length, momentum) = match by {
                By::Patches(patches) => {
                    let patch = known[patches.of(point)];
                    (patch.length / shorter, if patch.rose { 0.0 } else { descent.momentum })
                }
                By::One(length) => (length, 0.0),
                By::Adam(_) => (1.0, 0.0),
            };
            let mut total = 0.0;
            for layer in 0..cells.layers {
                let at = layer * cells.inks..(layer + 1) * cells.inks;
                let mut wanted = [0.0; MAX_LABELS];
                let (own, last) = (&mut inks[at.clone()], &mut moves[at.clone()]);
                for (i, k) in at.enumerate() {
                    let step = match &by {
                        By::Adam(adam) => {
                            let before = DescentState::curvature(most, kept[k]);
                            kept[k] = DescentState::level(most, adam.root_mean_square(before, gradient[k]));
                            let after = DescentState::curvature(most, kept[k]);
                            length * adam.step(&mut last[i], before, after, gradient[k])
                        }
                        _ => {
                            let curvature = DescentState::curvature(most, kept[k]).max(f32::MIN_POSITIVE);
                            momentum * f32::from(last[i]) / MOVE - length * gradient[k] / curvature
                        }
                    };
                    wanted[i] = f32::from(own[i]) / WHOLE + step.clamp(-MOST, MOST);
                }
                project(&mut wanted[..cells.inks]);
                for (i, share) in own.iter_mut().enumerate() {
                    let before = f32::from(*share) / WHOLE;
                    // Down, so that shares never add up to more than the whole.
                    *share = (wanted[i] * WHOLE) as u16;
                    if !matches!(by, By::Adam(_)) {
                        last[i] = ((wanted[i] - before) * MOVE).round() as i16;
                    }
                    total += f64::from((wanted[i] - before).abs());
                }
            }
            total
        })
        .collect();
    if descent.rule == StepRule::BarzilaiBorwein {
        state.last_gradient = gradient;
    }
    moved.iter().sum::<f64>() / (moved.len() * row).max(1) as f64
}

/// What decides a step's length.
enum By<'t> {
    /// Each patch's own, over the bound.
    Patches(&'t Patches),
    /// One for all, over the bound.
    One(f32),
    Adam(Adam),
}

impl<'t> By<'t> {
    fn of(
        descent: &Descent,
        tools: &'t DescentTools,
        state: &mut DescentState,
        schedule: Schedule,
        gradient: &[f32],
        cells: Cells,
    ) -> Self {
        match (&tools.patches, descent.rule) {
            (Some(patches), _) => Self::Patches(patches),
            (None, StepRule::BarzilaiBorwein) => Self::One(barzilai_borwein(state, gradient, cells)),
            (None, _) => {
                if state.steps == 0 {
                    // Root mean squares take the curvatures' place, and begin at next to nothing.
                    state.most_curvature =
                        gradient.iter().fold(f32::MIN_POSITIVE, |most, d| most.max(d.abs()));
                    state.curvatures = vec![u8::MAX; gradient.len()];
                }
                Self::Adam(Adam::new(descent.momentum, state.steps, schedule))
            }
        }
    }
}

/// Smooths derivatives over the surface, layer by layer.
pub(super) fn smooth(
    cells: Cells,
    gradient: &mut [f32],
    smoother: &SurfaceSmoother,
    control: &Control<'_>,
) -> Result<(), Cancelled> {
    let row = cells.row();
    for layer in 0..cells.layers {
        for first in (0..cells.inks).step_by(TOGETHER) {
            let count = TOGETHER.min(cells.inks - first);
            let start = layer * cells.inks + first;
            let values = gradient.par_chunks_exact(row);
            let values = values.map(|row| {
                let mut some = [0.0; TOGETHER];
                some[..count].copy_from_slice(&row[start..start + count]);
                some
            });
            let values = smoother.transposed::<TOGETHER>(values.collect(), control)?;
            let rows = gradient.par_chunks_exact_mut(row).zip(values);
            rows.for_each(|(row, values)| row[start..start + count].copy_from_slice(&values[..count]));
        }
    }
    Ok(())
}

/// The nearest shares that are none below 0 and together at most 1 (Duchi et al. 2008).
fn project(shares: &mut [f32]) {
    let clipped: f32 = shares.iter().map(|s| s.max(0.0)).sum();
    if clipped <= 1.0 {
        shares.iter_mut().for_each(|s| *s = s.max(0.0));
        return;
    }
    let mut sorted = [0.0; MAX_LABELS];
    let sorted = &mut sorted[..shares.len()];
    sorted.copy_from_slice(shares);
    sorted.sort_by(|a, b| b.total_cmp(a));
    let (mut sum, mut less) = (0.0, 0.0);
    for (i, &s) in sorted.iter().enumerate() {
        sum += s;
        let candidate = (sum - 1.0) / (i + 1) as f32;
        if s > candidate {
            less = candidate;
        }
    }
    shares.iter_mut().for_each(|s| *s = (*s - less).max(0.0));
    let sum: f32 = shares.iter().sum();
    if sum > 1.0 {
        shares.iter_mut().for_each(|s| *s /= sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn projection_is_the_nearest_mixture(
            shares in prop::collection::vec(-1.0f32..2.0, 4), others in prop::collection::vec(0.0f32..1.0, 4),
        ) {
            let mut found = shares.clone();
            project(&mut found);
            prop_assert!(found.iter().all(|&s| s >= 0.0) && found.iter().sum::<f32>() < 1.0 + 1e-5);
            let whole = others.iter().sum::<f32>().max(1.0);
            let away = |to: &[f32]| -> f32 { to.iter().zip(&shares).map(|(a, b)| (a - b).powi(2)).sum() };
            let other: Vec<f32> = others.iter().map(|o| o / whole).collect();
            prop_assert!(away(&found) <= away(&other) + 1e-4, "{found:?} {other:?}");
        }
    }
}
