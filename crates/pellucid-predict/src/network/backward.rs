//! Derivatives by the network's outputs carried back to the stencils.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use pellucid_core::Control;
use pellucid_rpnn::variant::CELLS_XYZ;
use pellucid_rpnn::{InputGradients, RpnnError};
use pellucid_stencil::{Coefficients, StencilSpec, Stencils, near_order};
use rayon::prelude::*;

use super::evaluate::{Coarse, Contents, Engine, Evaluator, Near};
use super::spread::{Source, Spread};
use crate::PredictError;

/// Samples that a thread works on between looks at the control: some 30 ms.
const SAMPLES: usize = 256;

/// A network for each thread.
struct Networks {
    first: InputGradients,
    idle: Mutex<Vec<InputGradients>>,
}

impl Networks {
    fn lend<R>(&self, work: impl FnOnce(&mut InputGradients) -> R) -> R {
        let idle = || self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let left = idle().pop();
        let mut network = left.unwrap_or_else(|| self.first.clone());
        let result = work(&mut network);
        idle().push(network);
        result
    }
}

/// Some voxels in the order of work.
struct Batch<'a> {
    voxels: Vec<[u32; 3]>,
    /// Their positions among all.
    order: &'a [u32],
}

/// One pass from outputs to stencils.
pub(super) struct Backward<'a> {
    engine: &'a Engine,
    of: Contents<'a>,
    coefficients: &'a Coefficients,
    networks: Networks,
}

impl<'a> Backward<'a> {
    pub fn new(engine: &'a Engine, of: Contents<'a>) -> Self {
        let (inference, coefficients) = engine.parts();
        let networks = Networks { first: inference.input_gradients(), idle: Mutex::default() };
        Self { engine, of, coefficients, networks }
    }

    /// As [`Evaluator::pull_back`].
    pub fn run(
        &self,
        near: Option<&Near<'_>>,
        voxels: &[[u32; 3]],
        d_outputs: &[f32],
        spread: &mut Spread<'_>,
    ) -> Result<(), PredictError> {
        let Some(near) = near else { return self.whole(voxels, d_outputs, spread) };
        let coarse = self.engine.coarse(self.of, near.fine, near.places, &spread.control())?;
        let d_states = self.finest(near, &coarse, voxels, d_outputs, spread)?;
        self.others(near, &d_states, spread)
    }

    /// All levels of every voxel.
    fn whole(
        &self,
        voxels: &[[u32; 3]],
        d_outputs: &[f32],
        spread: &mut Spread<'_>,
    ) -> Result<(), PredictError> {
        let outputs = self.engine.head().outputs();
        self.in_batches(
            StencilSpec::paper(),
            voxels,
            0,
            spread,
            |_, _| (),
            |part| {
                let d_outputs = self.gathered(part.order, d_outputs, outputs);
                self.networks.lend(|n| n.outputs(part.stencils, &d_outputs, part.derivatives))
            },
        )
    }

    /// The voxels' own finest levels; returns the derivatives by the states of the places, `[place][channel][width]`.
    fn finest(
        &self,
        near: &Near<'_>,
        coarse: &Coarse,
        voxels: &[[u32; 3]],
        d_outputs: &[f32],
        spread: &mut Spread<'_>,
    ) -> Result<Vec<f32>, PredictError> {
        let outputs = self.engine.head().outputs();
        let row = self.coefficients.channels() * self.networks.first.state_width();
        let mut d_states = vec![0.0; near.places.len() * row];
        let mix = |voxel: u32, d_mixed: &[f32]| {
            let (places, weights) = (near.shares)(voxel);
            for (place, weight) in places.into_iter().zip(weights).filter(|(_, w)| *w != 0.0) {
                let to = &mut d_states[place as usize * row..][..row];
                to.iter_mut().zip(d_mixed).for_each(|(to, d)| *to += weight * d);
            }
        };
        let spec = StencilSpec::new(CELLS_XYZ, near.fine)?;
        self.in_batches(spec, voxels, row, spread, mix, |part| {
            let d_outputs = self.gathered(part.order, d_outputs, outputs);
            let (places, weights) = self.engine.shares(near, part.order);
            let Part { stencils, derivatives, d_mixed, .. } = part;
            let states = &coarse.states;
            self.networks.lend(|n| {
                n.outputs_near(states, &places, &weights, stencils, &d_outputs, derivatives, d_mixed)
            })
        })?;
        Ok(d_states)
    }

