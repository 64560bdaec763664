//! How a refinement moves: the interface that strategies implement.

use pellucid_core::{Cancelled, Control};
use pellucid_predict::{BoundPredictor, Draw};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;
use serde::{Serialize, de::DeserializeOwned};

use crate::layers::Layers;
use crate::{Problem, RefineError, SurfaceSmoother};

/// Surface voxels that one task handles.
const CHUNK: usize = 256;

/// How a refinement moves: what state it keeps, which mixtures follow from the state, and how a prediction changes it.
///
/// Labels follow from the state alone, so that a saved job needs no labels: the mixtures are halftoned by a fixed mask.
/// The state may be one value a surface voxel, a cell (surface voxel and layer) or a voxel. Everything must be the same
/// for any number of threads.
pub trait Strategy {
    /// What is saved with a job. Long arrays should serialise compactly; see [`packed`](crate::packed).
    type State: Clone + Serialize + DeserializeOwned;

    /// What follows from the problem alone and steps use again and again; made before the first of them.
    type Tools;

    /// How a state is to be moved.
    type Step;

    /// A short name for reports and checkpoints.
    fn name(&self) -> &str;

    /// The settings that decide how it moves, by name: a job resumed with others is refused.
    fn settings(&self) -> Vec<(&'static str, f64)>;

    /// How many iterations it should have after the unrefined halftone, unless it settles before.
    fn iterations(&self) -> u32;

    /// Checks the settings.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] naming the setting out of range.
    fn check(&self) -> Result<(), RefineError>;

    /// The state of iteration 0: the unrefined halftone.
    fn start(&self, setup: &Setup<'_>) -> Self::State;

    /// Checks a state that was saved, before it is resumed.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] when it is not of this problem, or damaged.
    fn check_state(&self, setup: &Setup<'_>, state: &Self::State) -> Result<(), RefineError>;

    /// A state without what only further steps need, which is kept of the best iterate: its mixtures are the same. All of
    /// it by default.
    fn without_history(&self, state: &Self::State) -> Self::State {
        state.clone()
    }

    /// [`Strategy::check_state`] of a state without its history.
    ///
    /// # Errors
    /// As there.
    fn check_best(&self, setup: &Setup<'_>, state: &Self::State) -> Result<(), RefineError> {
        self.check_state(setup, state)
    }

    /// The mixtures of a state.
    ///
    /// # Errors
    /// [`RefineError::Cancelled`] when `control` asks to stop.
    fn mixtures<'s>(
        &'s self,
        setup: &'s Setup<'_>,
        state: &'s Self::State,
        control: &Control<'_>,
    ) -> Result<Planned<'s>, RefineError>;

    /// Makes the tools. `smoother` is the Gaussian of
    /// [`RefineSettings::residual_blur_mm`](crate::RefineSettings::residual_blur_mm).
    ///
    /// # Errors
    /// [`RefineError::Cancelled`].
    fn tools(
        &self,
        setup: &Setup<'_>,
        smoother: &SurfaceSmoother,
        control: &Control<'_>,
    ) -> Result<Self::Tools, RefineError>;

    /// With what [`Draw::effort`] the labels of a state are predicted: 1 by default.
    fn effort(&self, state: &Self::State) -> u32 {
        let _ = state;
        1
    }

    /// Finds how a state is to be moved, by what was predicted of its labels.
    ///
    /// # Errors
    /// [`RefineError::Predict`] when a derivative is asked for and fails; [`RefineError::Cancelled`].
    fn plan(
        &self,
        setup: &Setup<'_>,
        tools: &Self::Tools,
        state: &Self::State,
        seen: &Seen<'_>,
        control: &Control<'_>,
    ) -> Result<Self::Step, RefineError>;

    /// Moves the state that a step was planned for.
    fn take(
        &self,
        setup: &Setup<'_>,
        tools: &Self::Tools,
        state: &mut Self::State,
        step: Self::Step,
    ) -> Moved;
}

/// What a step says of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moved {
    /// What the strategy lowers, of the iterate that was seen.
    pub loss: Option<f64>,
    /// How much of it is the predictor's random error, where that was measured.
    pub noise: Option<f64>,
    /// Mean change of what it moves.
    pub step: Option<f64>,
    /// Nothing is to be gained by going on: the refinement ends with the iterate that was seen.
    pub settled: bool,
}

/// What stays during a refinement.
pub struct Setup<'a> {
    /// The problem, checked.
    pub problem: Problem<'a>,
    /// Depth layers of the coloured depth.
    pub layers: Layers,
    /// Every surface voxel, in order.
    pub points: Vec<u32>,
    /// Seed of everything random.
    pub seed: u64,
    /// How many iterations there are at most after the unrefined halftone.
    pub iterations: u32,
}

