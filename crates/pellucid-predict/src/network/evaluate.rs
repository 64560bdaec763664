//! The network's outputs at surface points of one object's labels.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use pellucid_core::{Control, InstructionSet};
use pellucid_rpnn::Inference;
use pellucid_rpnn::inference::CoarseStates;
use pellucid_rpnn::variant::{CELLS_XYZ, Head, INPUTS, LEVEL_INPUTS};
use pellucid_stencil::{Coefficients, StencilSpec, Stencils, near_order};
use pellucid_voxel::{CountSat, LabelGrid};
use rayon::prelude::*;

use super::backward::Backward;
use super::nodes::NEAREST;
use super::spread::Spread;
use super::trained_range::TrainedRange;
use crate::PredictError;

/// Stencils, of voxels and channels, that are in memory at a time, a thread: 7 MB, a third of it where they share coarse
/// levels.
const CHUNK: usize = 768;

/// The network of one object, with what its threads work with.
pub(super) struct Engine {
    /// Clones share its weights.
    inference: Inference,
    coefficients: Coefficients,
    trained: TrainedRange,
    instruction_set: InstructionSet,
    /// What idle threads left for the next chunk.
    scratch: Mutex<Vec<Scratch>>,
}

/// What a thread works with.
struct Scratch {
    inference: Inference,
    stencils: Vec<f32>,
}

/// Labels with their summed-area table.
#[derive(Clone, Copy)]
pub(super) struct Contents<'a> {
    pub labels: &'a LabelGrid,
    pub table: &'a CountSat,
}

/// The network's outputs at some voxels.
#[derive(Clone, Default)]
pub(super) struct Outputs {
    /// `[voxel][channel][output]`.
    pub values: Vec<f32>,
    /// `[voxel][channel]`: whether the surroundings lie outside what training saw.
    pub outside: Vec<bool>,
}

impl Outputs {
    /// Zeros for some voxels.
    pub fn zeros(voxels: usize, channels: usize, outputs: usize) -> Self {
        let samples = voxels * channels;
        Self { values: vec![0.0; samples * outputs], outside: vec![false; samples] }
    }

    /// Puts what was found for some voxels, in order, at their `positions` among these.
    pub fn put(&mut self, positions: &[u32], found: &Self, channels: usize) {
        let row = found.values.len() / positions.len().max(1);
        let rows = found.values.chunks_exact(row.max(1)).zip(found.outside.chunks_exact(channels));
        for (&i, (values, outside)) in positions.iter().zip(rows) {
            self.values[i as usize * row..][..row].copy_from_slice(values);
            self.outside[i as usize * channels..][..channels].copy_from_slice(outside);
        }
    }
}

/// What the network made of the coarse levels of some places.
pub(super) struct Coarse {
    /// `[place][channel]`.
    pub states: CoarseStates,
    /// `[place][channel]`: whether those levels lie outside what training saw.
    outside: Vec<bool>,
}

/// Places among [`Coarse`] and what each counts for a voxel.
pub(super) type Shares = ([u32; NEAREST], [f32; NEAREST]);

/// Levels that voxels read at places about them.
pub(super) struct Near<'a> {
    /// The finest levels, which each voxel reads for itself.
    pub fine: usize,
    /// Where the others are read.
    pub places: &'a [[u32; 3]],
    /// The places, by their positions, of the voxel of a position.
    pub shares: &'a (dyn Fn(u32) -> Shares + Sync),
}

/// Computes the network's outputs for one object.
pub(super) trait Evaluator: Send + Sync {
    /// What the network's last layer gives.
    fn head(&self) -> Head;

