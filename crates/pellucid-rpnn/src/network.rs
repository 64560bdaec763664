//! Forward and backward passes of the four variants on packed matrix products, without allocation.
//!
//! The state o of a level is computed from the level's values x and the finer levels' state p
//! (the paper's Figure 5c):
//!
//! ```text
//! v = two dense layers on each octant of x (≡O), or x        entry
//! y = relu(A v + B p + b)                                     A is the identity in ≡O alone
//! o = relu(C y + c + p)
//! ```
//!
//! The first level of the variants without ≡L is o = v. The end maps the last state through three dense
//! layers; with ≡O each octant's 60 values pass the same layers and the results are summed. ReLU everywhere,
//! the output too.

use crate::kernel::{Matrix, product};
use crate::variant::{Block, INPUTS, LEVEL_INPUTS, LEVELS, Layer, OCTANT_INPUTS, OCTANTS, octant_gather};
use crate::{RpnnError, Variant, Weights};

/// Number format of the products; sums, weights and everything between the products are f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Precision {
    /// Both factors in f32.
    #[default]
    F32,
    /// Both factors rounded to bf16, except in the last three layers.
    Bf16,
}

/// The network with its weights and the memory of one batch: activations for the backward pass and scratch.
#[derive(Clone, Debug)]
pub struct Network {
    weights: Weights,
    variant: Variant,
    precision: Precision,
    batch: usize,
    gather: [[u16; OCTANT_INPUTS]; OCTANTS],
    levels: Vec<Level>,
    end1: Vec<f32>,
    end2: Vec<f32>,
    terms: Vec<f32>,
    d_state: Vec<f32>,
    d_mid: Vec<f32>,
    d_next: Vec<f32>,
}

/// Activations of one level, each `[batch][width]` after its ReLU.
#[derive(Clone, Debug, Default)]
struct Level {
    /// The level's values: octants gathered, or the stencil as it is.
    input: Vec<f32>,
    hidden: Vec<f32>,
    entered: Vec<f32>,
    mixed: Vec<f32>,
    state: Vec<f32>,
}

impl Network {
    /// A network for batches of up to `batch` samples, its weights all zero.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] for a batch of 0 or more than 65,536.
    pub fn new(variant: Variant, batch: usize, precision: Precision) -> Result<Self, RpnnError> {
        if !(1..=65_536).contains(&batch) {
            return Err(RpnnError::invalid("batch", format!("{batch}; 1 to 65536 are possible")));
        }
        let width = batch * variant.width();
        let layout = variant.layout();
        let levels = layout
            .blocks
            .iter()
            .map(|block| {
                let buffer = |needed: bool| vec![0.0; if needed { width } else { 0 }];
                Level {
                    input: buffer(true),
                    hidden: buffer(block.entry.is_some()),
                    entered: buffer(block.entry.is_some()),
                    mixed: buffer(block.bc.is_some()),
                    state: buffer(true),
                }
            })
            .collect();
        Ok(Self {
            weights: Weights::zeros(variant),
            variant,
            precision,
            batch,
            gather: std::array::from_fn(octant_gather),
            levels,
            end1: vec![0.0; width],
            end2: vec![0.0; width],
            terms: vec![0.0; batch * OCTANTS],
            d_state: vec![0.0; width],
            d_mid: vec![0.0; width],
            d_next: vec![0.0; width],
        })
    }

    /// The architecture.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// The format of the products.
    pub fn precision(&self) -> Precision {
        self.precision
    }

    /// Takes over weights.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when they belong to another variant.
    pub fn load(&mut self, weights: &Weights) -> Result<(), RpnnError> {
        if weights.variant() != self.variant {
            return Err(RpnnError::invalid(
                "weights",
                format!("belong to {}, the network is {}", weights.variant().name(), self.variant.name()),
            ));
        }
        self.weights.values_mut().copy_from_slice(weights.values());
        Ok(())
    }

