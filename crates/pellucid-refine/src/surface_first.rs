//! The heuristic of Sumin et al. 2019: corrections surface-first, overflow deeper.

use pellucid_core::Control;
use pellucid_halftone::Thresholds;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::problem::MAX_LABELS;
use crate::settings::check_ranges;
use crate::{InkModel, LayerMixtures, Planned, RefineError, Seen, Setup, Strategy};

/// Ink coverage up to which highlight layers stay white, and from which they take all ink.
const HIGHLIGHT_COVER: [f32; 2] = [0.2, 0.6];

/// Geometry-aware scattering compensation as far as published (Sumin et al., ACM TOG 38(4), 2019; Rittig et al. 2021,
/// section 2.3). The state is one accumulated residual a surface voxel. Spent surface-first, it asks the top layer for
/// the printable target plus the residual; what the gamut refuses moves one layer deeper. Iteration 0 is the printable
/// target extruded through the coloured depth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SurfaceFirst {
    /// Share of the shortfall added to the residual in the first step, above 0 and at most 4.
    pub gain: f32,
    /// Step i takes `gain / (1 + gain_decay i)`; 0 to 100.
    pub gain_decay: f32,
    /// Depth in mm, 0 to 100, to which the target's own mixture reaches once refined; below is white.
    pub base_mm: f64,
    /// Depth in mm, 0 to 10, of the highlight layers: there, refined halftones keep sparse ink out of white.
    pub veil_mm: f64,
}

impl Default for SurfaceFirst {
    fn default() -> Self {
        Self { gain: 2.0, gain_decay: 0.1, base_mm: 0.4, veil_mm: 0.2 }
    }
}

/// Accumulated residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceFirstState {
    /// Steps taken; at 0 the whole depth is the target's mixture.
    pub step: u32,
    /// One value a surface voxel, in cube roots of linear RGB.
    #[serde(with = "crate::packed")]
    pub residual: Vec<[f32; 3]>,
}

/// How deep demand spreads at a step.
struct Spread {
    /// Uppermost layers whose base is the target's mixture; that of deeper ones is white.
    base_layers: usize,
    /// Uppermost layers that keep sparse ink out.
    highlight_layers: usize,
}

impl Strategy for SurfaceFirst {
    type State = SurfaceFirstState;

    fn name(&self) -> &str {
        "surface_first"
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        let [gain, decay] = [self.gain, self.gain_decay].map(f64::from);
        vec![("gain", gain), ("gain_decay", decay), ("base_mm", self.base_mm), ("veil_mm", self.veil_mm)]
    }

    fn check(&self) -> Result<(), RefineError> {
        check_ranges(&[
            ("gain", self.gain > 0.0 && self.gain <= 4.0, "above 0 and at most 4"),
            ("gain_decay", (0.0..=100.0).contains(&self.gain_decay), "0 to 100"),
            ("base_mm", (0.0..=100.0).contains(&self.base_mm), "0 to 100 mm"),
            ("veil_mm", (0.0..=10.0).contains(&self.veil_mm), "0 to 10 mm"),
        ])
    }

    fn start(&self, setup: &Setup<'_>) -> SurfaceFirstState {
        SurfaceFirstState { step: 0, residual: vec![[0.0; 3]; setup.points.len()] }
    }

    fn check_state(&self, setup: &Setup<'_>, state: &SurfaceFirstState) -> Result<(), RefineError> {
        let (found, voxels) = (state.residual.len(), setup.points.len());
        if found != voxels {
            return Err(RefineError::invalid(
                "checkpoint",
                format!("{found} residuals for {voxels} surface voxels"),
            ));
        }
        if state.residual.iter().flatten().any(|v| !v.is_finite()) {
            return Err(RefineError::invalid("checkpoint", "a residual is not finite"));
        }
        Ok(())
    }

