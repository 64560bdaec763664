//! The four variants as a module of candle.

use candle_core::{Result, Tensor};
use candle_nn::{Init, Linear, Module, VarBuilder};

use crate::variant::{
    Block, Head, LEVEL_INPUTS, LEVELS, Layer, Layout, OCTANT_INPUTS, OCTANTS, octant_gather,
};
use crate::weights::{bias, deviation};
use crate::{RpnnError, Variant, Weights};

/// The network of a variant and head on any device, in any float type.
///
/// [`Module::forward`] takes inputs `[samples][9][270]` in the form that the weights were trained on
/// ([`InputLayer`](super::InputLayer)) and gives radiance `[samples]` with [`Head::Radiance`], outputs `[samples][4]`
/// with [`Head::FirstFlight`].
#[derive(Clone, Debug)]
pub struct Rpnn {
    variant: Variant,
    head: Head,
    layout: Layout,
    /// In the layout's order.
    layers: Vec<Linear>,
    /// The positions of all octants' inputs within a level's, with ≡O.
    octants: Option<Tensor>,
}

impl Rpnn {
    /// Takes its tensors by the names and shapes of weight files: `level1.b.weight` `[outputs][inputs]`,
    /// `level1.b.bias` `[outputs]` and so on, as [`Variant::layout`] lists them. A builder over a
    /// [`VarMap`](candle_nn::VarMap) draws variables that are missing from the distributions of [`Weights::initial`],
    /// with the head's mean output.
    ///
    /// # Errors
    /// When a tensor is missing or of another shape, or the device fails.
    pub fn new(variant: Variant, head: Head, vb: VarBuilder<'_>) -> Result<Self> {
        let layout = variant.layout(head);
        let layers =
            layout.layers.iter().map(|layer| linear(variant, head, layer, &vb)).collect::<Result<_>>()?;
        let octants = match variant.shares_octants() {
            true => {
                let order: Vec<u32> = (0..OCTANTS).flat_map(|o| octant_gather(o).map(u32::from)).collect();
                Some(Tensor::from_vec(order, OCTANTS * OCTANT_INPUTS, vb.device())?)
            }
            false => None,
        };
        Ok(Self { variant, head, layout, layers, octants })
    }

    /// The architecture.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// What the last layer gives.
    pub fn head(&self) -> Head {
        self.head
    }

    /// The dense layers, in the order of [`Variant::layout`].
    pub fn layers(&self) -> &[Linear] {
        &self.layers
    }

    /// The parameters as they are now, for [`file::save`](crate::file::save) and the own kernels.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when one is not finite, [`RpnnError::Candle`] when the device fails.
    pub fn weights(&self) -> std::result::Result<Weights, RpnnError> {
        let mut values = Vec::with_capacity(self.layout.parameters);
        for layer in &self.layers {
            for tensor in std::iter::once(layer.weight()).chain(layer.bias()) {
                values.extend(tensor.to_dtype(candle_core::DType::F32)?.flatten_all()?.to_vec1::<f32>()?);
            }
        }
        Weights::new(self.variant, self.head, values)
    }

    /// The last layer's plain outputs `[samples][outputs]`: what [`Module::forward`] gives before its last ReLU,
    /// negative where a radiance is cut off to zero.
    ///
    /// # Errors
    /// When the inputs' shape, type or device is another.
    pub fn outputs(&self, inputs: &Tensor) -> Result<Tensor> {
        let (samples, levels, values) = inputs.dims3()?;
        if (levels, values) != (LEVELS, LEVEL_INPUTS) {
            candle_core::bail!("inputs {:?}; [samples, {LEVELS}, {LEVEL_INPUTS}] are read", inputs.dims());
        }
        let mut state = None;
        for (k, block) in self.layout.blocks.iter().enumerate() {
            let level = inputs.narrow(1, k, 1)?.squeeze(1)?.contiguous()?;
            state = Some(self.level(block, level, state)?);
        }
        let Some(state) = state else { candle_core::bail!("a network without levels") };
        let rows = match self.octants {
            Some(_) => state.reshape((samples * OCTANTS, OCTANT_INPUTS))?,
            None => state,
        };
        let [e1, e2, e3] = self.layout.end;
        let hidden = relu(&self.dense(e2, &relu(&self.dense(e1, &rows)?)?)?)?;
        self.dense(e3, &hidden)?.reshape((samples, (), self.head.outputs()))?.sum(1)
    }

    /// The state `[samples][width]` after a level's inputs `[samples][270]`; there is none before the first.
    fn level(&self, block: &Block, mut value: Tensor, state: Option<Tensor>) -> Result<Tensor> {
        let samples = value.dim(0)?;
        if let Some(octants) = &self.octants {
            value = value.index_select(octants, 1)?.reshape((samples * OCTANTS, OCTANT_INPUTS))?;
        }
        if let Some([first, second]) = block.entry {
            value = relu(&self.dense(first, &value)?)?;
            value = relu(&self.dense(second, &value)?)?;
        }
        value = value.reshape((samples, self.variant.width()))?;
        let Some([b, c]) = block.bc else { return Ok(value) };
        if let Some(a) = block.a {
            value = self.dense(a, &value)?;
        }
        let before = match &state {
            Some(state) => Some(self.dense(b, state)?),
            // Of the product with a state of zeros the bias is left.
            None => self.layers[b].bias().cloned(),
        };
        if let Some(before) = before {
            value = value.broadcast_add(&before)?;
        }
        let after = self.dense(c, &relu(&value)?)?;
        relu(&match state {
            Some(state) => (after + state)?,
            None => after,
        })
    }

    fn dense(&self, layer: usize, input: &Tensor) -> Result<Tensor> {
        self.layers[layer].forward(input)
    }
}

impl Module for Rpnn {
    fn forward(&self, inputs: &Tensor) -> Result<Tensor> {
        let outputs = self.outputs(inputs)?;
        match self.head {
            Head::Radiance => relu(&outputs.squeeze(1)?),
            Head::FirstFlight => Ok(outputs),
        }
    }
}

fn linear(variant: Variant, head: Head, layer: &Layer, vb: &VarBuilder<'_>) -> Result<Linear> {
    let vb = vb.pp(&layer.name);
    let drawn = Init::Randn { mean: 0.0, stdev: deviation(layer) };
    let weight = vb.get_with_hints((layer.outputs, layer.inputs), "weight", drawn)?;
    let bias = match layer.bias.is_empty() {
        true => None,
        false => {
            let start = f64::from(bias(layer, variant, head.mean_output()));
            Some(vb.get_with_hints(layer.outputs, "bias", Init::Const(start))?)
        }
    };
    Ok(Linear::new(weight, bias))
}

/// ReLU whose derivative at zero is zero, as in [`Network`](crate::Network); it is one in candle's own, which is faster
/// where no derivative is asked for. Sums are exactly zero where only zeros come in and the bias is zero, as it is when
/// a run starts.
pub(super) fn relu(sums: &Tensor) -> Result<Tensor> {
    match sums.track_op() {
        true => sums * sums.gt(0.0)?.to_dtype(sums.dtype())?,
        false => sums.relu(),
    }
}
