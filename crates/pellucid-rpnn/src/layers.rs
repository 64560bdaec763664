//! The layers of a network: weights packed for both passes, products with them, and their gradients.

use std::sync::Arc;

use pellucid_core::InstructionSet;

use crate::kernel::{Add, Finish, Form, Matrix, Packed, Products};
use crate::variant::Layer;
use crate::{Precision, Weights};

/// Weights packed for both passes, and scratch to multiply with them. Clones share the weights.
#[derive(Clone, Debug)]
pub(crate) struct Layers {
    precision: Precision,
    products: Products,
    packed: Arc<PackedWeights>,
}

/// Weights packed for both passes. The packing is the same for every form of the kernel.
#[derive(Clone, Debug)]
struct PackedWeights {
    weights: Weights,
    /// Each layer's matrix transposed: inputs to outputs.
    forward: Vec<Packed>,
    /// Each layer's matrix: derivatives by outputs to derivatives by inputs. Empty until it is needed.
    backward: Vec<Packed>,
    backward_is_fresh: bool,
}

impl Layers {
    pub(crate) fn new(weights: Weights, precision: Precision, set: InstructionSet) -> Self {
        let count = weights.layout().layers.len();
        let packed = PackedWeights {
            forward: vec![Packed::default(); count],
            backward: vec![Packed::default(); count],
            backward_is_fresh: false,
            weights,
        };
        let mut layers = Self { precision, products: Products::new(Form::of(set)), packed: Arc::new(packed) };
        layers.pack_forward();
        layers
    }

    pub(crate) fn weights(&self) -> &Weights {
        &self.packed.weights
    }

    pub(crate) fn precision(&self) -> Precision {
        self.precision
    }

    /// Whether both multiply with the same memory.
    #[cfg(test)]
    pub(crate) fn shares_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.packed, &other.packed)
    }

    /// The least instruction set that gives what these products give.
    pub(crate) fn instruction_set(&self) -> InstructionSet {
        self.products.form().instruction_set(self.precision)
    }

    pub(crate) fn set_instruction_set(&mut self, set: InstructionSet) {
        self.products = Products::new(Form::of(set));
    }

    pub(crate) fn load(&mut self, weights: &Weights) {
        let packed = Arc::make_mut(&mut self.packed);
        packed.weights.values_mut().copy_from_slice(weights.values());
        packed.backward_is_fresh = false;
        self.pack_forward();
    }

    fn pack_forward(&mut self) {
        let PackedWeights { weights, forward, .. } = Arc::make_mut(&mut self.packed);
        for (i, packed) in forward.iter_mut().enumerate() {
            let matrix = matrix(weights, &weights.layout().layers[i]);
            self.products.pack(matrix.t(), precision_of(self.precision, weights, i), packed);
        }
    }

    pub(crate) fn freshen_backward(&mut self) {
        if self.packed.backward_is_fresh {
            return;
        }
        let PackedWeights { weights, backward, backward_is_fresh, .. } = Arc::make_mut(&mut self.packed);
        for (i, packed) in backward.iter_mut().enumerate() {
            let matrix = matrix(weights, &weights.layout().layers[i]);
            self.products.pack(matrix, precision_of(self.precision, weights, i), packed);
        }
        *backward_is_fresh = true;
    }

    fn layer(&self, layer: usize) -> &Layer {
        &self.weights().layout().layers[layer]
    }

    /// `out = input W^T`, finished.
    pub(crate) fn product(
        &mut self,
        layer: usize,
        input: &[f32],
        out: &mut [f32],
        rows: usize,
        end: End<'_>,
    ) {
        let PackedWeights { weights, forward, .. } = &*self.packed;
        let layers = &weights.layout().layers;
        let bias = end.bias.map(|l| &weights.values()[layers[l].bias.clone()]);
        let finish = Finish { add: end.add, bias, relu: end.relu, mask: None };
        let left = Matrix::rows(input, rows, layers[layer].inputs);
        self.products.product(out, left, &forward[layer], finish);
    }

    /// `out = relu(input W^T + b)`.
    pub(crate) fn dense(&mut self, layer: usize, input: &[f32], out: &mut [f32], rows: usize) {
        self.product(layer, input, out, rows, End { add: Add::Nothing, bias: Some(layer), relu: true });
    }

    /// `d_input = d_out W + add`, zero where `mask` is not positive.
    pub(crate) fn derivative(
        &mut self,
        layer: usize,
        d_out: &[f32],
        d_input: &mut [f32],
        rows: usize,
        add: Add<'_>,
        mask: Option<&[f32]>,
    ) {
        let left = Matrix::rows(d_out, rows, self.layer(layer).outputs);
        self.products.product(
            d_input,
            left,
            &self.packed.backward[layer],
            Finish { add, mask, ..Finish::default() },
        );
    }

    /// Adds the gradients of a layer's matrix and bias.
    pub(crate) fn gradient(
        &mut self,
        gradient: &mut [f32],
        layer: usize,
        d_out: &[f32],
        input: &[f32],
        rows: usize,
    ) {
        let weights = &self.packed.weights;
        let precision = precision_of(self.precision, weights, layer);
        let Layer { inputs, outputs, weight, .. } = &weights.layout().layers[layer];
        self.products.product_once(
            &mut gradient[weight.clone()],
            Matrix::rows(d_out, rows, *outputs).t(),
            Matrix::rows(input, rows, *inputs),
            precision,
            Finish { add: Add::Output, ..Finish::default() },
        );
        self.bias_gradient(gradient, layer, d_out);
    }

    pub(crate) fn bias_gradient(&self, gradient: &mut [f32], layer: usize, d_out: &[f32]) {
        let bias = self.layer(layer).bias.clone();
        if !bias.is_empty() {
            self.products.add_rows(d_out, &mut gradient[bias]);
        }
    }
}

/// How [`Layers::product`] ends.
pub(crate) struct End<'a> {
    pub(crate) add: Add<'a>,
    /// The layer whose bias is added.
    pub(crate) bias: Option<usize>,
    pub(crate) relu: bool,
}

/// The last three layers take little time and their rounding errors go straight to the output.
fn precision_of(precision: Precision, weights: &Weights, layer: usize) -> Precision {
    if weights.layout().end.contains(&layer) { Precision::F32 } else { precision }
}

/// A layer's matrix, `[outputs][inputs]`.
fn matrix<'a>(weights: &'a Weights, layer: &Layer) -> Matrix<'a> {
    Matrix::rows(&weights.values()[layer.weight.clone()], layer.outputs, layer.inputs)
}
