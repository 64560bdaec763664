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

/// Adds the gradients of a level's layers. `scratch` holds the derivative by this level's state before its ReLU on entry and by the finer level's on
/// return, and two free buffers.
pub(crate) fn backward_block(
    layers: &mut Layers,
    block: Block,
    level: &Level,
    previous: Option<&[f32]>,
    n: usize,
    variant: Variant,
    scratch: [&mut [f32]; 3],
    gradient: &mut [f32],
) {
    let used = n * variant.width();
    let [d_state, d_mid, d_next] = scratch;
    let has_entry = block.entry.is_some();
    let value = if has_entry { &level.entered[..used] } else { &level.input[..used] };
    // Derivative by the block's value v, in `d_next` for a full block and in `d_state` for o = v.
    let d_value: &mut [f32] = if let Some([b, c]) = block.bc {
        let mixed = &level.mixed[..used];
        layers.gradient(gradient, c, d_state, mixed, n);
        layers.derivative(c, d_state, d_mid, n, Add::Nothing, Some(mixed));
        if let Some(previous) = previous {
            layers.gradient(gradient, b, d_mid, previous, n);
            layers.derivative(b, d_mid, d_state, n, Add::Output, Some(previous));
        } else {
            layers.bias_gradient(gradient, b, d_mid);
        }
        if let Some(a) = block.a {
            layers.gradient(gradient, a, d_mid, value, n);
            if has_entry {
                layers.derivative(a, d_mid, d_next, n, Add::Nothing, Some(value));
            }
        } else {
            d_next
                .iter_mut()
                .zip(&*d_mid)
                .zip(value)
                .for_each(|((d, &m), &v)| *d = if v > 0.0 { m } else { 0.0 });
        }
        d_next
    } else {
        d_state
    };
    if let Some([first, second]) = block.entry {
        let (rows, _) = end_shape(variant, n);
        let hidden = &level.hidden[..used];
        layers.gradient(gradient, second, d_value, hidden, rows);
        layers.derivative(second, d_value, d_mid, rows, Add::Nothing, Some(hidden));
        layers.gradient(gradient, first, d_mid, &level.input[..used], rows);
    }
}
