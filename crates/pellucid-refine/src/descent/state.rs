//! What descent keeps: a mixture a cell, how it last moved, and what is known of patches.

use pellucid_halftone::Thresholds;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::noise::MOST_DOUBLINGS;
use super::patches::Patch;
use crate::problem::MAX_LABELS;
use crate::{Cell, LayerMixtures, Mixtures, RefineError, Setup, SurfaceFirstState};

/// A share of 1 as it is kept.
pub(super) const WHOLE: f32 = 65535.0;
/// A move of 1 as it is kept.
pub(super) const MOVE: f32 = 32767.0;
/// Curvatures are kept as logarithms, so many levels to a factor of two.
const LEVELS: f32 = 8.0;

/// State of [`Descent`](super::Descent).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DescentState {
    /// The heuristic's state while it opens.
    pub(super) opening: Option<SurfaceFirstState>,
    /// Steps of descent taken.
    pub(super) steps: u32,
    /// Shares of the inks, `[point][layer][ink]`; white is the rest.
    #[serde(with = "crate::packed::words")]
    pub(super) inks: Vec<u16>,
    /// Their last moves.
    #[serde(with = "crate::packed::moves")]
    pub(super) moves: Vec<i16>,
    /// Bounds of the loss's curvature, or root mean squares of the derivatives, as logarithms below `most_curvature`.
    #[serde(with = "crate::packed::bytes")]
    pub(super) curvatures: Vec<u8>,
    /// The greatest bound.
    pub(super) most_curvature: f32,
    pub(super) patches: Vec<Patch>,
    /// 1 where the last iterate lacked chroma, `[viewing][scale][point]`; empty before the first.
    #[serde(with = "crate::packed::bytes")]
    pub(super) lacks: Vec<u8>,
    /// The last derivatives, where the rule needs them.
    #[serde(with = "crate::packed::floats")]
    pub(super) last_gradient: Vec<f32>,
    /// The steps taken when the loss no longer fell.
    pub(super) settled: Option<u32>,
    /// The loss of each iterate of descent since paths were last doubled because of noise, and of some before steps became
    /// fine.
    pub(super) losses: Vec<f64>,
    /// The steps taken before they became fine.
    pub(super) fine: Option<u32>,
    /// How often the paths of predictions were doubled.
    pub(super) doublings: u8,
    /// What of the loss was noise when last measured.
    pub(super) noise: Option<f64>,
}

/// The layout of cells.
#[derive(Clone, Copy)]
pub(super) struct Cells {
    pub layers: usize,
    pub inks: usize,
}

impl Cells {
    pub(super) fn of(setup: &Setup<'_>) -> Self {
        Self { layers: setup.layers.count(), inks: setup.problem.ink.labels().len() - 1 }
    }

    /// Values of a surface voxel.
    pub(super) fn row(self) -> usize {
        self.layers * self.inks
    }
}

impl DescentState {
    /// The state whose cells have some mixtures.
    pub(super) fn from_mixtures(setup: &Setup<'_>, mixtures: LayerMixtures) -> Self {
        let mut inks = mixtures.into_rows();
        let cells = Cells::of(setup);
        inks.par_chunks_exact_mut(cells.inks).for_each(|shares| {
            (1..shares.len()).rev().for_each(|i| shares[i] -= shares[i - 1]);
        });
        let moves = vec![0; inks.len()];
        Self { inks, moves, ..Self::default() }
    }

    /// Checks what mixtures follow from.
    pub(super) fn check_shares(&self, setup: &Setup<'_>) -> Result<(), RefineError> {
        let cells = Cells::of(setup);
        let invalid = |reason: &str| Err(RefineError::invalid("checkpoint", reason));
        if self.inks.len() != setup.points.len() * cells.row() {
            return invalid("has not the cells of this object");
        }
        let whole = |shares: &[u16]| shares.iter().map(|&s| u32::from(s)).sum::<u32>() <= WHOLE as u32;
        if !self.inks.chunks_exact(cells.inks).all(whole) {
            return invalid("has a mixture of more than its whole");
        }
        Ok(())
    }