    /// Radiance of each sample: `inputs` is `[sample][level][cell z][cell y][cell x][feature]` after the
    /// feature transform, `out` `[sample]`.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the buffers' lengths differ or exceed the batch.
    pub fn forward(&mut self, inputs: &[f32], out: &mut [f32]) -> Result<(), RpnnError> {
        let n = out.len();
        self.check(n)?;
        if inputs.len() != n * INPUTS {
            return Err(RpnnError::invalid(
                "inputs",
                format!("{} values for {n} samples of {INPUTS}", inputs.len()),
            ));
        }
        let width = self.variant.width();
        for k in 0..LEVELS {
            self.load_level(inputs, k, n);
        }
        let weights = &self.weights;
        let layout = weights.layout();
        for k in 0..LEVELS {
            let (finer, rest) = self.levels.split_at_mut(k);
            let previous = finer.last().map(|l| &l.state[..n * width]);
            forward_block(weights, layout.blocks[k], &mut rest[0], previous, n, self.variant);
        }
        let (rows, end_width) = end_shape(self.variant, n);
        let [e1, e2, e3] = layout.end.map(|i| &layout.layers[i]);
        let used = rows * end_width;
        dense(weights, e1, &self.levels[LEVELS - 1].state[..used], &mut self.end1[..used], rows);
        dense(weights, e2, &self.end1[..used], &mut self.end2[..used], rows);
        let terms = &mut self.terms[..rows];
        product(
            terms,
            false,
            Matrix::rows(&self.end2[..used], rows, end_width, end_width),
            matrix(weights, e3).t(),
        );
        let bias = weights.values()[e3.bias.start];
        let summed = rows / n.max(1);
        for (out, terms) in out.iter_mut().zip(terms.chunks_exact(summed.max(1))) {
            *out = terms.iter().map(|t| t + bias).sum::<f32>().max(0.0);
        }
        Ok(())
    }

    /// Adds the gradient of a loss to `gradient`, laid out like the weights, given its derivative by each
    /// output of the last [`Network::forward`] (`out` as that call left it, `d_out` `[sample]`).
    ///
    /// An output that its ReLU cut off to zero passes on what would raise it, or a network whose outputs
    /// are all cut off would never learn again.
    ///
    /// # Errors
    /// As [`Network::forward`].
    pub fn backward(&mut self, out: &[f32], d_out: &[f32], gradient: &mut [f32]) -> Result<(), RpnnError> {
        let n = out.len();
        self.check(n)?;
        if d_out.len() != n || gradient.len() != self.weights.values().len() {
            return Err(RpnnError::invalid("gradient", "buffers do not match the outputs and the weights"));
        }
        let width = self.variant.width();
        let weights = &self.weights;
        let layout = weights.layout();
        let (rows, end_width) = end_shape(self.variant, n);
        let used = rows * end_width;
        let [e1, e2, e3] = layout.end.map(|i| &layout.layers[i]);
        let summed = rows / n.max(1);
        for (i, term) in self.terms[..rows].iter_mut().enumerate() {
            let sample = i / summed;
            *term = if out[sample] > 0.0 { d_out[sample] } else { d_out[sample].min(0.0) };
        }
        let terms = &self.terms[..rows];
        weight_gradient(gradient, e3, terms, &self.end2[..used], rows);
        product(&mut self.d_mid[..used], false, Matrix::rows(terms, rows, 1, 1), matrix(weights, e3));
        mask(&mut self.d_mid[..used], &self.end2[..used]);
        weight_gradient(gradient, e2, &self.d_mid[..used], &self.end1[..used], rows);
        let d1 = &mut self.d_next[..used];
        product(
            d1,
            false,
            Matrix::rows(&self.d_mid[..used], rows, end_width, end_width),
            matrix(weights, e2),
        );
        mask(d1, &self.end1[..used]);
        weight_gradient(gradient, e1, d1, &self.levels[LEVELS - 1].state[..used], rows);
        product(
            &mut self.d_state[..used],
            false,
            Matrix::rows(d1, rows, end_width, end_width),
            matrix(weights, e1),
        );

        for k in (0..LEVELS).rev() {
            let (finer, rest) = self.levels.split_at_mut(k);
            let previous = finer.last().map(|l| &l.state[..n * width]);
            let scratch = [&mut self.d_state, &mut self.d_mid, &mut self.d_next].map(|v| &mut v[..n * width]);
            backward_block(weights, layout.blocks[k], &rest[0], previous, n, self.variant, scratch, gradient);
        }
        Ok(())
    }

