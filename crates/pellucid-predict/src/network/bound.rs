//! One object under the network.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use pellucid_core::{Control, InstructionSet};
use pellucid_rpnn::Inference;
use pellucid_rpnn::variant::{CELLS_XYZ, Head, INPUTS, LEVEL_INPUTS};
use pellucid_stencil::{Coefficients, FirstFlight, FirstFlights, StencilSpec, Stencils, near_order};
use pellucid_voxel::{CountSat, LabelGrid};
use rayon::prelude::*;

use super::Network;
use super::trained_range::TrainedRange;
use crate::labels::{KeptLabels, Update};
use crate::{BoundPredictor, Changed, Diagnostics, Draw, Object, PredictError, Sharing};

/// Points whose stencils are in memory at a time, a thread: 7 MB in three channels, half of it where they share
/// coarse levels.
const CHUNK: usize = 256;

pub(super) struct BoundNetwork {
    object: Arc<Object>,
    sharing: Option<Sharing>,
    coefficients: Coefficients,
    trained: TrainedRange,
    instruction_set: InstructionSet,
    labels: KeptLabels,
    table: Option<CountSat>,
    /// Clones share its weights.
    inference: Inference,
    /// What idle threads left for the next chunk.
    scratch: Mutex<Vec<Scratch>>,
}

/// What a thread works with.
struct Scratch {
    inference: Inference,
    stencils: Vec<f32>,
}

impl BoundNetwork {
    pub(super) fn new(network: &Network, object: Arc<Object>) -> Result<Self, PredictError> {
        Ok(Self {
            coefficients: Network::coefficients(&object)?,
            sharing: network.sharing,
            trained: TrainedRange::new(&network.trained.provenance),
            instruction_set: network.instruction_set,
            labels: KeptLabels::default(),
            table: None,
            inference: network.inference()?,
            scratch: Mutex::new(Vec::new()),
            object,
        })
    }

    fn take_scratch(&self) -> Scratch {
        let left = self.scratch.lock().unwrap_or_else(PoisonError::into_inner).pop();
        left.unwrap_or_else(|| Scratch { inference: self.inference.clone(), stencils: Vec::new() })
    }