    /// Outputs at voxels, each of which depends on nothing else that is asked for. Progress counts voxels.
    fn outputs(
        &self,
        of: Contents<'_>,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError>;

    /// [`Evaluator::outputs`] from the voxels' own finest levels and what the network makes of the others at the places
    /// near them. One that cannot share reads every voxel's own.
    fn outputs_near(
        &self,
        of: Contents<'_>,
        near: &Near<'_>,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let _ = near;
        self.outputs(of, voxels, control)
    }

    /// Whether [`Evaluator::pull_back`] works.
    fn has_gradient(&self) -> bool {
        false
    }

    /// Hands to `spread` the derivatives by the stencils of voxels, given those by the outputs there, `d_outputs`
    /// `[voxel][channel][output]`; with `near`, by the voxels' own finest levels and by the others of its places.
    /// Unsupported by default.
    fn pull_back(
        &self,
        of: Contents<'_>,
        near: Option<&Near<'_>>,
        voxels: &[[u32; 3]],
        d_outputs: &[f32],
        spread: &mut Spread<'_>,
    ) -> Result<(), PredictError> {
        let _ = (of, near, voxels, d_outputs, spread);
        Err(PredictError::unsupported("gradient", "this form of the network has none"))
    }
}

impl Engine {
    pub fn new(
        inference: Inference,
        coefficients: Coefficients,
        trained: TrainedRange,
        instruction_set: InstructionSet,
    ) -> Self {
        Self { inference, coefficients, trained, instruction_set, scratch: Mutex::new(Vec::new()) }
    }

    /// What the network makes of all but the `fine` finest levels at voxels. Progress counts voxels.
    pub fn coarse(
        &self,
        of: Contents<'_>,
        fine: usize,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Coarse, PredictError> {
        let stencils = self.stencils(of, StencilSpec::paper())?;
        let order: Vec<u32> = (0..voxels.len() as u32).collect();
        let parts = self.each_chunk(&order, control, |chunk, scratch| {
            self.extract(&stencils, voxels, chunk, &mut scratch.stencils)?;
            let states = scratch.inference.coarse_states(fine, &scratch.stencils)?;
            let beyond = |s: &[f32]| self.trained.exceeds(&s[fine * LEVEL_INPUTS..]);
            let outside: Vec<bool> = scratch.stencils.chunks_exact(INPUTS).map(beyond).collect();
            Ok((states, outside))
        })?;
        let (states, outside): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        Ok(Coarse { states: CoarseStates::joined(fine, states), outside: outside.concat() })
    }

    pub fn stencils<'a>(&self, of: Contents<'a>, spec: StencilSpec) -> Result<Stencils<'a>, PredictError> {
        Ok(Stencils::new(spec, of.labels, of.table)?.with_instruction_set(self.instruction_set)?)
    }

    /// The network with what it is given: for [`Backward`].
    pub fn parts(&self) -> (&Inference, &Coefficients) {
        (&self.inference, &self.coefficients)
    }

    /// The places of the voxels of some positions and what each counts, `[voxel][channel][place]`.
    pub fn shares(&self, near: &Near<'_>, positions: &[u32]) -> (Vec<u32>, Vec<f32>) {
        let channels = self.coefficients.channels() as u32;
        let (mut places, mut weights) = (Vec::new(), Vec::new());
        for &voxel in positions {
            let (about, share) = (near.shares)(voxel);
            for channel in 0..channels {
                places.extend(about.map(|place| place * channels + channel));
                weights.extend(share);
            }
        }
        (places, weights)
    }

    /// Voxels of a chunk.
    fn chunk(&self) -> usize {
        (CHUNK / self.coefficients.channels()).max(1)
    }

    fn no_outputs(&self, voxels: usize) -> Outputs {
        Outputs::zeros(voxels, self.coefficients.channels(), self.head().outputs())
    }

    /// Raw stencils of the voxels at some positions.
    fn extract(
        &self,
        of: &Stencils<'_>,
        voxels: &[[u32; 3]],
        positions: &[u32],
        stencils: &mut Vec<f32>,
    ) -> Result<(), PredictError> {
        let chosen: Vec<[u32; 3]> = positions.iter().map(|&i| voxels[i as usize]).collect();
        stencils.resize(chosen.len() * self.coefficients.values_per_point(of.spec()), 0.0);
        Ok(of.extract(&self.coefficients, &chosen, stencils, &Control::none())?)
    }

