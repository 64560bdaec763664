//! Descent along true derivatives: which inks, where, are to blame for what is seen.

mod cells;
mod loss;
mod noise;
mod patches;
mod rule;
mod state;
mod step;

use pellucid_core::{Control, Domain, random};
use pellucid_predict::{Draw, Pass};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::low_pass::{LOCAL_MM, LowPass};
use crate::settings::check_ranges;
use crate::{Moved, Planned, RefineError, Seen, Setup, Strategy, SurfaceFirst, SurfaceSmoother};
use cells::CellGradient;
use loss::{Found, Scale, Weights};
use patches::Patches;
pub use rule::StepRule;
pub use state::DescentState;
use state::{CellMixtures, Cells};

/// Standard deviation in mm of the finer Gaussian that the print is looked at through, and that derivatives are smoothed
/// by over the surface.
const FINE_MM: f64 = 0.045;
/// How much it counts beside [`RefineSettings::residual_blur_mm`](crate::RefineSettings::residual_blur_mm)'s.
const FINE_WEIGHT: f32 = 0.25;
/// The refinement has settled when the mean loss of the last steps lies by less than this part below that of as many
/// before them.
const SETTLED: f64 = 0.01;
const LOOK_BACK: usize = 6;
/// One surface voxel in so many is asked for the bound of the curvature, which is smooth.
const CURVATURE_EVERY: u64 = 4;
/// Of a surface of fewer, all are asked: chance might leave out whole parts of it.
const CURVATURE_ALL: usize = 4096;
const CHOICE: Domain = Domain::new("refine: points of the curvature");

/// Gradient descent on a perceptual loss, with the halftone inside the loop: the derivative at the labels is taken for
/// the one at the mixtures that they were drawn from. The paper of the method (Rittig et al. 2021, section 6) names
/// derivatives of the forward model as future work.
///
/// A few steps of [`SurfaceFirst`] open. Then the state is one mixture a cell (surface voxel and layer), moved by
/// momentum and a step in proportion to the one that a separable quadratic bound of the loss makes safe (De Pierro 1995),
/// scaled patch by patch of the surface by whether the last step lowered the loss there. Where much of the loss is the
/// prediction's noise, as on bright objects with long paths, more paths are traced. The predictor must have a gradient.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Descent {
    /// The heuristic that opens.
    pub opening: SurfaceFirst,
    /// Its steps, 0 to 100.
    pub opening_steps: u32,
    /// How far steps go.
    pub rule: StepRule,
    /// Share of the last step that the next one keeps, 0 to below 1.
    pub momentum: f32,
    /// How far differences of saturated colours are forgiven: 0 not at all, 1 as much as CIEDE2000 does.
    pub forgiveness: f32,
    /// How many times more a squared difference of lightness counts as far as its mean over a millimetre of surface
    /// leaves it out, 0 to 10: local contrast, against a mean that is met.
    pub contrast: f32,
}

impl Default for Descent {
    fn default() -> Self {
        Self {
            opening: SurfaceFirst::default(),
            opening_steps: 5,
            rule: StepRule::Bound,
            momentum: 0.9,
            forgiveness: 0.5,
            contrast: 2.0,
        }
    }
}

/// What every step of a descent uses.
pub struct DescentTools {
    patches: Patches,
    fine: SurfaceSmoother,
    /// Makes the means that local contrast leaves out.
    low_pass: LowPass,
    /// Through the refinement's own Gaussian and through `fine`.
    scales: [Scale; 2],
}

impl Strategy for Descent {
    type State = DescentState;
    type Tools = DescentTools;

    fn name(&self) -> &str {
        "descent"
    }

    fn settings(&self) -> Vec<(&'static str, f64)> {
        let mut all = self.opening.settings();
        all.push(("opening_steps", self.opening_steps.into()));
        all.push(("rule", f64::from(self.rule as u8)));
        all.push(("momentum", self.momentum.into()));
        all.push(("forgiveness", self.forgiveness.into()));
        all.push(("contrast", self.contrast.into()));
        all
    }

