//! Colour differences over a surface.

use pellucid_color::DeltaEStats;
use rayon::prelude::*;

use crate::{ErrorStats, InkModel};

impl From<DeltaEStats> for ErrorStats {
    fn from(s: DeltaEStats) -> Self {
        Self { mean: s.mean, median: s.median, p95: s.p95, max: s.max }
    }
}

/// CIEDE2000 between each colour and its target, in order; what is not finite counts as 100.
pub(crate) fn differences(ink: &dyn InkModel, seen: &[[f32; 3]], target: &[[f32; 3]]) -> Vec<f32> {
    seen.par_iter()
        .zip(target)
        .map(|(s, t)| ink.delta_e(*s, *t))
        .map(|d| if d.is_finite() { d } else { 100.0 })
        .collect()
}

/// Statistics of [`differences`].
pub(crate) fn stats(ink: &dyn InkModel, seen: &[[f32; 3]], target: &[[f32; 3]]) -> ErrorStats {
    DeltaEStats::of(&differences(ink, seen, target)).map(ErrorStats::from).unwrap_or_default()
}
