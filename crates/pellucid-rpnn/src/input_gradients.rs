//! Derivatives of outputs by raw stencils, any number of them, on one thread.

use crate::inference::{BATCH, CoarseStates, Inference, check_near, mix};
use crate::transform::InputForm;
use crate::variant::{INPUTS, LEVEL_INPUTS, LEVELS};
use crate::{Network, RpnnError};

/// A network ready to carry derivatives by its outputs back to the stencils: [`Inference::input_gradients`]. Clones
/// share the weights, so that every thread can have one.
///
/// ```
/// use pellucid_rpnn::transform::InputForm;
/// use pellucid_rpnn::variant::{Head, INPUTS};
/// use pellucid_rpnn::{Inference, Precision, Variant, Weights};
/// let weights = Weights::initial(Variant::SharedLevelsAndOctants, Head::FirstFlight, 1, 0.6);
/// let inference = Inference::new(&weights, InputForm::default(), Precision::F32).unwrap();
/// let stencil: Vec<f32> = [6.0, 0.1].into_iter().cycle().take(INPUTS).collect();
/// // What the first of the four outputs depends on.
/// let mut d_stencil = vec![0.0; INPUTS];
/// inference.input_gradients().outputs(&stencil, &[1.0, 0.0, 0.0, 0.0], &mut d_stencil).unwrap();
/// assert!(d_stencil.iter().any(|&d| d != 0.0));
/// ```
#[derive(Debug)]
pub struct InputGradients {
    network: Network,
    form: InputForm,
    inputs: Vec<f32>,
    states: Vec<f32>,
    out: Vec<f32>,
}

impl Clone for InputGradients {
    /// Shares the weights; buffers are new, and no memory is copied.
    fn clone(&self) -> Self {
        Self::of(self.network.share_for_backward(), self.form)
    }
}

impl Inference {
    /// Derivatives of this network's outputs, in its precision and on its instruction set.
    pub fn input_gradients(&self) -> InputGradients {
        let mut network = self.network().share_for_backward();
        network.prepare_backward();
        InputGradients::of(network, self.form())
    }
}

impl InputGradients {
    fn of(network: Network, form: InputForm) -> Self {
        let out = vec![0.0; BATCH * network.head().outputs()];
        let states = vec![0.0; BATCH * network.variant().width()];
        Self { inputs: vec![0.0; BATCH * INPUTS], network, form, states, out }
    }

    /// Values of a sample's state in [`CoarseStates`].
    pub fn state_width(&self) -> usize {
        self.network.variant().width()
    }

    /// Derivatives of `sum(d_outputs * outputs)` by the raw coefficients of stencils, `d_stencils` laid out like
    /// `stencils` as for [`Inference::outputs`] and `d_outputs` like the outputs there. The last ReLU of
    /// [`Head::Radiance`](crate::variant::Head::Radiance) is taken as passed: give 0 where a radiance is 0. A sample's
    /// derivatives do not depend on the others.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree.
    pub fn outputs(
        &mut self,
        stencils: &[f32],
        d_outputs: &[f32],
        d_stencils: &mut [f32],
    ) -> Result<(), RpnnError> {
        let outputs = self.network.head().outputs();
        check(stencils, d_outputs.len() / outputs * INPUTS, d_stencils)?;
        let batches = stencils.chunks(BATCH * INPUTS).zip(d_outputs.chunks(BATCH * outputs));
        for ((stencils, d_outputs), d_stencils) in batches.zip(d_stencils.chunks_mut(BATCH * INPUTS)) {
            let inputs = self.form.applied(0, LEVELS, stencils, &mut self.inputs);
            self.network.forward(inputs, &mut self.out[..d_outputs.len()])?;
            self.network.backward_inputs(d_outputs, d_stencils)?;
            self.form.pull_back(0, LEVELS, stencils, d_stencils);
        }
        Ok(())
    }

