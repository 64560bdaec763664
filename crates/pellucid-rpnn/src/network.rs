//! Forward and backward passes of the four variants on packed matrix products, without allocation.
//!
//! The state o of a level is computed from the level's values x and the state p of the levels read before
//! (the paper's Figure 5c; finer ones there):
//!
//! ```text
//! v = two dense layers on each octant of x (≡O), or x        entry
//! y = relu(A v + B p + b)                                     A is the identity in ≡O alone
//! o = relu(C y + c + p)
//! ```
//!
//! The first level of the variants without ≡L is o = v. The end maps the last state through three dense
//! layers; with ≡O each octant's 60 values pass the same layers and the results are summed. ReLU everywhere, the
//! output too where it is the radiance; the outputs of [`Head::FirstFlight`] are plain sums.

mod backward;

use std::ops::Range;

use pellucid_core::InstructionSet;

use crate::block::{Level, end_shape, forward_block};
use crate::kernel::Add;
use crate::layers::{End, Layers};
use crate::variant::{
    Block, Head, INPUTS, LEVEL_INPUTS, LEVELS, Layout, OCTANT_INPUTS, OCTANTS, octant_gather,
};
use crate::{Precision, RpnnError, Variant, Weights};

/// The network with its weights and the memory of one batch: activations for the backward pass and scratch.
/// Clones share the packed weights until one of them loads others.
#[derive(Clone, Debug)]
pub struct Network {
    variant: Variant,
    batch: usize,
    gather: [[u16; OCTANT_INPUTS]; OCTANTS],
    layers: Layers,
    /// One a level, or two in turns where there is no backward pass.
    levels: Vec<Level>,
    end1: Vec<f32>,
    end2: Vec<f32>,
    terms: Vec<f32>,
    /// Derivatives; empty where there is no backward pass.
    d_state: Vec<f32>,
    d_mid: Vec<f32>,
    d_next: Vec<f32>,
}

