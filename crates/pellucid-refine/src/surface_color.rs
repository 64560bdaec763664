//! Compensation by the surface's colours alone, for printers that mix inks by themselves.

use pellucid_core::Control;
use pellucid_halftone::Thresholds;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::problem::MAX_LABELS;
use crate::residual::{self, decode, encode};
use crate::settings::check_ranges;
use crate::{LayerMixtures, Moved, Planned, RefineError, Seen, Setup, Strategy, SurfaceSmoother};

/// Moves the colour of each surface voxel, which the printer turns into one mixture from the surface through the
/// coloured depth, as printers of textured models do.
///
/// The state is a residual a surface voxel, in cube roots of linear RGB, on top of the texture's colour. What the
/// printer's gamut refuses is forgotten. Iteration 0 is the print of the texture as it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SurfaceColor {
    /// Share of the shortfall added to the residual in the first step, above 0 and at most 4.
    pub gain: f32,
    /// Step i takes `gain / (1 + gain_decay i)`; 0 to 100.
    pub gain_decay: f32,
}

impl Default for SurfaceColor {
    fn default() -> Self {
        Self { gain: 1.0, gain_decay: 0.1 }
    }
}

/// Accumulated residuals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceColorState {
    /// Steps taken.
    pub step: u32,
    /// One value a surface voxel, in cube roots of linear RGB.
    #[serde(with = "crate::packed")]
    pub residual: Vec<[f32; 3]>,
}

impl SurfaceColor {
    /// The colours that a state asks of the printer, all printable: linear RGB relative to the print's white, one a
    /// surface voxel.
    pub fn colors(setup: &Setup<'_>, state: &SurfaceColorState) -> Vec<[f32; 3]> {
        let labels = setup.problem.ink.labels().len();
        let points = state.residual.par_iter().zip(setup.problem.target);
        points
            .map(|(residual, &target)| {
                let mut fractions = [0.0; MAX_LABELS];
                setup.problem.ink.fractions(wanted(target, *residual), &mut fractions[..labels])
            })
            .collect()
    }
}

/// A colour that a texture can hold.
fn wanted(target: [f32; 3], residual: [f32; 3]) -> [f32; 3] {
    let base = encode(target);
    decode(std::array::from_fn(|c| (base[c] + residual[c]).clamp(0.0, 1.0)))
}

impl Strategy for SurfaceColor {
    type State = SurfaceColorState;
    type Tools = ();
    type Step = SurfaceColorState;

    fn name(&self) -> &str {
        "surface_color"
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        vec![("gain", f64::from(self.gain)), ("gain_decay", f64::from(self.gain_decay))]
    }

    fn iterations(&self) -> u32 {
        10
    }

    fn check(&self) -> Result<(), RefineError> {
        check_ranges(&[
            ("gain", self.gain > 0.0 && self.gain <= 4.0, "above 0 and at most 4"),
            ("gain_decay", (0.0..=100.0).contains(&self.gain_decay), "0 to 100"),
        ])
    }

    fn start(&self, setup: &Setup<'_>) -> SurfaceColorState {
        SurfaceColorState { step: 0, residual: vec![[0.0; 3]; setup.points.len()] }
    }

    fn check_state(&self, setup: &Setup<'_>, state: &SurfaceColorState) -> Result<(), RefineError> {
        residual::check(setup, &state.residual)
    }

    fn mixtures<'s>(
        &'s self,
        setup: &'s Setup<'_>,
        state: &'s SurfaceColorState,
        control: &Control<'_>,
    ) -> Result<Planned<'s>, RefineError> {
        let ink = setup.problem.ink;
        let labels = ink.labels().len();
        let (mixtures, overflow) = LayerMixtures::fill(setup, control, |point, rows| {
            let (target, residual) = (setup.problem.target[point as usize], state.residual[point as usize]);
            let mut fractions = [0.0; MAX_LABELS];
            let got = encode(ink.fractions(wanted(target, residual), &mut fractions[..labels]));
            for row in rows.chunks_exact_mut(labels - 1) {
                Thresholds::write(&fractions[..labels], row);
            }
            let base = encode(target);
            std::array::from_fn(|c| base[c] + residual[c] - got[c])
        })?;
        Ok(Planned { mixtures: Box::new(mixtures), overflow })
    }

    fn tools(&self, _: &Setup<'_>, _: &SurfaceSmoother, _: &Control<'_>) -> Result<(), RefineError> {
        Ok(())
    }

    fn plan(
        &self,
        setup: &Setup<'_>,
        (): &(),
        state: &SurfaceColorState,
        seen: &Seen<'_>,
        _: &Control<'_>,
    ) -> Result<SurfaceColorState, RefineError> {
        let gain = self.gain / (1.0 + self.gain_decay * state.step as f32);
        let residual = residual::advanced(&state.residual, setup, seen, gain);
        Ok(SurfaceColorState { step: state.step + 1, residual })
    }

    fn take(&self, _: &Setup<'_>, (): &(), state: &mut SurfaceColorState, step: SurfaceColorState) -> Moved {
        *state = step;
        Moved::default()
    }
}