    fn leave_scratch(&self, scratch: Scratch) {
        self.scratch.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

impl BoundPredictor for BoundNetwork {
    fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let fits = self.object.check_labels(labels).and_then(|()| self.object.check_solid(labels));
        fits.inspect_err(|_| self.labels.forget())?;
        let table = &mut self.table;
        let (materials, silent) = (self.object.materials().len(), control.silent());
        self.labels.update(labels, changed, control, |update| {
            match (update, table.as_mut()) {
                (Update::Tiles(tiles), Some(table)) => table.update(labels, tiles, &silent)?,
                _ => *table = Some(CountSat::build(labels, materials, &silent)?),
            }
            Ok(())
        })
    }

    fn predict(
        &self,
        points: &[u32],
        _: Draw,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<Diagnostics, PredictError> {
        let (Some(labels), Some(table)) = (self.labels.current(), &self.table) else {
            return Err(PredictError::before_update());
        };
        self.object.check_points(points, out.len())?;
        control.check()?;
        let stencils = |spec| Stencils::new(spec, labels, table)?.with_instruction_set(self.instruction_set);
        let volume = Volume {
            whole: stencils(StencilSpec::paper())?,
            fine: match self.sharing {
                Some(sharing) => {
                    let spec = StencilSpec::new(CELLS_XYZ, sharing.fine_levels)?;
                    Some((sharing, stencils(spec)?))
                }
                None => None,
            },
            coefficients: &self.coefficients,
            trained: self.trained,
            size: labels.size(),
        };
        let surface = self.object.surface();
        let voxels: Vec<[u32; 3]> = points.iter().map(|&p| surface.voxels()[p as usize]).collect();
        let flights = match self.inference.head() {
            Head::Radiance => None,
            Head::FirstFlight => {
                let index = self.object.refractive_index();
                Some(FirstFlights::new(self.object.materials(), labels, surface, index)?)
            }
        };
        let order = volume.order(&voxels);
        let (done, outside) = (AtomicU64::new(0), AtomicU64::new(0));
        let predicted = order
            .par_chunks(CHUNK)
            .map(|chunk| -> Result<Vec<f32>, PredictError> {
                control.check()?;
                let near: Vec<[u32; 3]> = chunk.iter().map(|&i| voxels[i as usize]).collect();
                let mut scratch = self.take_scratch();
                let mut flown = vec![FirstFlight::default(); near.len() * self.object.channels()];
                if let Some(flights) = &flights {
                    let chunk: Vec<u32> = chunk.iter().map(|&i| points[i as usize]).collect();
                    flights.extract(&chunk, &mut flown, &Control::none())?;
                }
                let (radiance, count) = volume.predict(&near, &flown, &mut scratch)?;
                self.leave_scratch(scratch);
                outside.fetch_add(count, Ordering::Relaxed);
                control.advance(&done, chunk.len() as u64, points.len() as u64);
                Ok(radiance)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let channels = self.object.channels();
        for (chunk, radiance) in order.chunks(CHUNK).zip(&predicted) {
            for (&i, radiance) in chunk.iter().zip(radiance.chunks_exact(channels)) {
                out[i as usize * channels..][..channels].copy_from_slice(radiance);
            }
        }
        Ok(Diagnostics { outside_training: outside.into_inner(), ..Diagnostics::default() })
    }
}

/// The object's labels as stencils are taken from them.
struct Volume<'a> {
    /// All levels, for points on their own and for blocks.
    whole: Stencils<'a>,
    /// The finest levels of points that share the others.
    fine: Option<(Sharing, Stencils<'a>)>,
    coefficients: &'a Coefficients,
    trained: TrainedRange,
    size: [u32; 3],
}

impl Volume<'_> {
    /// An order in which points that share a block come one after another, and neighbouring blocks close together.
    fn order(&self, voxels: &[[u32; 3]]) -> Vec<u32> {
        match self.fine {
            Some((sharing, _)) => {
                near_order(&voxels.iter().map(|v| sharing.centre(*v, self.size)).collect::<Vec<_>>())
            }
            None => near_order(voxels),
        }
    }

    /// Radiance of some voxels `[voxel][channel]`, and how many of the values lie outside what training saw.
    fn predict(
        &self,
        voxels: &[[u32; 3]],
        flights: &[FirstFlight],
        scratch: &mut Scratch,
    ) -> Result<(Vec<f32>, u64), PredictError> {
        let mut radiance = vec![0.0; voxels.len() * self.coefficients.channels()];
        let Some((sharing, fine)) = &self.fine else {
            self.extract(&self.whole, voxels, &mut scratch.stencils)?;
            scratch.inference.radiance(&scratch.stencils, flights, &mut radiance)?;
            let outside = scratch.stencils.chunks_exact(INPUTS).filter(|s| self.trained.misses(s)).count();
            return Ok((radiance, outside as u64));
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
        let Scratch { inference, stencils } = scratch;
        self.extract(&self.whole, &blocks, stencils)?;
        let own = sharing.fine_levels * LEVEL_INPUTS;
        let beyond: Vec<bool> =
            stencils.chunks_exact(INPUTS).map(|s| self.trained.exceeds(&s[own..])).collect();
        let states = inference.coarse_states(sharing.fine_levels, stencils)?;
        self.extract(fine, voxels, stencils)?;
        let head = inference.head();
        let mut outputs = vec![0.0; radiance.len() * head.outputs()];
        inference.outputs_near(&states, &places, stencils, &mut outputs)?;
        head.radiance(&outputs, flights, &mut radiance);
        let samples = stencils.chunks_exact(own).zip(&places);
        let outside = samples.filter(|(s, p)| self.trained.misses(s) || beyond[**p as usize]).count();
        Ok((radiance, outside as u64))
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
