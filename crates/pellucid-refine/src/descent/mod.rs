//! Descent along true derivatives: which inks, where, are to blame for what is seen.

mod aims;
mod cells;
mod loss;
mod noise;
mod patches;
mod rule;
mod state;
mod step;

use pellucid_core::{Control, Domain, random};
use pellucid_predict::{Draw, Pass};
use serde::{Deserialize, Serialize};

use crate::low_pass::{LOCAL_MM, LowPass};
use crate::settings::check_ranges;
use crate::{
    Moved, Planned, RefineError, Seen, Setup, Strategy, SurfaceFirst, SurfaceFirstState, SurfaceSmoother,
};
use aims::{Loss, pull};
use loss::{Scale, Weights};
use patches::{Patch, Patches};
use rule::Schedule;
pub use rule::StepRule;
pub use state::DescentState;
use state::{CellMixtures, Cells};

/// Standard deviation in mm of the finer Gaussian that the print is looked at through, and that derivatives are smoothed
/// by over the surface.
const FINE_MM: f64 = 0.045;
/// How much it counts beside [`RefineSettings::residual_blur_mm`](crate::RefineSettings::residual_blur_mm)'s.
const FINE_WEIGHT: f32 = 0.25;
/// One surface voxel in so many is asked for the bound of the curvature, which is smooth.
const CURVATURE_EVERY: u64 = 4;
/// Of a surface of fewer, all are asked: chance might leave out whole parts of it.
const CURVATURE_ALL: usize = 4096;
const CHOICE: Domain = Domain::new("refine: points of the curvature");

/// Gradient descent on a perceptual loss, with the halftone inside the loop: the derivative at the labels is taken for
/// the one at the mixtures that they were drawn from. The paper of the method (Rittig et al. 2021, section 6) names
/// derivatives of the forward model as future work.
///
/// A few steps of [`SurfaceFirst`] open. Then the state is one mixture a cell (surface voxel and layer), moved against its
/// derivatives by a [`StepRule`]. Where much of the loss is the prediction's noise, as on bright objects with long paths,
/// more paths are traced. The predictor must have a gradient.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Descent {
    /// The heuristic that opens.
    pub opening: SurfaceFirst,
    /// Its steps, 0 to 100.
    pub opening_steps: u32,
    /// How far steps go.
    pub rule: StepRule,
    /// Share of what came before that a step keeps, 0 to below 1: of the last step, or of the mean of derivatives by
    /// [`StepRule::Adam`].
    pub momentum: f32,
    /// How far differences of saturated colours are forgiven: 0 not at all, 1 as much as CIEDE2000 does.
    pub forgiveness: f32,
    /// How many times more a squared difference of lightness counts as far as its mean over a millimetre of surface
    /// leaves it out, 0 to 10: local contrast, against a mean that is met.
    pub contrast: f32,
    /// How many times more a squared difference of chroma counts where the print has less than its aim, 0 to 10. Scattered
    /// light makes colours paler, so that errors of both signs are no fair trade.
    pub chroma: f32,
}

impl Default for Descent {
    fn default() -> Self {
        Self {
            opening: SurfaceFirst::default(),
            opening_steps: 5,
            rule: StepRule::default(),
            momentum: 0.9,
            forgiveness: 0.5,
            contrast: 2.0,
            chroma: 1.0,
        }
    }
}

/// What every step of a descent uses.
pub struct DescentTools {
    /// Where [`StepRule::Bound`] asks for them.
    patches: Option<Patches>,
    fine: SurfaceSmoother,
    /// Makes the means that local contrast leaves out.
    low_pass: LowPass,
    /// By viewing, through the refinement's own Gaussian and through `fine`.
    scales: Vec<[Scale; 2]>,
}

