//! A trainer's passes on candle.

use candle_core::{Device, Tensor};

use crate::reference::CandleNetwork;
use crate::variant::{Head, LEVEL_INPUTS, LEVELS};
use crate::{Precision, RpnnError, Weights};

/// The network, and the outputs of the last forward pass before their ReLU.
#[derive(Debug)]
pub(super) struct CandlePasses {
    network: Option<CandleNetwork>,
    sums: Option<Tensor>,
}

/// Copies of candle's variables share their memory, so a clone makes variables of its own when it needs them.
impl Clone for CandlePasses {
    fn clone(&self) -> Self {
        Self { network: None, sums: None }
    }
}

impl CandlePasses {
    pub(super) fn new(precision: Precision) -> Result<Self, RpnnError> {
        match precision {
            Precision::F32 => Ok(Self { network: None, sums: None }),
            Precision::Bf16 => Err(RpnnError::invalid("precision", "bf16; candle's engine takes f32 only")),
        }
    }

    pub(super) fn forward(
        &mut self,
        weights: &Weights,
        inputs: &[f32],
        out: &mut [f32],
    ) -> Result<(), RpnnError> {
        let network = match self.network.take() {
            Some(mut network) => {
                network.load(weights)?;
                network
            }
            None => CandleNetwork::new(weights)?,
        };
        let head = weights.head();
        let samples = out.len() / head.outputs();
        let inputs = Tensor::from_slice(inputs, (samples, LEVELS, LEVEL_INPUTS), &Device::Cpu)?;
        let sums = self.network.insert(network).sums(&inputs)?;
        for (out, sum) in out.iter_mut().zip(sums.flatten_all()?.to_vec1::<f32>()?) {
            *out = if head == Head::Radiance { sum.max(0.0) } else { sum };
        }
        self.sums = Some(sums);
        Ok(())
    }

    pub(super) fn backward(&mut self, d_out: &[f32], gradient: &mut [f32]) -> Result<(), RpnnError> {
        let (Some(network), Some(sums)) = (&self.network, self.sums.take()) else {
            return Err(RpnnError::invalid("gradient", "no forward pass precedes it"));
        };
        let d_sums = Tensor::from_slice(d_out, sums.shape(), &Device::Cpu)?;
        // The scalar whose derivative by each sum is the loss's.
        let gradients = (sums * d_sums)?.sum_all()?.backward()?;
        Ok(network.add_gradients(&gradients, gradient)?)
    }
}