    /// Computes outputs chunk by chunk of the voxels' positions, neighbours together, and puts them in order.
    fn in_chunks(
        &self,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
        compute: impl Fn(&[u32], &mut Scratch) -> Result<Outputs, PredictError> + Sync,
    ) -> Result<Outputs, PredictError> {
        let order = near_order(voxels);
        let parts = self.each_chunk(&order, control, compute)?;
        let mut all = self.no_outputs(voxels.len());
        for (chunk, part) in order.chunks(self.chunk()).zip(&parts) {
            all.put(chunk, part, self.coefficients.channels());
        }
        Ok(all)
    }

    /// What `compute` makes of each chunk of an order, on all threads.
    fn each_chunk<T: Send>(
        &self,
        order: &[u32],
        control: &Control<'_>,
        compute: impl Fn(&[u32], &mut Scratch) -> Result<T, PredictError> + Sync,
    ) -> Result<Vec<T>, PredictError> {
        let done = AtomicU64::new(0);
        let each = order.par_chunks(self.chunk()).map(|chunk| {
            control.check()?;
            let mut scratch = self.take_scratch();
            let made = compute(chunk, &mut scratch)?;
            self.leave_scratch(scratch);
            control.advance(&done, chunk.len() as u64, order.len() as u64);
            Ok(made)
        });
        each.collect()
    }

    fn take_scratch(&self) -> Scratch {
        let left = self.scratch.lock().unwrap_or_else(PoisonError::into_inner).pop();
        left.unwrap_or_else(|| Scratch { inference: self.inference.clone(), stencils: Vec::new() })
    }

    fn leave_scratch(&self, scratch: Scratch) {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

impl Evaluator for Engine {
    fn head(&self) -> Head {
        self.inference.head()
    }

    fn outputs(
        &self,
        of: Contents<'_>,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let stencils = self.stencils(of, StencilSpec::paper())?;
        self.in_chunks(voxels, control, |chunk, scratch| {
            self.extract(&stencils, voxels, chunk, &mut scratch.stencils)?;
            let mut outputs = self.no_outputs(chunk.len());
            scratch.inference.outputs(&scratch.stencils, &mut outputs.values)?;
            let samples = scratch.stencils.chunks_exact(INPUTS).zip(&mut outputs.outside);
            samples.for_each(|(stencil, outside)| *outside = self.trained.misses(stencil));
            Ok(outputs)
        })
    }

    fn outputs_near(
        &self,
        of: Contents<'_>,
        near: &Near<'_>,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let fine = near.fine;
        let coarse = self.coarse(of, fine, near.places, &control.silent())?;
        let stencils = self.stencils(of, StencilSpec::new(CELLS_XYZ, fine)?)?;
        self.in_chunks(voxels, control, |chunk, scratch| {
            self.extract(&stencils, voxels, chunk, &mut scratch.stencils)?;
            let (places, weights) = self.shares(near, chunk);
            let mut outputs = self.no_outputs(chunk.len());
            let values = &mut outputs.values;
            scratch.inference.outputs_near(&coarse.states, &places, &weights, &scratch.stencils, values)?;
            let samples =
                scratch.stencils.chunks_exact(fine * LEVEL_INPUTS).zip(places.chunks_exact(NEAREST));
            for ((stencil, places), outside) in samples.zip(&mut outputs.outside) {
                *outside = self.trained.misses(stencil) || coarse.outside[places[0] as usize];
            }
            Ok(outputs)
        })
    }

    fn has_gradient(&self) -> bool {
        true
    }

    fn pull_back(
        &self,
        of: Contents<'_>,
        near: Option<&Near<'_>>,
        voxels: &[[u32; 3]],
        d_outputs: &[f32],
        spread: &mut Spread<'_>,
    ) -> Result<(), PredictError> {
        Backward::new(self, of).run(near, voxels, d_outputs, spread)
    }
}
