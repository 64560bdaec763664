//! The network on candle: the readable reference, and the oracle of the hand-written gradients.

use candle_core::backprop::GradStore;
use candle_core::{DType, Device, Result, Tensor, Var, bail};

use crate::variant::{
    CELLS, FEATURES, Head, LEVEL_INPUTS, LEVELS, Layout, OCTANT_INPUTS, OCTANTS, octant_gather,
};
use crate::{Variant, Weights};

/// A variant whose parameters are candle variables.
#[derive(Debug)]
pub struct CandleNetwork {
    variant: Variant,
    head: Head,
    layout: Layout,
    parameters: Vec<(Var, Option<Var>)>,
    octants: Tensor,
}

impl CandleNetwork {
    /// Copies the parameters into variables of the CPU.
    ///
    /// # Errors
    /// When candle cannot allocate.
    pub fn new(weights: &Weights) -> Result<Self> {
        let device = &Device::Cpu;
        let values = weights.values();
        let parameters = weights
            .layout()
            .layers
            .iter()
            .map(|l| {
                let weight = Var::from_slice(&values[l.weight.clone()], (l.outputs, l.inputs), device)?;
                let bias = match l.bias.is_empty() {
                    true => None,
                    false => Some(Var::from_slice(&values[l.bias.clone()], l.outputs, device)?),
                };
                Ok((weight, bias))
            })
            .collect::<Result<_>>()?;
        let order: Vec<u32> = (0..OCTANTS).flat_map(|o| octant_gather(o).map(u32::from)).collect();
        let octants = Tensor::from_vec(order, OCTANTS * OCTANT_INPUTS, device)?;
        Ok(Self {
            variant: weights.variant(),
            head: weights.head(),
            layout: weights.layout().clone(),
            parameters,
            octants,
        })
    }

    /// The variables in layout order: matrix, and bias where the layer has one.
    pub fn parameters(&self) -> &[(Var, Option<Var>)] {
        &self.parameters
    }

    /// Copies other parameters into the same variables. A result computed before has no valid gradient then.
    ///
    /// # Errors
    /// When the weights belong to another variant.
    pub fn load(&mut self, weights: &Weights) -> Result<()> {
        if (weights.variant(), weights.head()) != (self.variant, self.head) {
            bail!("weights of {} for a network of {}", weights.variant().name(), self.variant.name());
        }
        let values = weights.values();
        for (layer, (weight, bias)) in self.layout.layers.iter().zip(&self.parameters) {
            weight.set(&Tensor::from_slice(
                &values[layer.weight.clone()],
                weight.shape(),
                weight.device(),
            )?)?;
            if let Some(bias) = bias {
                bias.set(&Tensor::from_slice(&values[layer.bias.clone()], bias.shape(), bias.device())?)?;
            }
        }
        Ok(())
    }

    /// Outputs `[samples][outputs]` of inputs `[samples][9][270]` in the input form that the weights were trained on.
    ///
    /// # Errors
    /// When the shape is another.
    pub fn forward(&self, inputs: &Tensor) -> Result<Tensor> {
        let sums = self.sums(inputs)?;
        if self.head == Head::Radiance { relu(&sums) } else { Ok(sums) }
    }

    /// [`CandleNetwork::forward`] before its last ReLU: negative where an output is cut off to zero.
    ///
    /// # Errors
    /// When the shape is another.
    pub fn sums(&self, inputs: &Tensor) -> Result<Tensor> {
        let (n, _) = inputs.reshape(((), LEVELS * CELLS * FEATURES))?.dims2()?;
        let inputs = inputs.reshape((n, LEVELS, LEVEL_INPUTS))?;
        let layout = &self.layout;
        let width = self.variant.width();
        let shares_octants = self.variant.shares_octants();
        let mut previous = Tensor::zeros((n, width), DType::F32, inputs.device())?;
        for (k, block) in layout.blocks.iter().enumerate() {
            let mut value = inputs.narrow(1, k, 1)?.squeeze(1)?.contiguous()?;
            if shares_octants {
                value = value.index_select(&self.octants, 1)?.reshape((n * OCTANTS, OCTANT_INPUTS))?;
            }
            if let Some([first, second]) = block.entry {
                value = relu(&self.dense(first, &value)?)?;
                value = relu(&self.dense(second, &value)?)?;
            }
            value = value.reshape((n, width))?;
            previous = match block.bc {
                None => value,
                Some([b, c]) => {
                    if let Some(a) = block.a {
                        value = self.dense(a, &value)?;
                    }
                    let mixed = relu(&(value + self.dense(b, &previous)?)?)?;
                    relu(&(self.dense(c, &mixed)? + previous)?)?
                }
            };
        }
        let rows = if shares_octants { previous.reshape((n * OCTANTS, OCTANT_INPUTS))? } else { previous };
        let [e1, e2, e3] = layout.end;
        let hidden = relu(&self.dense(e2, &relu(&self.dense(e1, &rows)?)?)?)?;
        self.dense(e3, &hidden)?.reshape((n, (), self.head.outputs()))?.sum(1)
    }

    /// Adds the variables' gradients to a flat vector laid out like the weights.
    ///
    /// # Errors
    /// When the vector's length is not the weights'.
    pub fn add_gradients(&self, gradients: &GradStore, gradient: &mut [f32]) -> Result<()> {
        if gradient.len() != self.layout.parameters {
            bail!("a gradient of {} values for {} parameters", gradient.len(), self.layout.parameters);
        }
        for (layer, (weight, bias)) in self.layout.layers.iter().zip(&self.parameters) {
            for (var, range) in [(Some(weight), &layer.weight), (bias.as_ref(), &layer.bias)] {
                let Some(of_var) = var.and_then(|var| gradients.get(var)) else { continue };
                let of_var = of_var.flatten_all()?.to_vec1::<f32>()?;
                gradient[range.clone()].iter_mut().zip(of_var).for_each(|(sum, g)| *sum += g);
            }
        }
        Ok(())
    }

    fn dense(&self, layer: usize, input: &Tensor) -> Result<Tensor> {
        let (weight, bias) = &self.parameters[layer];
        let product = input.matmul(&weight.t()?)?;
        match bias {
            Some(bias) => product.broadcast_add(bias),
            None => Ok(product),
        }
    }
}

/// ReLU whose derivative at zero is zero, as in [`Network`](crate::Network); it is one in candle's own. Sums
/// are exactly zero where only zeros come in and the bias is zero, as it is when a run starts.
fn relu(sums: &Tensor) -> Result<Tensor> {
    sums * sums.gt(0.0)?.to_dtype(sums.dtype())?
}