/// Mixtures to halftone.
pub struct Planned<'s> {
    /// The mixture of each coloured voxel.
    pub mixtures: Box<dyn Mixtures + 's>,
    /// What no layer of a surface voxel could take of its demand, in the strategy's own units, for
    /// [`Seen::overflow`]; empty where the strategy has none.
    pub overflow: Vec<[f32; 3]>,
}

/// Gives the mixture of a voxel.
pub trait Mixtures: Sync {
    /// The cumulative shares of a voxel's mixture, one less than the ink model's labels, as
    /// [`Thresholds::write`](pellucid_halftone::Thresholds::write) makes them; `scratch` has that length and may hold
    /// them.
    fn thresholds<'r>(&'r self, cell: &Cell, scratch: &'r mut [u16]) -> &'r [u16];
}

/// A voxel of the coloured depth, and the cell (surface voxel and layer) that it lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// The voxel.
    pub voxel: [u32; 3],
    /// Its nearest surface voxel.
    pub point: u32,
    /// Its depth layer.
    pub layer: u32,
}

/// Mixtures by surface voxel and layer.
pub struct LayerMixtures {
    layers: usize,
    row: usize,
    rows: Vec<u16>,
}

impl LayerMixtures {
    /// Asks `write` for every surface voxel's mixtures, in parallel. It gets the voxel and room for its layers'
    /// cumulative shares, `[layer][label]` without the last label, zero at first; what it returns is collected, one
    /// value a surface voxel.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn fill(
        setup: &Setup<'_>,
        control: &Control<'_>,
        write: impl Fn(u32, &mut [u16]) -> [f32; 3] + Sync,
    ) -> Result<(Self, Vec<[f32; 3]>), Cancelled> {
        let row = setup.problem.ink.labels().len() - 1;
        let layers = setup.layers.count();
        let stride = layers * row;
        let mut rows = vec![0u16; setup.points.len() * stride];
        let mut returned = vec![[0.0; 3]; setup.points.len()];
        let chunks = rows.par_chunks_mut(stride * CHUNK).zip(returned.par_chunks_mut(CHUNK));
        chunks.zip(setup.points.par_chunks(CHUNK)).try_for_each(|((rows, returned), points)| {
            control.check()?;
            for ((rows, returned), &point) in rows.chunks_exact_mut(stride).zip(returned).zip(points) {
                *returned = write(point, rows);
            }
            Ok::<(), Cancelled>(())
        })?;
        Ok((Self { layers, row, rows }, returned))
    }
}

impl LayerMixtures {
    /// The cumulative shares, `[point][layer][label]` without the last label.
    pub(crate) fn into_rows(self) -> Vec<u16> {
        self.rows
    }
}

impl Mixtures for LayerMixtures {
    fn thresholds<'r>(&'r self, cell: &Cell, _: &'r mut [u16]) -> &'r [u16] {
        let start = (cell.point as usize * self.layers + cell.layer as usize) * self.row;
        &self.rows[start..start + self.row]
    }
}

/// What was predicted of an iterate.
pub struct Seen<'s> {
    /// The iteration, 0 for the unrefined halftone.
    pub iteration: u32,
    /// Absolute radiance of every surface voxel, `[point][channel]`.
    pub radiance: &'s [f32],
    /// The same as linear RGB relative to the print's white.
    pub shown: &'s [[f32; 3]],
    /// The printable target less the smoothed shortfall, not below 0: what is shown, without the noise finer than
    /// [`RefineSettings::residual_blur_mm`](crate::RefineSettings::residual_blur_mm).
    pub smoothed: &'s [[f32; 3]],
    /// The Gaussian that [`Strategy::tools`] was given.
    pub smoother: &'s SurfaceSmoother,
    /// [`Planned::overflow`] of this iterate.
    pub overflow: &'s [[f32; 3]],
    /// The iterate's labels.
    pub labels: &'s LabelGrid,
    /// The predictor, up to date with the labels: for derivatives.
    pub bound: &'s dyn BoundPredictor,
    /// The random numbers of the prediction.
    pub draw: Draw,
}
