//! Backward passes: derivatives by the parameters, or by the inputs.

use std::ops::Range;

use super::Network;
use crate::RpnnError;
use crate::block::{Wanted, backward_block, end_shape};
use crate::kernel::Add;
use crate::variant::{INPUTS, LEVEL_INPUTS, LEVELS, Layout, OCTANT_INPUTS};

impl Network {
    /// Adds the gradient of a loss to `gradient`, laid out like the weights, given its derivative by each
    /// sum that made an output of the last [`Network::forward`], `d_out` `[sample][output]`:
    /// [`Head::derivatives`](crate::variant::Head::derivatives) tells what passes the ReLU of a radiance.
    ///
    /// # Errors
    /// As [`Network::forward`].
    pub fn backward(&mut self, d_out: &[f32], gradient: &mut [f32]) -> Result<(), RpnnError> {
        let n = self.samples(d_out)?;
        if gradient.len() != self.layers.weights().values().len() {
            return Err(RpnnError::invalid("gradient", "its length is not that of the weights"));
        }
        let mut wanted = Wanted::Weights(gradient);
        self.backward_end(d_out, n, &mut wanted);
        self.backward_levels(0..LEVELS, n, &mut wanted, |_, _| ());
        Ok(())
    }

    /// Derivatives by the inputs of the last [`Network::forward`], `d_inputs` laid out as they were, given those by
    /// each sum that made an output as for [`Network::backward`]. They do not depend on the other samples.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the buffers' lengths differ or exceed the batch.
    pub fn backward_inputs(&mut self, d_out: &[f32], d_inputs: &mut [f32]) -> Result<(), RpnnError> {
        let n = self.samples(d_out)?;
        if d_inputs.len() != n * INPUTS {
            return Err(RpnnError::invalid(
                "derivatives by inputs",
                format!("{} values for {n} samples of {INPUTS}", d_inputs.len()),
            ));
        }
        self.backward_end(d_out, n, &mut Wanted::Inputs);
        self.backward_to_inputs(0..LEVELS, n, d_inputs);
        Ok(())
    }

    /// The same after [`Network::forward_from`](super::Network::forward_from) with as many `levels` read before: derivatives by the inputs of
    /// the other levels, and by what became the states that were given when it passed a ReLU.
    ///
    /// # Errors
    /// As [`Network::states`](super::Network::states).
    pub(crate) fn backward_from(
        &mut self,
        levels: usize,
        d_out: &[f32],
        d_states: &mut [f32],
        d_inputs: &mut [f32],
    ) -> Result<(), RpnnError> {
        let n = self.check_parts(levels, d_states, d_inputs.len(), LEVELS - levels.min(LEVELS))?;
        if self.samples(d_out)? != n {
            return Err(RpnnError::invalid("outputs", format!("{} values for {n} samples", d_out.len())));
        }
        self.backward_end(d_out, n, &mut Wanted::Inputs);
        self.backward_to_inputs(levels..LEVELS, n, d_inputs);
        d_states.copy_from_slice(&self.d_state[..d_states.len()]);
        Ok(())
    }

    /// The same after [`Network::states`](super::Network::states): derivatives by its inputs from those by the states that it gave.
    ///
    /// # Errors
    /// As [`Network::states`](super::Network::states).
    pub(crate) fn backward_states(
        &mut self,
        levels: usize,
        d_states: &[f32],
        d_inputs: &mut [f32],
    ) -> Result<(), RpnnError> {
        let n = self.check_parts(levels, d_states, d_inputs.len(), levels)?;
        self.layers.freshen_backward();
        let state = &self.levels[levels - 1].state;
        let passed = d_states.iter().zip(state).map(|(&d, &state)| if state > 0.0 { d } else { 0.0 });
        self.d_state.iter_mut().zip(passed).for_each(|(to, d)| *to = d);
        self.backward_to_inputs(0..levels, n, d_inputs);
        Ok(())
    }

    /// Packs the weights for backward passes, for all that share them from now on.
    pub(crate) fn prepare_backward(&mut self) {
        self.layers.freshen_backward();
    }

    /// From the outputs' sums to the last state's, before its ReLU.
    fn backward_end(&mut self, d_out: &[f32], n: usize, wanted: &mut Wanted<'_>) {
        let outputs = self.head().outputs();
        let layers = &mut self.layers;
        layers.freshen_backward();
        let Layout { end, .. } = *layers.weights().layout();
        let (rows, end_width) = end_shape(self.variant, n);
        let used = rows * end_width;
        let [e1, e2, e3] = end;
        let summed = (rows / n.max(1)).max(1);
        let terms = &mut self.terms[..rows * outputs];
        for (terms, d_out) in terms.chunks_exact_mut(summed * outputs).zip(d_out.chunks_exact(outputs)) {
            terms.chunks_exact_mut(outputs).for_each(|term| term.copy_from_slice(d_out));
        }
        let terms = &self.terms[..rows * outputs];
        let (d2, d1) = (&mut self.d_mid[..used], &mut self.d_next[..used]);
        let (end1, end2) = (&self.end1[..used], &self.end2[..used]);
        let state = &self.levels[LEVELS - 1].state[..used];
        wanted.layer(layers, e3, terms, end2, rows);
        layers.derivative(e3, terms, d2, rows, Add::Nothing, Some(end2));
        wanted.layer(layers, e2, d2, end1, rows);
        layers.derivative(e2, d2, d1, rows, Add::Nothing, Some(end1));
        wanted.layer(layers, e1, d1, state, rows);
        layers.derivative(e1, d1, &mut self.d_state[..used], rows, Add::Nothing, Some(state));
    }

    /// From the state of the last of some levels, read one after another, to that before the first. `read` is told the
    /// derivative by each level's input, where inputs are wanted.
    fn backward_levels(
        &mut self,
        range: Range<usize>,
        n: usize,
        wanted: &mut Wanted<'_>,
        mut read: impl FnMut(usize, &[f32]),
    ) {
        let (variant, width) = (self.variant, self.variant.width());
        let Layout { blocks, .. } = *self.layers.weights().layout();
        for k in range.rev() {
            let (before, rest) = self.levels.split_at(k);
            let previous = before.last().map(|l| &l.state[..n * width]);
            let scratch = [&mut self.d_state, &mut self.d_mid, &mut self.d_next].map(|v| &mut v[..n * width]);
            backward_block(&mut self.layers, blocks[k], &rest[0], previous, n, variant, scratch, wanted);
            read(k, &self.d_next[..n * width]);
        }
    }

    /// [`Network::backward_levels`] to the inputs of the levels, laid out as they were given.
    fn backward_to_inputs(&mut self, range: Range<usize>, n: usize, d_inputs: &mut [f32]) {
        let (variant, gather) = (self.variant, self.gather);
        let row = range.len() * LEVEL_INPUTS;
        self.backward_levels(range.clone(), n, &mut Wanted::Inputs, |k, derivatives| {
            let samples = d_inputs.chunks_exact_mut(row).zip(derivatives.chunks_exact(variant.width()));
            for (sample, derivatives) in samples {
                let level = &mut sample[(k - range.start) * LEVEL_INPUTS..][..LEVEL_INPUTS];
                if !variant.shares_octants() {
                    level.copy_from_slice(derivatives);
                    continue;
                }
                level.fill(0.0);
                for (octant, gather) in derivatives.chunks_exact(OCTANT_INPUTS).zip(&gather) {
                    octant.iter().zip(gather).for_each(|(d, &at)| level[usize::from(at)] += d);
                }
            }
        });
    }
}