    /// The other levels of the places.
    fn others(&self, near: &Near<'_>, d_states: &[f32], spread: &mut Spread<'_>) -> Result<(), PredictError> {
        let width = self.networks.first.state_width();
        self.in_batches(
            StencilSpec::paper(),
            near.places,
            0,
            spread,
            |_, _| (),
            |part| {
                let d_states = self.gathered(part.order, d_states, width);
                self.networks.lend(|n| n.coarse_states(near.fine, part.stencils, &d_states, part.derivatives))
            },
        )
    }

    /// Has `work` done for the parts of as many voxels at a time as `spread` has room for, which takes their
    /// derivatives. `mix` is told each voxel's `mixed` values by the mixed state, in one order whatever the threads did.
    fn in_batches(
        &self,
        spec: StencilSpec,
        voxels: &[[u32; 3]],
        mixed: usize,
        spread: &mut Spread<'_>,
        mut mix: impl FnMut(u32, &[f32]),
        work: impl Fn(Part<'_>) -> Result<(), RpnnError> + Sync,
    ) -> Result<(), PredictError> {
        let stencils = self.engine.stencils(self.of, spec)?;
        let row = self.coefficients.values_per_point(&spec);
        let order = near_order(voxels);
        for order in order.chunks(spread.room(row.max(mixed))) {
            let voxels = order.iter().map(|&i| voxels[i as usize]).collect();
            let batch = Batch { voxels, order };
            let mut derivatives = vec![0.0; order.len() * row];
            let mut d_mixed = vec![0.0; order.len() * mixed];
            spread.reporting(order.len(), |control| {
                self.in_parts(&stencils, &batch, &mut derivatives, &mut d_mixed, control, &work)
            })?;
            if mixed > 0 {
                order.iter().zip(d_mixed.chunks_exact(mixed)).for_each(|(&i, d_mixed)| mix(i, d_mixed));
            }
            spread.take(Source { spec, voxels: batch.voxels, derivatives })?;
        }
        Ok(())
    }

    /// The rows `[channel][width]` of some positions.
    fn gathered(&self, order: &[u32], values: &[f32], width: usize) -> Vec<f32> {
        let row = self.coefficients.channels() * width;
        order.iter().flat_map(|&i| &values[i as usize * row..][..row]).copied().collect()
    }

    /// Works on the parts of a batch on any number of threads, each with its stencils at hand. Progress counts voxels.
    fn in_parts(
        &self,
        stencils: &Stencils<'_>,
        batch: &Batch<'_>,
        derivatives: &mut [f32],
        d_mixed: &mut [f32],
        control: &Control<'_>,
        work: &(impl Fn(Part<'_>) -> Result<(), RpnnError> + Sync),
    ) -> Result<(), PredictError> {
        let count = batch.voxels.len();
        let size = (SAMPLES / self.coefficients.channels()).max(1);
        let (row, mixed_row) = (derivatives.len() / count.max(1), d_mixed.len() / count.max(1));
        let mut mixed: Vec<&mut [f32]> = match mixed_row {
            0 => (0..count.div_ceil(size)).map(|_| Default::default()).collect(),
            _ => d_mixed.chunks_mut(size * mixed_row).collect(),
        };
        let done = AtomicU64::new(0);
        batch
            .order
            .par_chunks(size)
            .zip(batch.voxels.par_chunks(size))
            .zip(derivatives.par_chunks_mut(size * row))
            .zip(mixed.par_iter_mut())
            .try_for_each(|(((order, voxels), derivatives), d_mixed)| {
                control.check()?;
                let mut raw = vec![0.0; voxels.len() * row];
                stencils.extract(self.coefficients, voxels, &mut raw, &Control::none())?;
                work(Part { order, stencils: &raw, derivatives, d_mixed })?;
                control.advance(&done, voxels.len() as u64, count as u64);
                Ok(())
            })
    }
}

/// Voxels that a thread works on.
struct Part<'a> {
    /// Their positions among all.
    order: &'a [u32],
    stencils: &'a [f32],
    derivatives: &'a mut [f32],
    d_mixed: &'a mut [f32],
}