    fn check(&self, n: usize) -> Result<(), RpnnError> {
        if n > self.batch {
            return Err(RpnnError::invalid("samples", format!("{n} exceed the batch of {}", self.batch)));
        }
        Ok(())
    }

    /// Copies level `k` of every sample, octant by octant with ≡O.
    fn load_level(&mut self, inputs: &[f32], k: usize, n: usize) {
        let width = self.variant.width();
        let target = &mut self.levels[k].input[..n * width];
        for (row, sample) in target.chunks_exact_mut(width).zip(inputs.chunks_exact(INPUTS)) {
            let level = &sample[k * LEVEL_INPUTS..(k + 1) * LEVEL_INPUTS];
            if self.variant.shares_octants() {
                for (octant, gather) in row.chunks_exact_mut(OCTANT_INPUTS).zip(&self.gather) {
                    octant.iter_mut().zip(gather).for_each(|(v, &i)| *v = level[usize::from(i)]);
                }
            } else {
                row.copy_from_slice(level);
            }
        }
    }
}

/// Rows and row width of the layers that octants share, for `n` samples.
fn end_shape(variant: Variant, n: usize) -> (usize, usize) {
    if variant.shares_octants() { (n * OCTANTS, OCTANT_INPUTS) } else { (n, LEVEL_INPUTS) }
}

fn forward_block(
    weights: &Weights,
    block: Block,
    level: &mut Level,
    previous: Option<&[f32]>,
    n: usize,
    variant: Variant,
) {
    let width = variant.width();
    let used = n * width;
    let layers = &weights.layout().layers;
    if let Some([first, second]) = block.entry {
        let (rows, _) = end_shape(variant, n);
        dense(weights, &layers[first], &level.input[..used], &mut level.hidden[..used], rows);
        dense(weights, &layers[second], &level.hidden[..used], &mut level.entered[..used], rows);
    }
    let value = if block.entry.is_some() { &level.entered[..used] } else { &level.input[..used] };
    let Some([b, c]) = block.bc else {
        level.state[..used].copy_from_slice(value);
        return;
    };
    let mixed = &mut level.mixed[..used];
    match block.a {
        Some(a) => {
            product(mixed, false, Matrix::rows(value, n, width, width), matrix(weights, &layers[a]).t())
        }
        None => mixed.copy_from_slice(value),
    }
    // The first level's previous state is zero: its product is left out.
    if let Some(previous) = previous {
        product(mixed, true, Matrix::rows(previous, n, width, width), matrix(weights, &layers[b]).t());
    }
    bias_relu(mixed, &weights.values()[layers[b].bias.clone()]);
    let state = &mut level.state[..used];
    match previous {
        Some(previous) => state.copy_from_slice(previous),
        None => state.fill(0.0),
    }
    product(state, true, Matrix::rows(mixed, n, width, width), matrix(weights, &layers[c]).t());
    bias_relu(state, &weights.values()[layers[c].bias.clone()]);
}