    /// Its opening's among them.
    fn iterations(&self) -> u32 {
        40
    }

    fn check(&self) -> Result<(), RefineError> {
        self.opening.check()?;
        check_ranges(&[
            ("opening_steps", self.opening_steps <= 100, "0 to 100"),
            ("momentum", (0.0..1.0).contains(&self.momentum), "0 to below 1"),
            ("forgiveness", (0.0..=1.0).contains(&self.forgiveness), "0 to 1"),
            ("contrast", (0.0..=10.0).contains(&self.contrast), "0 to 10"),
        ])
    }

    fn start(&self, setup: &Setup<'_>) -> DescentState {
        DescentState { opening: Some(self.opening.start(setup)), ..DescentState::default() }
    }

    fn check_state(&self, setup: &Setup<'_>, state: &DescentState) -> Result<(), RefineError> {
        match &state.opening {
            Some(opening) => self.opening.check_state(setup, opening),
            None => state.check(setup),
        }
    }

    fn mixtures<'s>(
        &'s self,
        setup: &'s Setup<'_>,
        state: &'s DescentState,
        control: &Control<'_>,
    ) -> Result<Planned<'s>, RefineError> {
        match &state.opening {
            Some(opening) => self.opening.mixtures(setup, opening, control),
            None => Ok(Planned {
                mixtures: Box::new(CellMixtures::new(setup, &state.inks)),
                overflow: Vec::new(),
            }),
        }
    }

    fn tools(
        &self,
        setup: &Setup<'_>,
        smoother: &SurfaceSmoother,
        control: &Control<'_>,
    ) -> Result<DescentTools, RefineError> {
        let surface = setup.problem.object.surface();
        let fine = SurfaceSmoother::new(surface, FINE_MM, control)?;
        let weights = Weights { forgiveness: self.forgiveness, contrast: self.contrast };
        let low_pass = LowPass::new(surface, LOCAL_MM, control)?;
        let scale = |smoother: &SurfaceSmoother, weight| {
            Scale::new(smoother, setup.problem.printable_target, weight, weights, control)
        };
        let scales = [scale(smoother, 1.0)?, scale(&fine, FINE_WEIGHT)?];
        Ok(DescentTools { patches: Patches::new(surface), fine, low_pass, scales })
    }

    fn effort(&self, state: &DescentState) -> u32 {
        state.effort()
    }

    fn update(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        state: &mut DescentState,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<Moved, RefineError> {
        if let Some(opening) = &mut state.opening
            && opening.step < self.opening_steps
        {
            return self.opening.update(setup, &(), opening, seen, control);
        }
        if let Some(opening) = state.opening.take() {
            let (mixtures, _) = self.opening.layer_mixtures(setup, &opening, control)?;
            *state = DescentState::from_mixtures(setup, mixtures);
        }
        self.descend(setup, tools, state, seen, control)
    }
}