impl Strategy for Descent {
    type State = DescentState;
    type Tools = DescentTools;
    type Step = DescentStep;

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
        all.push(("chroma", self.chroma.into()));
        all
    }

    /// Its opening's among them.
    fn iterations(&self) -> u32 {
        34
    }

    fn check(&self) -> Result<(), RefineError> {
        self.opening.check()?;
        check_ranges(&[
            ("opening_steps", self.opening_steps <= 100, "0 to 100"),
            ("momentum", (0.0..1.0).contains(&self.momentum), "0 to below 1"),
            ("forgiveness", (0.0..=1.0).contains(&self.forgiveness), "0 to 1"),
            ("contrast", (0.0..=10.0).contains(&self.contrast), "0 to 10"),
            ("chroma", (0.0..=10.0).contains(&self.chroma), "0 to 10"),
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

    fn without_history(&self, state: &DescentState) -> DescentState {
        DescentState { opening: state.opening.clone(), inks: state.inks.clone(), ..DescentState::default() }
    }

    fn check_best(&self, setup: &Setup<'_>, state: &DescentState) -> Result<(), RefineError> {
        match &state.opening {
            Some(opening) => self.opening.check_state(setup, opening),
            None => state.check_shares(setup),
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
        let weights = Weights { forgiveness: self.forgiveness, contrast: self.contrast, chroma: self.chroma };
        let low_pass = LowPass::new(surface, LOCAL_MM, control)?;
        let scales = aims::scales(setup, |aim, share| {
            let scale =
                |smoother: &SurfaceSmoother, weight| Scale::new(smoother, aim, weight, weights, control);
            Ok([scale(smoother, share)?, scale(&fine, share * FINE_WEIGHT)?])
        })?;
        let patches = (self.rule == StepRule::Bound).then(|| Patches::new(surface));
        Ok(DescentTools { patches, fine, low_pass, scales })
    }

    fn effort(&self, state: &DescentState) -> u32 {
        state.effort()
    }

    fn plan(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        state: &DescentState,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<DescentStep, RefineError> {
        let Some(opening) = &state.opening else {
            return Ok(DescentStep(Kind::Own(self.plan_own(setup, tools, state, None, seen, control)?)));
        };
        if opening.step < self.opening_steps {
            let next = self.opening.plan(setup, &(), opening, seen, control)?;
            return Ok(DescentStep(Kind::Opening(next)));
        }
        let (mixtures, _) = self.opening.layer_mixtures(setup, opening, control)?;
        let begun = DescentState::from_mixtures(setup, mixtures);
        Ok(DescentStep(Kind::Own(self.plan_own(setup, tools, state, Some(begun), seen, control)?)))
    }

    fn take(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        state: &mut DescentState,
        DescentStep(kind): DescentStep,
    ) -> Moved {
        match kind {
            Kind::Opening(next) => {
                state.opening = Some(next);
                Moved::default()
            }
            Kind::Own(step) => self.take_own(setup, tools, state, step),
        }
    }
}

/// How a state of [`Descent`] is to be moved.
pub struct DescentStep(Kind);

enum Kind {
    /// The next state of the heuristic that opens.
    Opening(SurfaceFirstState),
    Own(OwnStep),
}

/// A step of descent itself.
struct OwnStep {
    /// The state that the first step starts from.
    begun: Option<Box<DescentState>>,
    /// What is known of patches with what was seen, where the rule has them.
    patches: Vec<Patch>,
    /// Where chroma is missing.
    lacks: Vec<u8>,
    /// The mean loss seen, and what of it is noise, where that was measured.
    loss: f64,
    noise: Option<f64>,
    /// By inks, `[point][layer][ink]`, smooth.
    gradient: Vec<f32>,
}

impl Descent {
    /// A step from a state, or from one that is `begun`.
    fn plan_own(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        state: &DescentState,
        begun: Option<DescentState>,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<OwnStep, RefineError> {
        let mut begun = begun.map(Box::new);
        let bounded = begun.is_some() && self.rule != StepRule::Adam;
        let from = begun.as_deref().unwrap_or(state);
        let mut found = tools.loss(setup, seen, &from.lacks, bounded, control)?;
        let mut known = from.patches.clone();
        if let Some(patches) = &tools.patches {
            patches.judge(&mut known, &found.loss);
        }
        let noise = match from.asks_for_noise() {
            true => Some(tools.noise(setup, seen, control)?),
            false => None,
        };
        let draw =
            Draw::new(seen.draw.seed, Pass::Gradient(seen.iteration)).with_effort(from.gradient_effort());
        if let Some(begun) = begun.as_mut().filter(|_| bounded) {
            let by_inks = self.curvature(setup, tools, seen, draw, &found, control)?;
            begun.take_curvature(setup, &by_inks, found.expected(&setup.layers));
        }
        let (loss, lacks) = (found.mean(), std::mem::take(&mut found.lacks));
        let d_shown = |viewing: usize, point: u32| found.slopes[viewing].gradient[point as usize];
        let mut gradient = pull(setup, seen, draw, &setup.points, d_shown, control)?;
        drop(found);
        step::smooth(Cells::of(setup), &mut gradient, &tools.fine, control)?;
        Ok(OwnStep { begun, patches: known, lacks, loss, noise, gradient })
    }

    fn take_own(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        state: &mut DescentState,
        step: OwnStep,
    ) -> Moved {
        let OwnStep { begun, patches, lacks, loss, noise, gradient } = step;
        if let Some(begun) = begun {
            *state = *begun;
        }
        (state.patches, state.lacks) = (patches, lacks);
        state.losses.push(loss);
        if let Some(noise) = noise {
            state.take_noise(loss, noise);
        }
        state.settle();
        let steps = setup.iterations.saturating_sub(self.opening_steps);
        let schedule = Schedule::new(steps, state.settled);
        let moved = step::take(self, Cells::of(setup), state, tools, schedule, gradient);
        let ended = match self.rule {
            StepRule::Adam => schedule.is_over(state.steps),
            _ => state.settled.is_some(),
        };
        state.steps += 1;
        state.refine_paths(steps);
        Moved { loss: Some(loss), noise, step: Some(moved), settled: ended }
    }

    /// Bounds of the curvature by inks, but for a factor, from some of the points.
    fn curvature(
        &self,
        setup: &Setup<'_>,
        tools: &DescentTools,
        seen: &Seen<'_>,
        draw: Draw,
        found: &Loss,
        control: &Control<'_>,
    ) -> Result<Vec<f32>, RefineError> {
        let every = if setup.points.len() < CURVATURE_ALL { 1 } else { CURVATURE_EVERY };
        // Chosen by chance: every fourth in a row would see one phase of a pattern.
        let chosen = |p: &u32| random::hash(setup.seed, CHOICE, u64::from(*p), 0).is_multiple_of(every);
        let points: Vec<u32> = setup.points.iter().copied().filter(chosen).collect();
        let d_shown = |viewing: usize, point: u32| {
            found.slopes[viewing].curvature[point as usize].map(|d| d * every as f32)
        };
        let mut by_inks = pull(setup, seen, draw, &points, d_shown, control)?;
        step::smooth(Cells::of(setup), &mut by_inks, &tools.fine, control)?;
        Ok(by_inks)
    }
}