/// `scratch` holds the derivative by this level's state on entry and by the finer level's on return, and
/// two free buffers.
fn backward_block(
    weights: &Weights,
    block: Block,
    level: &Level,
    previous: Option<&[f32]>,
    n: usize,
    variant: Variant,
    scratch: [&mut [f32]; 3],
    gradient: &mut [f32],
) {
    let width = variant.width();
    let used = n * width;
    let layers = &weights.layout().layers;
    let [d_state, d_mid, d_next] = scratch;
    let value = if block.entry.is_some() { &level.entered[..used] } else { &level.input[..used] };
    // Derivative by the block's value v, in `d_next` for a full block and in `d_state` for o = v.
    let d_value: &mut [f32] = if let Some([b, c]) = block.bc {
        mask(d_state, &level.state[..used]);
        weight_gradient(gradient, &layers[c], d_state, &level.mixed[..used], n);
        product(d_mid, false, Matrix::rows(d_state, n, width, width), matrix(weights, &layers[c]));
        mask(d_mid, &level.mixed[..used]);
        if let Some(previous) = previous {
            weight_gradient(gradient, &layers[b], d_mid, previous, n);
            product(d_state, true, Matrix::rows(d_mid, n, width, width), matrix(weights, &layers[b]));
        } else {
            bias_gradient(gradient, &layers[b], d_mid);
        }
        match block.a {
            Some(a) => {
                weight_gradient(gradient, &layers[a], d_mid, value, n);
                if block.entry.is_none() {
                    return;
                }
                product(d_next, false, Matrix::rows(d_mid, n, width, width), matrix(weights, &layers[a]));
            }
            None => d_next.copy_from_slice(d_mid),
        }
        d_next
    } else {
        d_state
    };
    if let Some([first, second]) = block.entry {
        let (rows, row_width) = end_shape(variant, n);
        mask(d_value, value);
        weight_gradient(gradient, &layers[second], d_value, &level.hidden[..used], rows);
        product(
            d_mid,
            false,
            Matrix::rows(d_value, rows, row_width, row_width),
            matrix(weights, &layers[second]),
        );
        mask(d_mid, &level.hidden[..used]);
        weight_gradient(gradient, &layers[first], d_mid, &level.input[..used], rows);
    }
}

/// A layer's matrix, `[outputs][inputs]`.
fn matrix<'a>(weights: &'a Weights, layer: &Layer) -> Matrix<'a> {
    Matrix::rows(&weights.values()[layer.weight.clone()], layer.outputs, layer.inputs, layer.inputs)
}

/// `out = relu(input W^T + b)` over `rows` rows.
fn dense(weights: &Weights, layer: &Layer, input: &[f32], out: &mut [f32], rows: usize) {
    product(out, false, Matrix::rows(input, rows, layer.inputs, layer.inputs), matrix(weights, layer).t());
    bias_relu(out, &weights.values()[layer.bias.clone()]);
}

fn bias_relu(values: &mut [f32], bias: &[f32]) {
    for row in values.chunks_exact_mut(bias.len()) {
        row.iter_mut().zip(bias).for_each(|(v, b)| *v = (*v + b).max(0.0));
    }
}

/// Zeroes derivatives where the activation was cut off.
fn mask(derivative: &mut [f32], activation: &[f32]) {
    derivative.iter_mut().zip(activation).for_each(|(d, &a)| {
        if a <= 0.0 {
            *d = 0.0;
        }
    });
}

/// Adds the gradients of a layer's matrix and bias.
fn weight_gradient(gradient: &mut [f32], layer: &Layer, d_out: &[f32], input: &[f32], rows: usize) {
    let d_out_t = Matrix::rows(d_out, rows, layer.outputs, layer.outputs).t();
    let input = Matrix::rows(input, rows, layer.inputs, layer.inputs);
    product(&mut gradient[layer.weight.clone()], true, d_out_t, input);
    bias_gradient(gradient, layer, d_out);
}

fn bias_gradient(gradient: &mut [f32], layer: &Layer, d_out: &[f32]) {
    if layer.bias.is_empty() {
        return;
    }
    let gradient = &mut gradient[layer.bias.clone()];
    for row in d_out.chunks_exact(layer.outputs) {
        gradient.iter_mut().zip(row).for_each(|(g, d)| *g += d);
    }
}
