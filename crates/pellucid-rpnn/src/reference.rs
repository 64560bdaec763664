//! The network on candle: the readable reference, and the oracle of the hand-written gradients.

use candle_core::{DType, Device, Result, Tensor, Var};

use crate::Weights;
use crate::variant::{CELLS, FEATURES, LEVEL_INPUTS, LEVELS, OCTANT_INPUTS, OCTANTS, octant_gather};

/// A variant whose parameters are candle variables.
#[derive(Debug)]
pub struct CandleNetwork {
    weights: Weights,
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
        Ok(Self { weights: weights.clone(), parameters, octants })
    }

    /// The variables in layout order: matrix, and bias where the layer has one.
    pub fn parameters(&self) -> &[(Var, Option<Var>)] {
        &self.parameters
    }

    /// Radiance `[samples]` of inputs `[samples][9][270]` after the feature transform.
    ///
    /// # Errors
    /// When the shape is another.
    pub fn forward(&self, inputs: &Tensor) -> Result<Tensor> {
        let (n, _) = inputs.reshape(((), LEVELS * CELLS * FEATURES))?.dims2()?;
        let inputs = inputs.reshape((n, LEVELS, LEVEL_INPUTS))?;
        let layout = self.weights.layout();
        let width = self.weights.variant().width();
        let shares_octants = self.weights.variant().shares_octants();
        let mut previous = Tensor::zeros((n, width), DType::F32, inputs.device())?;
        for (k, block) in layout.blocks.iter().enumerate() {
            let mut value = inputs.narrow(1, k, 1)?.squeeze(1)?.contiguous()?;
            if shares_octants {
                value = value.index_select(&self.octants, 1)?.reshape((n * OCTANTS, OCTANT_INPUTS))?;
            }
            if let Some([first, second]) = block.entry {
                value = self.dense(first, &value)?.relu()?;
                value = self.dense(second, &value)?.relu()?;
            }
            value = value.reshape((n, width))?;
            previous = match block.bc {
                None => value,
                Some([b, c]) => {
                    if let Some(a) = block.a {
                        value = self.dense(a, &value)?;
                    }
                    let mixed = (value + self.dense(b, &previous)?)?.relu()?;
                    (self.dense(c, &mixed)? + previous)?.relu()?
                }
            };
        }
        let rows = if shares_octants { previous.reshape((n * OCTANTS, OCTANT_INPUTS))? } else { previous };
        let [e1, e2, e3] = layout.end;
        let hidden = self.dense(e2, &self.dense(e1, &rows)?.relu()?)?.relu()?;
        self.dense(e3, &hidden)?.reshape((n, ()))?.sum(1)?.relu()
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