impl Network {
    /// A network for batches of up to `batch` samples, its weights all zero, on [`InstructionSet::chosen`].
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] for a batch of 0 or more than 65,536.
    pub fn new(variant: Variant, head: Head, batch: usize, precision: Precision) -> Result<Self, RpnnError> {
        if !(1..=65_536).contains(&batch) {
            return Err(RpnnError::invalid("batch", format!("{batch}; 1 to 65536 are possible")));
        }
        let layers = Layers::new(Weights::zeros(variant, head), precision, InstructionSet::chosen());
        Ok(Self::with_all_levels(variant, batch, layers))
    }

    /// A network for forward passes alone.
    pub(crate) fn forward_only(weights: &Weights, batch: usize, precision: Precision) -> Self {
        let layers = Layers::new(weights.clone(), precision, InstructionSet::chosen());
        Self::with_two_levels(weights.variant(), batch, layers)
    }

    /// The same for forward passes alone, with buffers of its own and the weights shared.
    pub(crate) fn share(&self) -> Self {
        Self::with_two_levels(self.variant, self.batch, self.layers.clone())
    }

    /// The same for both passes, with buffers of its own and the weights shared.
    pub(crate) fn share_for_backward(&self) -> Self {
        Self::with_all_levels(self.variant, self.batch, self.layers.clone())
    }

    /// Whether both have the same memory for their weights.
    #[cfg(test)]
    pub(crate) fn shares_with(&self, other: &Self) -> bool {
        self.layers.shares_with(&other.layers)
    }

    /// The activations of all levels are kept for the backward pass.
    fn with_all_levels(variant: Variant, batch: usize, layers: Layers) -> Self {
        let size = batch * variant.width();
        let blocks = layers.weights().layout().blocks;
        let level = |block: Block| Level::new(size, block.entry.is_some(), block.bc.is_some());
        let derivatives = || vec![0.0; size];
        Self {
            d_state: derivatives(),
            d_mid: derivatives(),
            d_next: derivatives(),
            ..Self::with_levels(variant, batch, layers, blocks.into_iter().map(level).collect())
        }
    }

    /// The activations of two levels take turns.
    fn with_two_levels(variant: Variant, batch: usize, layers: Layers) -> Self {
        let level = || Level::new(batch * variant.width(), true, true);
        Self::with_levels(variant, batch, layers, vec![level(), level()])
    }

    fn with_levels(variant: Variant, batch: usize, layers: Layers, levels: Vec<Level>) -> Self {
        let size = batch * variant.width();
        Self {
            variant,
            batch,
            gather: std::array::from_fn(octant_gather),
            levels,
            end1: vec![0.0; size],
            end2: vec![0.0; size],
            terms: vec![0.0; batch * OCTANTS * layers.weights().head().outputs()],
            layers,
            d_state: Vec::new(),
            d_mid: Vec::new(),
            d_next: Vec::new(),
        }
    }

    /// The same on another instruction set. Sets agree to some units in the last place of a sum, not in every
    /// bit.
    ///
    /// # Errors
    /// [`RpnnError::Unsupported`] where the processor lacks it.
    pub fn with_instruction_set(mut self, set: InstructionSet) -> Result<Self, RpnnError> {
        self.layers.set_instruction_set(set.require().map_err(RpnnError::Unsupported)?);
        Ok(self)
    }

    /// The instruction set in use: the least one that gives the same bits. AVX2 and AVX-512 make the same sums of f32
    /// products, and of bf16 ones where AVX-512 lacks instructions for them.
    pub fn instruction_set(&self) -> InstructionSet {
        self.layers.instruction_set()
    }

    /// The architecture.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// What the last layer gives.
    pub fn head(&self) -> Head {
        self.layers.weights().head()
    }

    /// The format of the products.
    pub fn precision(&self) -> Precision {
        self.layers.precision()
    }

    /// Takes over weights.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when they belong to another variant or head.
    pub fn load(&mut self, weights: &Weights) -> Result<(), RpnnError> {
        let names = |variant: Variant, head: Head| format!("{} with head {}", variant.name(), head.name());
        if (weights.variant(), weights.head()) != (self.variant, self.head()) {
            let (theirs, own) = (names(weights.variant(), weights.head()), names(self.variant, self.head()));
            return Err(RpnnError::invalid("weights", format!("belong to {theirs}, the network is {own}")));
        }
        self.layers.load(weights);
        Ok(())
    }

    /// Outputs of each sample: `inputs` is `[sample][level][cell z][cell y][cell x][feature]` in the
    /// input form that the weights were trained on, `out` `[sample][output]`, see [`Head`].
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the buffers' lengths differ or exceed the batch.
    pub fn forward(&mut self, inputs: &[f32], out: &mut [f32]) -> Result<(), RpnnError> {
        let n = self.samples(out)?;
        if inputs.len() != n * INPUTS {
            return Err(RpnnError::invalid(
                "inputs",
                format!("{} values for {n} samples of {INPUTS}", inputs.len()),
            ));
        }
        self.forward_levels(inputs, 0..LEVELS, n);
        self.forward_end(out);
        Ok(())
    }

    /// The state of each sample after the first `levels` of the levels read: `inputs` is
    /// `[sample][level 0..levels][270]` after the input form, `states` `[sample][width]`.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree or exceed the batch, or there are not 1 to 8
    /// levels.
    pub fn states(&mut self, levels: usize, inputs: &[f32], states: &mut [f32]) -> Result<(), RpnnError> {
        let width = self.variant.width();
        let n = self.check_parts(levels, states, inputs.len(), levels)?;
        self.forward_levels(inputs, 0..levels, n);
        states.copy_from_slice(&self.level(levels - 1).state[..n * width]);
        Ok(())
    }

    /// [`Network::forward`] from the states that [`Network::states`] gave: `inputs` holds the other levels,
    /// `[sample][level levels..9][270]`.
    ///
    /// # Errors
    /// As [`Network::states`].
    pub fn forward_from(
        &mut self,
        levels: usize,
        states: &[f32],
        inputs: &[f32],
        out: &mut [f32],
    ) -> Result<(), RpnnError> {
        let n = self.check_parts(levels, states, inputs.len(), LEVELS - levels.min(LEVELS))?;
        if n * self.head().outputs() != out.len() {
            return Err(RpnnError::invalid("outputs", format!("{} values for {n} samples", out.len())));
        }
        let slot = self.slot(levels - 1);
        self.levels[slot].state[..states.len()].copy_from_slice(states);
        self.forward_levels(inputs, levels..LEVELS, n);
        self.forward_end(out);
        Ok(())
    }

    /// The number of samples of a part of the levels.
    fn check_parts(
        &self,
        levels: usize,
        states: &[f32],
        inputs: usize,
        given: usize,
    ) -> Result<usize, RpnnError> {
        let width = self.variant.width();
        let n = states.len() / width;
        if !(1..LEVELS).contains(&levels)
            || !states.len().is_multiple_of(width)
            || inputs != n * given * LEVEL_INPUTS
        {
            return Err(RpnnError::invalid(
                "levels, states and inputs",
                format!("{levels} levels, {} values in states of {width}, {inputs} inputs", states.len()),
            ));
        }
        self.check(n).map(|()| n)
    }

    fn forward_levels(&mut self, inputs: &[f32], range: Range<usize>, n: usize) {
        let width = self.variant.width();
        let Layout { blocks, .. } = *self.layers.weights().layout();
        for k in range.clone() {
            self.load_level(inputs, k, range.clone(), n);
            let (slot, before) = (self.slot(k), k.checked_sub(1).map(|k| self.slot(k)));
            let mut level = std::mem::take(&mut self.levels[slot]);
            let previous = before.map(|slot| &self.levels[slot].state[..n * width]);
            forward_block(&mut self.layers, blocks[k], &mut level, previous, n, self.variant);
            self.levels[slot] = level;
        }
    }

    /// Where the activations of a level are.
    fn slot(&self, level: usize) -> usize {
        level % self.levels.len()
    }

    fn level(&self, level: usize) -> &Level {
        &self.levels[self.slot(level)]
    }

    /// From the last state to the outputs.
    fn forward_end(&mut self, out: &mut [f32]) {
        let head = self.head();
        let outputs = head.outputs();
        let n = out.len() / outputs;
        let last = self.slot(LEVELS - 1);
        let layers = &mut self.layers;
        let Layout { end, .. } = *layers.weights().layout();
        let (rows, end_width) = end_shape(self.variant, n);
        let [e1, e2, e3] = end;
        let used = rows * end_width;
        layers.dense(e1, &self.levels[last].state[..used], &mut self.end1[..used], rows);
        layers.dense(e2, &self.end1[..used], &mut self.end2[..used], rows);
        let terms = &mut self.terms[..rows * outputs];
        layers.product(
            e3,
            &self.end2[..used],
            terms,
            rows,
            End { add: Add::Nothing, bias: Some(e3), relu: false },
        );
        let summed = (rows / n.max(1)).max(1);
        for (out, terms) in out.chunks_exact_mut(outputs).zip(terms.chunks_exact(summed * outputs)) {
            out.fill(0.0);
            for terms in terms.chunks_exact(outputs) {
                out.iter_mut().zip(terms).for_each(|(out, term)| *out += term);
            }
            if head == Head::Radiance {
                out.iter_mut().for_each(|out| *out = out.max(0.0));
            }
        }
    }

    /// The number of samples of a buffer of outputs.
    fn samples(&self, outputs: &[f32]) -> Result<usize, RpnnError> {
        let n = self.head().outputs();
        if !outputs.len().is_multiple_of(n) {
            return Err(RpnnError::invalid("outputs", format!("{} values; {n} a sample", outputs.len())));
        }
        self.check(outputs.len() / n).map(|()| outputs.len() / n)
    }

    fn check(&self, n: usize) -> Result<(), RpnnError> {
        if n > self.batch {
            return Err(RpnnError::invalid("samples", format!("{n} exceed the batch of {}", self.batch)));
        }
        Ok(())
    }

    /// Copies level `k` of every sample, octant by octant with ≡O; `inputs` holds the levels of `range`.
    fn load_level(&mut self, inputs: &[f32], k: usize, range: Range<usize>, n: usize) {
        let width = self.variant.width();
        let slot = self.slot(k);
        let target = &mut self.levels[slot].input[..n * width];
        let samples = inputs.chunks_exact(range.len() * LEVEL_INPUTS);
        for (row, sample) in target.chunks_exact_mut(width).zip(samples) {
            let level = &sample[(k - range.start) * LEVEL_INPUTS..][..LEVEL_INPUTS];
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
