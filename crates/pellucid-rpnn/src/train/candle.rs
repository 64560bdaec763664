//! A trainer's passes on candle.

use candle_core::backprop::GradStore;
use candle_core::{DType, Device, Tensor};
use candle_nn::{VarBuilder, VarMap};

use crate::candle::{Rpnn, tensors};
use crate::variant::{Head, LEVEL_INPUTS, LEVELS};
use crate::{Precision, RpnnError, Weights};

/// The network over variables, and the plain outputs of the last forward pass.
#[derive(Default)]
pub(super) struct CandlePasses {
    network: Option<(VarMap, Rpnn)>,
    outputs: Option<Tensor>,
}

impl std::fmt::Debug for CandlePasses {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let network = self.network.as_ref().map(|(_, network)| network);
        f.debug_struct("CandlePasses").field("network", &network).finish_non_exhaustive()
    }
}

/// Copies of candle's variables share their memory, so a clone makes variables of its own when it needs them.
impl Clone for CandlePasses {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl CandlePasses {
    pub(super) fn new(precision: Precision) -> Result<Self, RpnnError> {
        match precision {
            Precision::F32 => Ok(Self::default()),
            Precision::Bf16 => Err(RpnnError::invalid("precision", "bf16; candle's engine takes f32 only")),
        }
    }

    pub(super) fn forward(
        &mut self,
        weights: &Weights,
        inputs: &[f32],
        out: &mut [f32],
    ) -> Result<(), RpnnError> {
        let head = weights.head();
        let (mut map, network) = match self.network.take() {
            Some(network) => network,
            None => {
                let map = VarMap::new();
                let vb = VarBuilder::from_varmap(&map, DType::F32, &Device::Cpu);
                let network = Rpnn::new(weights.variant(), head, vb)?;
                (map, network)
            }
        };
        map.set(tensors(weights, &Device::Cpu)?.iter())?;
        let samples = out.len() / head.outputs();
        let inputs = Tensor::from_slice(inputs, (samples, LEVELS, LEVEL_INPUTS), &Device::Cpu)?;
        let outputs = network.outputs(&inputs)?;
        for (out, value) in out.iter_mut().zip(outputs.flatten_all()?.to_vec1::<f32>()?) {
            *out = if head == Head::Radiance { value.max(0.0) } else { value };
        }
        self.network = Some((map, network));
        self.outputs = Some(outputs);
        Ok(())
    }

    pub(super) fn backward(&mut self, d_out: &[f32], gradient: &mut [f32]) -> Result<(), RpnnError> {
        let (Some((_, network)), Some(outputs)) = (&self.network, self.outputs.take()) else {
            return Err(RpnnError::invalid("gradient", "no forward pass precedes it"));
        };
        let d_outputs = Tensor::from_slice(d_out, outputs.shape(), &Device::Cpu)?;
        // The scalar whose derivative by each output is the loss's.
        let gradients = (outputs * d_outputs)?.sum_all()?.backward()?;
        add(network, &gradients, gradient)
    }
}

/// Adds the variables' gradients to a flat vector laid out like the weights.
fn add(network: &Rpnn, gradients: &GradStore, gradient: &mut [f32]) -> Result<(), RpnnError> {
    let layout = network.variant().layout(network.head());
    for (layer, linear) in layout.layers.iter().zip(network.layers()) {
        for (tensor, range) in [(Some(linear.weight()), &layer.weight), (linear.bias(), &layer.bias)] {
            let Some(of_tensor) = tensor.and_then(|t| gradients.get(t)) else { continue };
            let of_tensor = of_tensor.flatten_all()?.to_vec1::<f32>()?;
            gradient[range.clone()].iter_mut().zip(of_tensor).for_each(|(sum, g)| *sum += g);
        }
    }
    Ok(())
}