    fn mixtures<'s>(
        &'s self,
        setup: &'s Setup<'_>,
        state: &'s SurfaceFirstState,
        control: &Control<'_>,
    ) -> Result<Planned<'s>, RefineError> {
        let spread = self.spread(setup, state.step);
        let (mixtures, overflow) = LayerMixtures::fill(setup, control, |point, rows| {
            spread.mixtures(setup, point, state.residual[point as usize], rows)
        })?;
        Ok(Planned { mixtures: Box::new(mixtures), overflow })
    }

    /// Forgets what no layer could take, since a target out of reach must not wind the residual up or it would go on
    /// pushing the colours that can still be reached; then adds the gain's share of the shortfall.
    fn update(
        &self,
        setup: &Setup<'_>,
        state: &mut SurfaceFirstState,
        seen: &Seen<'_>,
        _: &Control<'_>,
    ) -> Result<(), RefineError> {
        let gain = self.gain / (1.0 + self.gain_decay * state.step as f32);
        let seen = seen.smoothed.par_iter().zip(seen.overflow).zip(setup.problem.printable_target);
        state.residual.par_iter_mut().zip(seen).for_each(|(residual, ((&smoothed, overflow), &target))| {
            let (target, smoothed) = (encode(target), encode(smoothed));
            for c in 0..3 {
                let shortfall = target[c] - smoothed[c];
                residual[c] = (residual[c] - overflow[c]) + gain * shortfall;
            }
        });
        state.step += 1;
        Ok(())
    }
}

impl SurfaceFirst {
    fn spread(&self, setup: &Setup<'_>, step: u32) -> Spread {
        let layers = &setup.layers;
        match step {
            0 => Spread { base_layers: layers.count(), highlight_layers: 0 },
            _ => Spread {
                base_layers: layers.above(self.base_mm).max(1),
                highlight_layers: layers.above(self.veil_mm),
            },
        }
    }
}

impl Spread {
    /// Writes the cumulative shares of every layer of a surface voxel, `[layer][label]` without the last label.
    /// Returns what the layers could not take of the residual.
    fn mixtures(&self, setup: &Setup<'_>, point: u32, residual: [f32; 3], rows: &mut [u16]) -> [f32; 3] {
        let ink = setup.problem.ink;
        let labels = ink.labels().len();
        let target = encode(setup.problem.printable_target[point as usize]);
        let available = (u64::BITS - setup.layers.occupied(point).leading_zeros()) as usize;
        let mut overflow = residual;
        let mut fractions = [0.0; MAX_LABELS];
        let fractions = &mut fractions[..labels];
        for (layer, row) in rows.chunks_exact_mut(labels - 1).enumerate().take(available) {
            let base = if layer < self.base_layers { target } else { [1.0; 3] };
            let wanted: [f32; 3] = std::array::from_fn(|c| base[c] + overflow[c]);
            let mut got = ink.fractions(decode(wanted), fractions);
            if layer < self.highlight_layers {
                got = thin_out(ink, fractions).unwrap_or(got);
            }
            let got = encode(got);
            overflow = std::array::from_fn(|c| wanted[c] - got[c]);
            Thresholds::write(fractions, row);
        }
        overflow
    }
}

/// Thins sparse ink out of a mixture for the highlight layers, where a single ink voxel in white is seen as a speck;
/// returns the mixture's new colour if it changed. What is taken away is overflow: the layers below, whose specks
/// scattering has blurred, take it up.
fn thin_out(ink: &dyn InkModel, fractions: &mut [f32]) -> Option<[f32; 3]> {
    let (white, inks) = fractions.split_last_mut()?;
    let covered: f32 = inks.iter().sum();
    if covered >= HIGHLIGHT_COVER[1] || covered <= 0.0 {
        return None;
    }
    let keep = ((covered - HIGHLIGHT_COVER[0]) / (HIGHLIGHT_COVER[1] - HIGHLIGHT_COVER[0])).max(0.0);
    inks.iter_mut().for_each(|f| *f *= keep);
    *white = 1.0 - covered * keep;
    Some(ink.color(fractions))
}

/// Residuals act on cube roots of linear RGB: about equal steps for the eye.
fn encode(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| v.max(0.0).cbrt())
}

fn decode(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| v.max(0.0).powi(3))
}
