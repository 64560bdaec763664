//! The network's outputs in candle.

use candle_core::{DType, Device, Tensor};
use candle_nn::Module;
use pellucid_core::{Control, InstructionSet};
use pellucid_rpnn::candle::{InputLayer, Rpnn};
use pellucid_rpnn::variant::{Head, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_stencil::{Coefficients, StencilSpec, Stencils, near_order};

use super::pipeline;
use crate::PredictError;
use crate::network::evaluate::{Contents, Evaluator, Outputs};
use crate::network::trained_range::TrainedRange;

/// The network of one object on a device.
pub(super) struct Engine {
    pub inputs: InputLayer,
    pub rpnn: Rpnn,
    pub device: Device,
    pub dtype: DType,
    pub coefficients: Coefficients,
    pub trained: TrainedRange,
    pub instruction_set: InstructionSet,
    /// Voxels whose stencils make a batch.
    pub voxels: usize,
    /// Whether stencils are extracted while the device computes.
    pub beside: bool,
}

/// The stencils of some voxels, followed by empty ones up to a whole batch.
struct Batch {
    stencils: Vec<f32>,
    /// `[voxel][channel]`: whether the surroundings lie outside what training saw.
    outside: Vec<bool>,
}

impl Engine {
    fn extract(&self, of: &Stencils<'_>, voxels: &[[u32; 3]]) -> Result<Batch, PredictError> {
        let channels = self.coefficients.channels();
        // Always whole batches: a sample's values could depend on how many others a product has.
        let mut stencils = vec![0.0; self.voxels * channels * INPUTS];
        let used = &mut stencils[..voxels.len() * channels * INPUTS];
        of.extract(&self.coefficients, voxels, used, &Control::none())?;
        let outside = used.chunks_exact(INPUTS).map(|s| self.trained.misses(s)).collect();
        Ok(Batch { stencils, outside })
    }

    /// `[sample][output]` of a whole batch.
    fn compute(&self, stencils: Vec<f32>) -> candle_core::Result<Vec<f32>> {
        let samples = stencils.len() / INPUTS;
        let stencils = Tensor::from_vec(stencils, (samples, LEVELS, LEVEL_INPUTS), &self.device)?;
        let inputs = self.inputs.forward(&stencils)?.to_dtype(self.dtype)?;
        self.rpnn.forward(&inputs)?.to_dtype(DType::F32)?.flatten_all()?.to_vec1()
    }
}

impl Evaluator for Engine {
    fn head(&self) -> Head {
        self.rpnn.head()
    }

    fn outputs(
        &self,
        of: Contents<'_>,
        voxels: &[[u32; 3]],
        control: &Control<'_>,
    ) -> Result<Outputs, PredictError> {
        let stencils = Stencils::new(StencilSpec::paper(), of.labels, of.table)?
            .with_instruction_set(self.instruction_set)?;
        let order = near_order(voxels);
        let batches: Vec<&[u32]> = order.chunks(self.voxels).collect();
        let channels = self.coefficients.channels();
        let row = channels * self.head().outputs();
        let mut all =
            Outputs { values: vec![0.0; voxels.len() * row], outside: vec![false; voxels.len() * channels] };
        let mut done = 0;
        let produce = |batch: usize| -> Result<Batch, PredictError> {
            control.check()?;
            let near: Vec<[u32; 3]> = batches[batch].iter().map(|&i| voxels[i as usize]).collect();
            let made = self.extract(&stencils, &near)?;
            // The last batch counts once it is back from the device, with the whole.
            if done > 0 {
                control.report(done, voxels.len() as u64);
            }
            done += near.len() as u64;
            Ok(made)
        };
        let consume = |batch: usize, made: Batch| -> Result<(), PredictError> {
            let values = self.compute(made.stencils).map_err(|e| PredictError::failed("rpnn", e))?;
            let rows = values.chunks_exact(row).zip(made.outside.chunks_exact(channels));
            for (&i, (values, outside)) in batches[batch].iter().zip(rows) {
                all.values[i as usize * row..][..row].copy_from_slice(values);
                all.outside[i as usize * channels..][..channels].copy_from_slice(outside);
            }
            Ok(())
        };
        pipeline::run(batches.len(), self.beside, produce, consume)?;
        control.check()?;
        control.report(voxels.len() as u64, voxels.len() as u64);
        Ok(all)
    }
}