    /// Derivatives of `sum(d_outputs * outputs)` as [`Inference::outputs_near`] gives them: `d_stencils` by the samples'
    /// own finest levels, laid out like `stencils`, and `d_mixed`, `[sample][`[`width`](Self::state_width)`]`, by the
    /// state that is mixed for each of them. That times what a place counts for the sample is what the sample adds to
    /// the derivative by the place's own state, which [`InputGradients::coarse_states`] carries on.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree.
    pub fn outputs_near(
        &mut self,
        states: &CoarseStates,
        places: &[u32],
        weights: &[f32],
        stencils: &[f32],
        d_outputs: &[f32],
        d_stencils: &mut [f32],
        d_mixed: &mut [f32],
    ) -> Result<(), RpnnError> {
        let (outputs, width) = (self.network.head().outputs(), self.state_width());
        let (fine, row) = (states.fine(), states.fine() * LEVEL_INPUTS);
        let samples = d_outputs.len() / outputs;
        let shares = check_near(states, width, samples, places, weights, stencils)?;
        check(stencils, samples * row, d_stencils)?;
        if samples * outputs != d_outputs.len() || samples * width != d_mixed.len() {
            return Err(RpnnError::invalid(
                "derivatives",
                format!("{} by outputs, {} by states of {width}", d_outputs.len(), d_mixed.len()),
            ));
        }
        for first in (0..samples).step_by(BATCH) {
            let part = first..samples.min(first + BATCH);
            let of = |width: usize| part.start * width..part.end * width;
            let inputs = self.form.applied(0, fine, &stencils[of(row)], &mut self.inputs);
            let used = &mut self.states[..part.len() * width];
            for (sample, state) in part.clone().zip(used.chunks_exact_mut(width)) {
                let shares = sample * shares..(sample + 1) * shares;
                mix(states.values(), width, &places[shares.clone()], &weights[shares], state);
            }
            let coarse = LEVELS - fine;
            self.network.forward_from(coarse, used, inputs, &mut self.out[..part.len() * outputs])?;
            let (d_stencils, d_mixed) = (&mut d_stencils[of(row)], &mut d_mixed[of(width)]);
            self.network.backward_from(coarse, &d_outputs[of(outputs)], d_mixed, d_stencils)?;
            self.form.pull_back(0, fine, &stencils[of(row)], d_stencils);
        }
        Ok(())
    }

    /// Derivatives by the raw stencils of places, whole as for [`Inference::coarse_states`], from those by their
    /// states, `[place][`[`width`](Self::state_width)`]`: zero in the `fine` finest levels.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree or `fine` is not within 1 to 8.
    pub fn coarse_states(
        &mut self,
        fine: usize,
        stencils: &[f32],
        d_states: &[f32],
        d_stencils: &mut [f32],
    ) -> Result<(), RpnnError> {
        if !(1..LEVELS).contains(&fine) {
            return Err(RpnnError::invalid("fine levels", format!("{fine}; 1 to 8 are possible")));
        }
        let (width, coarse) = (self.state_width(), LEVELS - fine);
        check(stencils, d_states.len() / width * INPUTS, d_stencils)?;
        let (row, skipped) = (coarse * LEVEL_INPUTS, fine * LEVEL_INPUTS);
        let mut d_inputs = vec![0.0; BATCH * row];
        let mut raw = vec![0.0; BATCH * row];
        let batches = stencils.chunks(BATCH * INPUTS).zip(d_states.chunks(BATCH * width));
        for ((stencils, d_states), d_stencils) in batches.zip(d_stencils.chunks_mut(BATCH * INPUTS)) {
            let n = stencils.len() / INPUTS;
            let (raw, d_inputs) = (&mut raw[..n * row], &mut d_inputs[..n * row]);
            for (raw, stencil) in raw.chunks_exact_mut(row).zip(stencils.chunks_exact(INPUTS)) {
                raw.copy_from_slice(&stencil[skipped..]);
            }
            let inputs = self.form.applied(fine, coarse, raw, &mut self.inputs);
            self.network.states(coarse, inputs, &mut self.states[..n * width])?;
            self.network.backward_states(coarse, d_states, d_inputs)?;
            self.form.pull_back(fine, coarse, raw, d_inputs);
            for (to, from) in d_stencils.chunks_exact_mut(INPUTS).zip(d_inputs.chunks_exact(row)) {
                to[..skipped].fill(0.0);
                to[skipped..].copy_from_slice(from);
            }
        }
        Ok(())
    }
}

impl InputForm {
    /// Some levels of samples in this form, in a buffer.
    fn applied<'a>(self, first: usize, levels: usize, raw: &[f32], buffer: &'a mut [f32]) -> &'a [f32] {
        let inputs = &mut buffer[..raw.len()];
        inputs.copy_from_slice(raw);
        inputs.chunks_exact_mut(levels * LEVEL_INPUTS).for_each(|s| self.apply_levels(first, s));
        inputs
    }

    /// Derivatives of samples by some levels in this form become those by the raw values.
    fn pull_back(self, first: usize, levels: usize, raw: &[f32], derivatives: &mut [f32]) {
        let row = levels * LEVEL_INPUTS;
        let samples = derivatives.chunks_exact_mut(row).zip(raw.chunks_exact(row));
        samples.for_each(|(d, raw)| self.pull_back_levels(first, raw, d));
    }
}

fn check(stencils: &[f32], expected: usize, d_stencils: &[f32]) -> Result<(), RpnnError> {
    if stencils.len() == expected && d_stencils.len() == expected {
        return Ok(());
    }
    Err(RpnnError::invalid(
        "stencils and derivatives",
        format!("{} and {} values where {expected} are wanted", stencils.len(), d_stencils.len()),
    ))
}
