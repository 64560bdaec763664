//! One level of a network: its activations, its forward and its backward pass.

use crate::Variant;
use crate::kernel::Add;
use crate::layers::{End, Layers};
use crate::variant::{Block, LEVEL_INPUTS, OCTANT_INPUTS, OCTANTS};

/// Activations of one level, each `[batch][width]` after its ReLU.
#[derive(Clone, Debug, Default)]
pub(crate) struct Level {
    /// The level's values: octants gathered, or the stencil as it is.
    pub input: Vec<f32>,
    pub hidden: Vec<f32>,
    pub entered: Vec<f32>,
    pub mixed: Vec<f32>,
    pub state: Vec<f32>,
}

impl Level {
    /// With `size` values each where a block needs them.
    pub fn new(size: usize, entry: bool, mixture: bool) -> Self {
        let buffer = |needed: bool| vec![0.0; if needed { size } else { 0 }];
        Self {
            input: buffer(true),
            hidden: buffer(entry),
            entered: buffer(entry),
            mixed: buffer(mixture),
            state: buffer(true),
        }
    }
}

/// Rows and row width of the layers that octants share, for `n` samples.
pub(crate) fn end_shape(variant: Variant, n: usize) -> (usize, usize) {
    if variant.shares_octants() { (n * OCTANTS, OCTANT_INPUTS) } else { (n, LEVEL_INPUTS) }
}

/// The state of a level from its input and the state before it.
pub(crate) fn forward_block(
    layers: &mut Layers,
    block: Block,
    level: &mut Level,
    previous: Option<&[f32]>,
    n: usize,
    variant: Variant,
) {
    let used = n * variant.width();
    if let Some([first, second]) = block.entry {
        let (rows, _) = end_shape(variant, n);
        layers.dense(first, &level.input[..used], &mut level.hidden[..used], rows);
        layers.dense(second, &level.hidden[..used], &mut level.entered[..used], rows);
    }
    let value = if block.entry.is_some() { &level.entered[..used] } else { &level.input[..used] };
    let Some([b, c]) = block.bc else {
        level.state[..used].copy_from_slice(value);
        return;
    };
    let mixed = &mut level.mixed[..used];
    // The first level's previous state is zero: its product is left out.
    let last = previous.is_none();
    let mut add = Add::Other(value);
    if let Some(a) = block.a {
        let end = End { add: Add::Nothing, bias: last.then_some(b), relu: last };
        layers.product(a, value, mixed, n, end);
        add = Add::Output;
    }
    if let Some(previous) = previous {
        layers.product(b, previous, mixed, n, End { add, bias: Some(b), relu: true });
    }
    let add = previous.map_or(Add::Nothing, Add::Other);
    layers.product(c, mixed, &mut level.state[..used], n, End { add, bias: Some(c), relu: true });
}

/// What a backward pass is made for.
pub(crate) enum Wanted<'a> {
    /// The gradient of the parameters, which is added to this one.
    Weights(&'a mut [f32]),
    /// Derivatives by the inputs of the levels.
    Inputs,
}

impl Wanted<'_> {
    /// Takes in a layer's matrix and bias.
    pub(crate) fn layer(
        &mut self,
        layers: &mut Layers,
        layer: usize,
        d_out: &[f32],
        input: &[f32],
        rows: usize,
    ) {
        if let Self::Weights(gradient) = self {
            layers.gradient(gradient, layer, d_out, input, rows);
        }
    }

    /// Takes in the bias alone of a layer whose input is zero.
    fn bias(&mut self, layers: &Layers, layer: usize, d_out: &[f32]) {
        if let Self::Weights(gradient) = self {
            layers.bias_gradient(gradient, layer, d_out);
        }
    }

    fn inputs(&self) -> bool {
        matches!(self, Self::Inputs)
    }
}

/// Takes a level's layers into what is wanted. `scratch` holds the derivative by this level's state before its ReLU on
/// entry and by the state before it, likewise, on return; a free buffer; and another, on return the derivative by the
/// level's input where that is wanted.
pub(crate) fn backward_block(
    layers: &mut Layers,
    block: Block,
    level: &Level,
    previous: Option<&[f32]>,
    n: usize,
    variant: Variant,
    scratch: [&mut [f32]; 3],
    wanted: &mut Wanted<'_>,
) {
    let used = n * variant.width();
    let [d_state, d_mid, d_next] = scratch;
    let has_entry = block.entry.is_some();
    let value = if has_entry { &level.entered[..used] } else { &level.input[..used] };
    // Derivative by the block's value v, in `d_next` for a full block and in `d_state` for o = v.
    let d_value: &mut [f32] = if let Some([b, c]) = block.bc {
        let mixed = &level.mixed[..used];
        wanted.layer(layers, c, d_state, mixed, n);
        layers.derivative(c, d_state, d_mid, n, Add::Nothing, Some(mixed));
        if let Some(previous) = previous {
            wanted.layer(layers, b, d_mid, previous, n);
            layers.derivative(b, d_mid, d_state, n, Add::Output, Some(previous));
        } else {
            wanted.bias(layers, b, d_mid);
        }
        if let Some(a) = block.a {
            wanted.layer(layers, a, d_mid, value, n);
            // Values that entered passed a ReLU; the input itself did not.
            if has_entry || wanted.inputs() {
                layers.derivative(a, d_mid, d_next, n, Add::Nothing, has_entry.then_some(value));
            }
        } else {
            d_next
                .iter_mut()
                .zip(&*d_mid)
                .zip(value)
                .for_each(|((d, &m), &v)| *d = if v > 0.0 { m } else { 0.0 });
        }
        &mut *d_next
    } else {
        d_state
    };
    if let Some([first, second]) = block.entry {
        let (rows, _) = end_shape(variant, n);
        let hidden = &level.hidden[..used];
        wanted.layer(layers, second, d_value, hidden, rows);
        layers.derivative(second, d_value, d_mid, rows, Add::Nothing, Some(hidden));
        wanted.layer(layers, first, d_mid, &level.input[..used], rows);
        if wanted.inputs() {
            layers.derivative(first, d_mid, d_next, rows, Add::Nothing, None);
        }
    }
}
