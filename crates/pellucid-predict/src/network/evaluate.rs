//! The network's outputs at voxels of one object's labels.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use pellucid_core::{Control, InstructionSet};
use pellucid_rpnn::Inference;
use pellucid_rpnn::variant::{CELLS_XYZ, INPUTS, LEVEL_INPUTS};
use pellucid_stencil::{Coefficients, StencilSpec, Stencils, near_order};
use pellucid_voxel::{CountSat, LabelGrid};
use rayon::prelude::*;

use super::trained_range::TrainedRange;
use crate::{PredictError, Sharing};

/// Voxels whose stencils are in memory at a time, a thread: 7 MB in three channels, half of it where they share
/// coarse levels.
const CHUNK: usize = 256;

/// The network of one object, with what its threads work with.
pub(super) struct Engine {
    /// Clones share its weights.
    inference: Inference,
    pub coefficients: Coefficients,
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

/// The network's outputs at some voxels.
pub(super) struct Outputs {
    /// `[voxel][channel][output]`.
    pub values: Vec<f32>,
    /// `[voxel][channel]`: whether the surroundings lie outside what training saw.
    pub outside: Vec<bool>,
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

    pub fn head(&self) -> pellucid_rpnn::variant::Head {
        self.inference.head()
    }

    /// Outputs at `voxels` of `labels` with their summed-area `table`. Each voxel's depend on nothing else that is
    /// asked for. Progress counts voxels.
    pub fn outputs(
        &self,
        labels: &LabelGrid,
        table: &CountSat,
        sharing: Option<Sharing>,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let stencils = |spec| Stencils::new(spec, labels, table)?.with_instruction_set(self.instruction_set);
        let volume = Volume {
            whole: stencils(StencilSpec::paper())?,
            fine: match sharing.filter(|s| s.shares_levels()) {
                Some(sharing) => {
                    Some((sharing, stencils(StencilSpec::new(CELLS_XYZ, sharing.fine_levels)?)?))
                }
                None => None,
            },
            coefficients: &self.coefficients,
            trained: self.trained,
            size: labels.size(),
        };
        let order = volume.order(voxels);
        let done = AtomicU64::new(0);
        let parts = order
            .par_chunks(CHUNK)
            .map(|chunk| -> Result<Outputs, PredictError> {
                control.check()?;
                let near: Vec<[u32; 3]> = chunk.iter().map(|&i| voxels[i as usize]).collect();
                let mut scratch = self.take_scratch();
                let outputs = volume.outputs(&near, &mut scratch)?;
                self.leave_scratch(scratch);
                control.advance(&done, chunk.len() as u64, voxels.len() as u64);
                Ok(outputs)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let channels = self.coefficients.channels();
        let row = channels * self.head().outputs();
        let mut all =
            Outputs { values: vec![0.0; voxels.len() * row], outside: vec![false; voxels.len() * channels] };
        for (chunk, part) in order.chunks(CHUNK).zip(&parts) {
            let rows = part.values.chunks_exact(row).zip(part.outside.chunks_exact(channels));
            for (&i, (values, outside)) in chunk.iter().zip(rows) {
                all.values[i as usize * row..][..row].copy_from_slice(values);
                all.outside[i as usize * channels..][..channels].copy_from_slice(outside);
            }
        }
        Ok(all)
    }

    fn take_scratch(&self) -> Scratch {
        let left = self.scratch.lock().unwrap_or_else(PoisonError::into_inner).pop();
        left.unwrap_or_else(|| Scratch { inference: self.inference.clone(), stencils: Vec::new() })
    }

    fn leave_scratch(&self, scratch: Scratch) {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

/// The object's labels as stencils are taken from them.
struct Volume<'a> {
    /// All levels, for voxels on their own and for blocks.
    whole: Stencils<'a>,
    /// The finest levels of voxels that share the others.
    fine: Option<(Sharing, Stencils<'a>)>,
    coefficients: &'a Coefficients,
    trained: TrainedRange,
    size: [u32; 3],
}

impl Volume<'_> {
    /// An order in which voxels that share a block come one after another, and neighbouring blocks close together.
    fn order(&self, voxels: &[[u32; 3]]) -> Vec<u32> {
        match self.fine {
            Some((sharing, _)) => {
                near_order(&voxels.iter().map(|v| sharing.centre(*v, self.size)).collect::<Vec<_>>())
            }
            None => near_order(voxels),
        }
    }

    fn outputs(&self, voxels: &[[u32; 3]], scratch: &mut Scratch) -> Result<Outputs, PredictError> {
        let Scratch { inference, stencils } = scratch;
        let samples = voxels.len() * self.coefficients.channels();
        let mut values = vec![0.0; samples * inference.head().outputs()];
        let Some((sharing, fine)) = &self.fine else {
            self.extract(&self.whole, voxels, stencils)?;
            inference.outputs(stencils, &mut values)?;
            let outside = stencils.chunks_exact(INPUTS).map(|s| self.trained.misses(s)).collect();
            return Ok(Outputs { values, outside });
        };
        let mut blocks: Vec<[u32; 3]> = Vec::new();
        let mut block_of = Vec::with_capacity(voxels.len());
        for centre in voxels.iter().map(|v| sharing.centre(*v, self.size)) {
            if blocks.last() != Some(&centre) {
                blocks.push(centre);
            }
            block_of.push(blocks.len() as u32 - 1);
        }
        let channels = self.coefficients.channels() as u32;
        let places: Vec<u32> =
            block_of.iter().flat_map(|b| (0..channels).map(move |c| b * channels + c)).collect();
        self.extract(&self.whole, &blocks, stencils)?;
        let own = sharing.fine_levels * LEVEL_INPUTS;
        let beyond: Vec<bool> =
            stencils.chunks_exact(INPUTS).map(|s| self.trained.exceeds(&s[own..])).collect();
        let states = inference.coarse_states(sharing.fine_levels, stencils)?;
        self.extract(fine, voxels, stencils)?;
        inference.outputs_near(&states, &places, stencils, &mut values)?;
        let samples = stencils.chunks_exact(own).zip(&places);
        let outside = samples.map(|(s, p)| self.trained.misses(s) || beyond[*p as usize]).collect();
        Ok(Outputs { values, outside })
    }

    fn extract(
        &self,
        of: &Stencils<'_>,
        voxels: &[[u32; 3]],
        stencils: &mut Vec<f32>,
    ) -> Result<(), PredictError> {
        stencils.resize(voxels.len() * self.coefficients.values_per_point(of.spec()), 0.0);
        Ok(of.extract(self.coefficients, voxels, stencils, &Control::none())?)
    }
}
