//! Derivatives by the network's outputs carried back to the stencils.

use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use pellucid_core::Control;
use pellucid_rpnn::InputGradients;
use pellucid_rpnn::variant::CELLS_XYZ;
use pellucid_stencil::{StencilSpec, Stencils, near_order};
use rayon::prelude::*;

use super::evaluate::{Coarse, Contents, Engine, Near};
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

impl Engine {
    /// Hands the derivatives by the stencils of voxels to `spread`, given those by the outputs there, `d_outputs`
    /// `[voxel][channel][output]`; with `near`, by the voxels' own finest levels and by the others of its places.
    pub fn pull_back(
        &self,
        of: Contents<'_>,
        voxels: &[[u32; 3]],
        near: Option<&Near<'_>>,
        d_outputs: &[f32],
        spread: &mut Spread<'_>,
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let first = self.inference().input_gradients();
        let networks = Networks { first, idle: Mutex::default() };
        let order = near_order(voxels);
        match near {
            None => self.pull_back_each(of, voxels, &order, d_outputs, &networks, spread),
            Some(near) => {
                let coarse = self.coarse(of, near.fine, near.places, &control.silent())?;
                let d_states =
                    self.pull_back_fine(of, voxels, &order, near, &coarse, d_outputs, &networks, spread)?;
                self.pull_back_coarse(of, near, &d_states, &networks, spread)
            }
        }
    }

    /// Every voxel on its own.
    fn pull_back_each(
        &self,
        of: Contents<'_>,
        voxels: &[[u32; 3]],
        order: &[u32],
        d_outputs: &[f32],
        networks: &Networks,
        spread: &mut Spread<'_>,
    ) -> Result<(), PredictError> {
        let spec = StencilSpec::paper();
        let stencils = self.stencils(of, spec)?;
        for order in order.chunks(spread.room(&spec)) {
            let batch = Batch { voxels: order.iter().map(|&i| voxels[i as usize]).collect(), order };
            let mut derivatives = vec![0.0; batch.voxels.len() * self.values_of(&stencils)];
            spread.reporting(order.len(), |control| {
                self.in_parts(&stencils, &batch, &mut derivatives, &mut [], control, |part| {
                    let d_outputs = self.gathered(part.order, d_outputs, self.head().outputs());
                    networks.lend(|n| n.outputs(part.stencils, &d_outputs, part.derivatives))
                })
            })?;
            spread.take(Source { spec, voxels: batch.voxels, derivatives })?;
        }
        Ok(())
    }

    /// The voxels' own finest levels; returns the derivatives by the states of the places, `[place][channel][width]`.
    fn pull_back_fine(
        &self,
        of: Contents<'_>,
        voxels: &[[u32; 3]],
        order: &[u32],
        near: &Near<'_>,
        coarse: &Coarse,
        d_outputs: &[f32],
        networks: &Networks,
        spread: &mut Spread<'_>,
    ) -> Result<Vec<f32>, PredictError> {
        let spec = StencilSpec::new(CELLS_XYZ, near.fine)?;
        let stencils = self.stencils(of, spec)?;
        let row = self.coefficients().channels() * networks.first.state_width();
        let mut d_states = vec![0.0; near.places.len() * row];
        for order in order.chunks(spread.room(&spec)) {
            let batch = Batch { voxels: order.iter().map(|&i| voxels[i as usize]).collect(), order };
            let mut derivatives = vec![0.0; batch.voxels.len() * self.values_of(&stencils)];
            let mut d_mixed = vec![0.0; batch.voxels.len() * row];
            spread.reporting(order.len(), |control| {
                self.in_parts(&stencils, &batch, &mut derivatives, &mut d_mixed, control, |part| {
                    let d_outputs = self.gathered(part.order, d_outputs, self.head().outputs());
                    let (places, weights) = self.shares(near, part.order);
                    networks.lend(|n| {
                        let (own, mixed) = (part.derivatives, part.d_mixed);
                        n.outputs_near(
                            coarse.states(),
                            &places,
                            &weights,
                            part.stencils,
                            &d_outputs,
                            own,
                            mixed,
                        )
                    })
                })
            })?;
            // In the order of voxels, whatever the threads did.
            for (&voxel, d_mixed) in order.iter().zip(d_mixed.chunks_exact(row)) {
                let (places, weights) = (near.shares)(voxel);
                for (place, weight) in places.into_iter().zip(weights).filter(|(_, w)| *w != 0.0) {
                    let to = &mut d_states[place as usize * row..][..row];
                    to.iter_mut().zip(d_mixed).for_each(|(to, d)| *to += weight * d);
                }
            }
            spread.take(Source { spec, voxels: batch.voxels, derivatives })?;
        }
        Ok(d_states)
    }

    /// The other levels of the places.
    fn pull_back_coarse(
        &self,
        of: Contents<'_>,
        near: &Near<'_>,
        d_states: &[f32],
        networks: &Networks,
        spread: &mut Spread<'_>,
    ) -> Result<(), PredictError> {
        let spec = StencilSpec::paper();
        let stencils = self.stencils(of, spec)?;
        let order = near_order(near.places);
        for order in order.chunks(spread.room(&spec)) {
            let voxels = order.iter().map(|&i| near.places[i as usize]).collect();
            let batch = Batch { voxels, order };
            let mut derivatives = vec![0.0; batch.voxels.len() * self.values_of(&stencils)];
            spread.reporting(order.len(), |control| {
                self.in_parts(&stencils, &batch, &mut derivatives, &mut [], control, |part| {
                    let d_states = self.gathered(part.order, d_states, networks.first.state_width());
                    networks.lend(|n| {
                        n.coarse_states(near.fine, part.stencils, &d_states, part.derivatives)
                    })
                })
            })?;
            spread.take(Source { spec, voxels: batch.voxels, derivatives })?;
        }
        Ok(())
    }

    /// Values of all channels of a stencil.
    fn values_of(&self, stencils: &Stencils<'_>) -> usize {
        self.coefficients().values_per_point(stencils.spec())
    }

    /// The rows `[channel][width]` of some positions.
    fn gathered(&self, order: &[u32], values: &[f32], width: usize) -> Vec<f32> {
        let row = self.coefficients().channels() * width;
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
        work: impl Fn(Part<'_>) -> Result<(), pellucid_rpnn::RpnnError> + Sync,
    ) -> Result<(), PredictError> {
        let count = batch.voxels.len();
        let size = (SAMPLES / self.coefficients().channels()).max(1);
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
                stencils.extract(self.coefficients(), voxels, &mut raw, &Control::none())?;
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