    pub(super) fn check(&self, setup: &Setup<'_>) -> Result<(), RefineError> {
        self.check_shares(setup)?;
        let values = setup.points.len() * Cells::of(setup).row();
        let invalid = |reason: &str| Err(RefineError::invalid("checkpoint", reason));
        if self.moves.len() != values {
            return invalid("has not the moves of this object's cells");
        }
        if self.curvatures.len() != values {
            return invalid("lacks curvatures");
        }
        if self.steps > setup.iterations
            || [self.settled, self.fine].iter().flatten().any(|&step| step > self.steps)
        {
            return invalid("has taken more steps than there are");
        }
        let lacks = 2 * setup.problem.aims().count() * setup.points.len();
        if ![0, lacks].contains(&self.lacks.len()) {
            return invalid("does not say of every surface voxel whether chroma is missing");
        }
        if self.doublings > MOST_DOUBLINGS {
            return invalid("has more paths than it may");
        }
        if ![0, values].contains(&self.last_gradient.len())
            || !self.last_gradient.iter().all(|d| d.is_finite())
        {
            return invalid("has not the derivatives of this object");
        }
        let finite = self.most_curvature.is_finite()
            && self.losses.iter().chain(&self.noise).all(|l| l.is_finite())
            && self.patches.iter().all(|p| p.length.is_finite() && p.loss.is_finite());
        if finite { Ok(()) } else { invalid("a value is not finite") }
    }

    /// Takes derivatives by inks, `[point][layer][ink]`, as bounds of the curvature: their sum is known to be
    /// `expected` but for a common factor, which is set right.
    pub(super) fn take_curvature(&mut self, setup: &Setup<'_>, by_inks: &[f32], expected: f64) {
        let sum: f64 = by_inks.iter().map(|&d| f64::from(d.abs())).sum();
        let factor = if expected > 0.0 { (sum / expected) as f32 } else { 1.0 };
        let most = by_inks.iter().fold(0.0f32, |most, d| most.max(d.abs()));
        let row = Cells::of(setup).row();
        self.most_curvature = factor * most;
        self.curvatures.resize(by_inks.len(), 0);
        self.curvatures.par_chunks_exact_mut(row).zip(by_inks.par_chunks_exact(row)).for_each(
            |(kept, row)| {
                // Where next to no light goes, steps would follow noise.
                let least = 0.1 * row.iter().fold(0.0f32, |most, d| most.max(d.abs()));
                for (kept, d) in kept.iter_mut().zip(row) {
                    *kept = Self::level(most, d.abs().max(least));
                }
            },
        );
    }

    /// How a value up to `most` is kept.
    pub(super) fn level(most: f32, value: f32) -> u8 {
        let below = (most / value.max(f32::MIN_POSITIVE)).log2();
        (LEVELS * below).round().clamp(0.0, 255.0) as u8
    }

    /// The bound of the curvature by a cell's ink.
    pub(super) fn curvature(most: f32, kept: u8) -> f32 {
        most * (-f32::from(kept) / LEVELS).exp2()
    }
}

/// Mixtures of cells.
pub(super) struct CellMixtures<'a> {
    cells: Cells,
    inks: &'a [u16],
}

impl<'a> CellMixtures<'a> {
    pub(super) fn new(setup: &Setup<'_>, inks: &'a [u16]) -> Self {
        Self { cells: Cells::of(setup), inks }
    }
}

impl Mixtures for CellMixtures<'_> {
    fn thresholds<'r>(&'r self, cell: &Cell, scratch: &'r mut [u16]) -> &'r [u16] {
        let start = (cell.point as usize * self.cells.layers + cell.layer as usize) * self.cells.inks;
        let mut fractions = [0.0; MAX_LABELS];
        let mut sum = 0.0;
        for (fraction, &share) in fractions.iter_mut().zip(&self.inks[start..start + self.cells.inks]) {
            *fraction = f32::from(share) / WHOLE;
            sum += *fraction;
        }
        fractions[self.cells.inks] = (1.0 - sum).max(0.0);
        Thresholds::write(&fractions[..=self.cells.inks], scratch);
        scratch
    }
}