impl Descent {
    fn descend(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        state: &mut DescentState,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<Moved, RefineError> {
        let reach = reach(setup, seen.shown);
        let found = tools.loss(seen, &reach, control)?;
        tools.patches.judge(&mut state.patches, &found.loss);
        let total = found.loss.iter().map(|&l| f64::from(l)).sum::<f64>() / found.loss.len().max(1) as f64;
        state.losses.push(total);
        let noise = match state.asks_for_noise() {
            true => Some(tools.noise(setup, seen, control)?),
            false => None,
        };
        if let Some(noise) = noise {
            state.take_noise(total, noise);
        }

        let draw = Draw::new(seen.draw.seed, Pass::Gradient(seen.iteration));
        if state.steps == 0 && self.rule != StepRule::Adam {
            let by_inks = self.curvature(setup, tools, seen, draw, &found.curvature, control)?;
            let expected = found.curvature.iter().zip(&reach).map(|(w, s)| dot(w, s)).sum();
            state.take_curvature(setup, &by_inks, expected);
        }
        let gradient = pull(setup, seen, draw, &setup.points, &found.gradient, control)?;
        let moved = step::take(self, Cells::of(setup), state, tools, gradient, control)?;
        state.steps += 1;
        Ok(Moved { loss: Some(total), noise, step: Some(moved), settled: settled(&state.losses) })
    }

    /// Bounds of the curvature by inks, but for a factor, from some of the points.
    fn curvature(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        seen: &Seen<'_>,
        draw: Draw,
        d_shown: &[[f32; 3]],
        control: &Control<'_>,
    ) -> Result<Vec<f32>, RefineError> {
        let every = if setup.points.len() < CURVATURE_ALL { 1 } else { CURVATURE_EVERY };
        // Chosen by chance: every fourth in a row would see one phase of a pattern.
        let chosen = |p: &u32| random::hash(setup.seed, CHOICE, u64::from(*p), 0).is_multiple_of(every);
        let points: Vec<u32> = setup.points.iter().copied().filter(chosen).collect();
        let each = points.iter().map(|&p| d_shown[p as usize].map(|d| d * every as f32));
        let d_shown: Vec<[f32; 3]> = each.collect();
        let mut by_inks = pull(setup, seen, draw, &points, &d_shown, control)?;
        step::smooth(Cells::of(setup), &mut by_inks, &tools.fine, control)?;
        Ok(by_inks)
    }
}

impl DescentTools {
    /// The loss, its gradient, and the weights of its curvature, by shown colours.
    fn loss(&self, seen: &Seen<'_>, reach: &[[f32; 3]], control: &Control<'_>) -> Result<Found, RefineError> {
        let count = seen.shown.len();
        let mut found = Found {
            loss: vec![0.0; count],
            gradient: vec![[0.0; 3]; count],
            curvature: vec![[0.0; 3]; count],
        };
        for (scale, smoother) in self.scales.iter().zip([seen.smoother, &self.fine]) {
            scale.add(smoother, &self.low_pass, seen.shown, reach, &mut found, control)?;
        }
        Ok(found)
    }
}

/// Derivatives by inks in place of white, `[point][layer][ink]`, given those by the colours that some points show.
fn pull(
    setup: &Setup<'_>,
    seen: &Seen<'_>,
    draw: Draw,
    points: &[u32],
    d_shown: &[[f32; 3]],
    control: &Control<'_>,
) -> Result<Vec<f32>, RefineError> {
    let viewing = setup.problem.viewing;
    let mut d_radiance = vec![0.0; points.len() * viewing.channels()];
    let rows = d_radiance.par_chunks_exact_mut(viewing.channels());
    rows.zip(d_shown).for_each(|(d_radiance, &d)| viewing.pullback(d, d_radiance));
    let mut cells = CellGradient::new(setup);
    seen.bound
        .pullback(points, draw, &d_radiance, &mut cells, control)
        .map_err(|e| RefineError::predict(seen.iteration, e))?;
    Ok(cells.by_inks())
}

/// How far each shown colour would go, up to a factor, if every ink took its whole range: as of a thick layer by
/// Kubelka and Munk, whose reflectance R changes by 2 R² / (1 - R²) with absorption over scattering.
fn reach(setup: &Setup<'_>, shown: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let white = setup.problem.viewing.media_white();
    let each = shown.par_iter().map(|shown| {
        std::array::from_fn(|c| {
            let reflectance = (shown[c] * white[c]).clamp(0.02, 0.93);
            2.0 * reflectance * reflectance / (1.0 - reflectance * reflectance) / white[c]
        })
    });
    each.collect()
}

fn dot(a: &[f32; 3], b: &[f32; 3]) -> f64 {
    (0..3).map(|c| f64::from(a[c] * b[c])).sum()
}

/// True when the last steps hardly lowered the loss.
fn settled(losses: &[f64]) -> bool {
    let Some(before) = losses.len().checked_sub(2 * LOOK_BACK) else { return false };
    let sum = |losses: &[f64]| losses.iter().sum::<f64>();
    let (earlier, later) = losses[before..].split_at(LOOK_BACK);
    sum(later) > (1.0 - SETTLED) * sum(earlier)
}
