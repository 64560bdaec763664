//! The colour demand of each surface voxel and how it spreads into depth.
//!
//! The state is one accumulated residual a surface voxel. Spent surface-first, it asks the top layer for
//! the target plus the residual; what the gamut refuses moves one layer deeper (Sumin et al. 2019).

use rayon::prelude::*;

use crate::InkModel;
use crate::layers::Layers;

/// Ink coverage up to which the uppermost layers stay white, and from which they take all ink.
const VEIL_COVER: [f32; 2] = [0.2, 0.6];
/// Most materials a mixture has.
pub(crate) const MAX_LABELS: usize = 16;

/// Residuals act on cube roots of linear RGB: about equal steps for the eye.
pub(crate) fn encode(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| v.max(0.0).cbrt())
}

fn decode(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| v.max(0.0).powi(3))
}

/// How demand spreads into depth.
pub(crate) struct Plan<'a> {
    pub(crate) layers: &'a Layers,
    /// Layers of each surface voxel that have voxels.
    pub(crate) available: &'a [u8],
    /// Uppermost layers whose base is the target's mixture; that of deeper ones is white.
    pub(crate) based: usize,
    /// Uppermost layers that keep sparse ink out.
    pub(crate) veiled: usize,
}

/// Accumulated residuals.
#[derive(Clone)]
pub(crate) struct Demand {
    target: Vec<[f32; 3]>,
    residual: Vec<[f32; 3]>,
}

impl Demand {
    /// The extruded target: no residual yet. `target` is printable linear RGB relative to the media white.
    pub(crate) fn new(target: &[[f32; 3]]) -> Self {
        Self { target: target.iter().map(|&t| encode(t)).collect(), residual: vec![[0.0; 3]; target.len()] }
    }

    /// What `lack` (linear, the target less the prediction, smoothed) leaves of the targets.
    pub(crate) fn reached(aim: &[[f32; 3]], lack: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let reached = |(t, l): (&[f32; 3], &[f32; 3])| std::array::from_fn(|c| (t[c] - l[c]).max(0.0));
        aim.par_iter().zip(lack).map(reached).collect()
    }

    /// What `reached` (linear, media-relative) lacks of the target, in encoded units.
    pub(crate) fn lack(&self, reached: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let lack = |(t, p): (&[f32; 3], &[f32; 3])| {
            let p = encode(*p);
            std::array::from_fn(|c| t[c] - p[c])
        };
        self.target.par_iter().zip(reached).map(lack).collect()
    }

    /// Adds `gain` times what is lacking to the residual.
    pub(crate) fn add(&mut self, lack: &[[f32; 3]], gain: f32) {
        self.residual.par_iter_mut().zip(lack).for_each(|(residual, lack)| {
            (0..3).for_each(|c| residual[c] += gain * lack[c]);
        });
    }

    /// Forgets what no layer could take: a target out of reach must not wind the residual up, or it would
    /// go on pushing the colours that can still be reached.
    pub(crate) fn settle(&mut self, unspent: &[[f32; 3]]) {
        self.residual.par_iter_mut().zip(unspent).for_each(|(residual, unspent)| {
            (0..3).for_each(|c| residual[c] -= unspent[c]);
        });
    }

    /// Cumulative fractions of every layer of a surface voxel, `[layer][label]` in halftone order without
    /// the last label, as shares of 65535. Returns what the layers could not take of the residual.
    pub(crate) fn thresholds(
        &self,
        point: usize,
        plan: &Plan<'_>,
        ink: &dyn InkModel,
        out: &mut [u16],
    ) -> [f32; 3] {
        let labels = ink.labels().len();
        let target = self.target[point];
        let available = usize::from(plan.available[point]);
        let mut over = self.residual[point];
        let mut fractions = [0.0; MAX_LABELS];
        let fractions = &mut fractions[..labels];
        for (layer, row) in out.chunks_exact_mut(labels - 1).enumerate().take(available) {
            let base = if layer < plan.based { target } else { [1.0; 3] };
            let wanted: [f32; 3] = std::array::from_fn(|c| base[c] + over[c]);
            let mut got = ink.fractions(decode(wanted), fractions);
            if layer < plan.veiled {
                got = veil(ink, fractions).unwrap_or(got);
            }
            let got = encode(got);
            over = std::array::from_fn(|c| wanted[c] - got[c]);
            let mut sum = 0.0;
            for (slot, fraction) in row.iter_mut().zip(fractions.iter()) {
                sum += fraction;
                *slot = (sum * 65535.0).round().clamp(0.0, 65535.0) as u16;
            }
        }
        over
    }
}

/// Thins sparse ink out of a mixture for the uppermost layers, where a single ink voxel in white is seen
/// as a speck; returns the mixture's new colour if it changed. What is taken away is overflow: the layers
/// below, whose specks scattering has blurred, take it up.
fn veil(ink: &dyn InkModel, fractions: &mut [f32]) -> Option<[f32; 3]> {
    let (white, inks) = fractions.split_last_mut()?;
    let covered: f32 = inks.iter().sum();
    if covered >= VEIL_COVER[1] || covered <= 0.0 {
        return None;
    }
    let keep = ((covered - VEIL_COVER[0]) / (VEIL_COVER[1] - VEIL_COVER[0])).max(0.0);
    inks.iter_mut().for_each(|f| *f *= keep);
    *white = 1.0 - covered * keep;
    Some(ink.color(fractions))
}
