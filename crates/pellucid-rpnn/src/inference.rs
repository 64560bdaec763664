//! Outputs and radiance of raw stencils, any number of them, on one thread.

use pellucid_core::InstructionSet;

use crate::transform::{InputForm, LevelOrder};
use crate::variant::{FirstFlight, Head, INPUTS, LEVEL_INPUTS, LEVELS};
use crate::{Network, Precision, RpnnError, Weights};

/// Samples of a batch: activations of all levels stay within a core's caches.
pub(crate) const BATCH: usize = 64;

/// A network ready to predict. Clones share the weights, so that every thread can have one.
///
/// ```
/// use pellucid_rpnn::transform::InputForm;
/// use pellucid_rpnn::variant::{Head, INPUTS};
/// use pellucid_rpnn::{Inference, Precision, Variant, Weights};
/// let weights = Weights::initial(Variant::SharedLevelsAndOctants, Head::Radiance, 1, 0.4);
/// let mut inference = Inference::new(&weights, InputForm::default(), Precision::F32).unwrap();
/// // Two points whose surroundings scatter and absorb alike everywhere: 6 and 0.1 per mm.
/// let stencils: Vec<f32> = [6.0, 0.1].into_iter().cycle().take(2 * INPUTS).collect();
/// let mut radiance = [0.0; 2];
/// // A network that gives radiance itself needs no first flights.
/// inference.radiance(&stencils, &[], &mut radiance).unwrap();
/// assert!(radiance[0] == radiance[1] && radiance[0] >= 0.0);
/// ```
#[derive(Debug)]
pub struct Inference {
    network: Network,
    form: InputForm,
    inputs: Vec<f32>,
    /// States of the samples of a batch that share them.
    states: Vec<f32>,
}

impl Clone for Inference {
    /// Shares the weights; buffers are new, and no memory is copied.
    fn clone(&self) -> Self {
        Self::of(self.network.share(), self.form)
    }
}

impl Inference {
    /// Prepares `weights`, trained on inputs of `form`, on [`InstructionSet::chosen`].
    ///
    /// # Errors
    /// None for valid weights; the signature leaves room for forms that a network cannot take.
    pub fn new(weights: &Weights, form: InputForm, precision: Precision) -> Result<Self, RpnnError> {
        Ok(Self::of(Network::forward_only(weights, BATCH, precision), form))
    }

    fn of(network: Network, form: InputForm) -> Self {
        Self { network, form, inputs: vec![0.0; BATCH * INPUTS], states: Vec::new() }
    }

    /// The same on another instruction set: [`Network::with_instruction_set`].
    ///
    /// # Errors
    /// [`RpnnError::Unsupported`] where the processor lacks it.
    pub fn with_instruction_set(mut self, set: InstructionSet) -> Result<Self, RpnnError> {
        self.network = self.network.with_instruction_set(set)?;
        Ok(self)
    }

    pub(crate) fn network(&self) -> &Network {
        &self.network
    }

    pub(crate) fn form(&self) -> InputForm {
        self.form
    }

    /// The instruction set in use: [`Network::instruction_set`].
    pub fn instruction_set(&self) -> InstructionSet {
        self.network.instruction_set()
    }

    /// What the last layer gives.
    pub fn head(&self) -> Head {
        self.network.head()
    }

    /// Outputs of each sample, `out` `[sample][output]` as [`Head`] says; `stencils` holds raw coefficients in 1/mm,
    /// `[sample][level][cell z][cell y][cell x][sigma_s, sigma_a]`. A sample's values do not depend on the others.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree.
    pub fn outputs(&mut self, stencils: &[f32], out: &mut [f32]) -> Result<(), RpnnError> {
        let outputs = self.head().outputs();
        if stencils.len() * outputs != out.len() * INPUTS {
            return Err(RpnnError::invalid(
                "stencils",
                format!("{} values of {INPUTS} a sample for {} outputs", stencils.len(), out.len()),
            ));
        }
        for (stencils, out) in stencils.chunks(BATCH * INPUTS).zip(out.chunks_mut(BATCH * outputs)) {
            let inputs = &mut self.inputs[..stencils.len()];
            inputs.copy_from_slice(stencils);
            for sample in inputs.as_chunks_mut::<INPUTS>().0 {
                self.form.apply(sample);
            }
            self.network.forward(inputs, out)?;
        }
        Ok(())
    }

    /// Radiance of each sample from its stencil, ordered as for [`Inference::outputs`], and its first flight, which
    /// [`Head::Radiance`] does without.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree.
    pub fn radiance(
        &mut self,
        stencils: &[f32],
        flights: &[FirstFlight],
        out: &mut [f32],
    ) -> Result<(), RpnnError> {
        if self.head() == Head::Radiance {
            return self.outputs(stencils, out);
        }
        if flights.len() != out.len() {
            return Err(RpnnError::invalid(
                "first flights",
                format!("{} for {} samples", flights.len(), out.len()),
            ));
        }
        let mut outputs = vec![0.0; out.len() * self.head().outputs()];
        self.outputs(stencils, &mut outputs)?;
        self.head().radiance(&outputs, flights, out);
        Ok(())
    }
}

/// What the network makes of the coarse levels of places, for the points near each of them to share.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoarseStates {
    /// Levels left for the points.
    fine: usize,
    /// `[place][width]`.
    values: Vec<f32>,
}

impl CoarseStates {
    pub(crate) fn fine(&self) -> usize {
        self.fine
    }

    pub(crate) fn values(&self) -> &[f32] {
        &self.values
    }

    /// Those of all `parts` in turn, which leave `fine` levels each.
    ///
    /// # Panics
    /// When a part that holds places leaves another number of levels.
    pub fn joined(fine: usize, parts: impl IntoIterator<Item = Self>) -> Self {
        let mut values = Vec::new();
        for part in parts {
            assert!(part.fine == fine || part.values.is_empty(), "parts leave different numbers of levels");
            values.extend(part.values);
        }
        Self { fine, values }
    }
}

impl Inference {
    /// Reads all levels but the `fine` finest of the stencils of places, raw and whole as for
    /// [`Inference::radiance`].
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the network reads its levels from fine to coarse, the lengths do not agree, or
    /// `fine` is not within 1 to 8.
    pub fn coarse_states(&mut self, fine: usize, stencils: &[f32]) -> Result<CoarseStates, RpnnError> {
        if self.form.order != LevelOrder::CoarseToFine {
            return Err(RpnnError::invalid(
                "weights",
                "read levels from fine to coarse; sharing needs weights trained with the other order",
            ));
        }
        if !(1..LEVELS).contains(&fine) || !stencils.len().is_multiple_of(INPUTS) {
            return Err(RpnnError::invalid(
                "stencils and fine levels",
                format!("{} values, {fine} levels; whole stencils of {INPUTS}, 1 to 8", stencils.len()),
            ));
        }
        let (coarse, width) = (LEVELS - fine, self.network.variant().width());
        let mut values = vec![0.0; stencils.len() / INPUTS * width];
        for (stencils, states) in stencils.chunks(BATCH * INPUTS).zip(values.chunks_mut(BATCH * width)) {
            let n = states.len() / width;
            let inputs = &mut self.inputs[..n * coarse * LEVEL_INPUTS];
            let rows = inputs.chunks_exact_mut(coarse * LEVEL_INPUTS);
            for (row, stencil) in rows.zip(stencils.chunks_exact(INPUTS)) {
                row.copy_from_slice(&stencil[fine * LEVEL_INPUTS..]);
                self.form.apply_levels(fine, row);
            }
            self.network.states(coarse, inputs, states)?;
        }
        Ok(CoarseStates { fine, values })
    }

    /// Outputs of samples from their own finest levels and the coarse ones of places nearby: `stencils` is
    /// `[sample][fine][cell z][cell y][cell x][sigma_s, sigma_a]`, 1/mm, `places` and `weights` are
    /// `[sample][share]` with as many shares a sample as there are places for each: positions in `states` and what each
    /// counts. `out` is `[sample][output]`. With the sample's own stencil as its only place and weight 1, bit for bit
    /// [`Inference::outputs`].
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree.
    pub fn outputs_near(
        &mut self,
        states: &CoarseStates,
        places: &[u32],
        weights: &[f32],
        stencils: &[f32],
        out: &mut [f32],
    ) -> Result<(), RpnnError> {
        let (row, width) = (states.fine * LEVEL_INPUTS, self.network.variant().width());
        let outputs = self.head().outputs();
        let samples = out.len() / outputs;
        if samples * outputs != out.len() {
            return Err(RpnnError::invalid("outputs", format!("{} values; {outputs} a sample", out.len())));
        }
        let shares = check_near(states, width, samples, places, weights, stencils)?;
        self.states.resize(BATCH * width, 0.0);
        for first in (0..samples).step_by(BATCH) {
            let part = first..samples.min(first + BATCH);
            let inputs = &mut self.inputs[..part.len() * row];
            inputs.copy_from_slice(&stencils[part.start * row..part.end * row]);
            inputs.chunks_exact_mut(row).for_each(|sample| self.form.apply_levels(0, sample));
            let used = &mut self.states[..part.len() * width];
            for (sample, state) in part.clone().zip(used.chunks_exact_mut(width)) {
                let shares = sample * shares..(sample + 1) * shares;
                mix(&states.values, width, &places[shares.clone()], &weights[shares], state);
            }
            let out = &mut out[part.start * outputs..part.end * outputs];
            self.network.forward_from(LEVELS - states.fine, used, inputs, out)?;
        }
        Ok(())
    }
}

/// How many places there are for each sample.
pub(crate) fn check_near(
    states: &CoarseStates,
    width: usize,
    samples: usize,
    places: &[u32],
    weights: &[f32],
    stencils: &[f32],
) -> Result<usize, RpnnError> {
    let shares = places.len() / samples.max(1);
    if stencils.len() != samples * states.fine * LEVEL_INPUTS
        || places.len() != samples * shares
        || weights.len() != places.len()
    {
        return Err(RpnnError::invalid(
            "stencils and places",
            format!(
                "{} values, {} places and {} weights for {samples} samples",
                stencils.len(),
                places.len(),
                weights.len(),
            ),
        ));
    }
    let count = states.values.len() / width;
    match places.iter().find(|p| **p as usize >= count) {
        Some(place) => Err(RpnnError::invalid("places", format!("{place}; there are {count}"))),
        None => Ok(shares),
    }
}

/// The weighted sum of some rows of `width` values.
pub(crate) fn mix(values: &[f32], width: usize, places: &[u32], weights: &[f32], state: &mut [f32]) {
    let row = |place: u32| &values[place as usize * width..][..width];
    let mut shares = places.iter().zip(weights).filter(|(_, weight)| **weight != 0.0);
    let Some((&place, &weight)) = shares.next() else { return state.fill(0.0) };
    state.iter_mut().zip(row(place)).for_each(|(sum, v)| *sum = weight * v);
    for (&place, &weight) in shares {
        state.iter_mut().zip(row(place)).for_each(|(sum, v)| *sum += weight * v);
    }
    // States are what ReLUs gave; a plane through them may pass below.
    state.iter_mut().for_each(|v| *v = v.max(0.0));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Variant;
    use crate::transform::FeatureTransform;

    #[test]
    fn values_do_not_depend_on_the_company() {
        let variant = Variant::SharedLevelsAndOctants;
        let weights = Weights::initial(variant, Head::Radiance, 3, 8.0);
        for precision in [Precision::F32, Precision::Bf16] {
            let mut inference = Inference::new(&weights, InputForm::default(), precision).unwrap();
            let n = BATCH + 37;
            let raw: Vec<f32> = (0..n * INPUTS).map(|i| (i * 7919 % 1009) as f32 * 0.01).collect();
            let mut together = vec![0.0; n];
            inference.radiance(&raw, &[], &mut together).unwrap();
            assert!(together.iter().any(|&v| v > 0.0));
            for i in [0, 1, 11, 12, 63, 64, 100] {
                let mut alone = [0.0];
                inference.radiance(&raw[i * INPUTS..(i + 1) * INPUTS], &[], &mut alone).unwrap();
                assert_eq!(alone[0], together[i], "{precision:?} sample {i}");
            }
            assert!(inference.radiance(&raw[1..], &[], &mut together).is_err());
        }
    }

    #[test]
    fn clones_share_the_weights_and_predict_alike() {
        let variant = Variant::SharedLevelsAndOctants;
        let first = Inference::new(
            &Weights::initial(variant, Head::Radiance, 3, 8.0),
            InputForm::default(),
            Precision::F32,
        )
        .unwrap();
        let mut clone = first.clone();
        assert!(clone.network.shares_with(&first.network));
        // A clone that is used by another thread does not see the first one's buffers.
        let raw: Vec<f32> = (0..2 * INPUTS).map(|i| (i * 7919 % 1009) as f32 * 0.001).collect();
        let radiance = |mut inference: Inference| {
            let mut out = [0.0; 2];
            inference.radiance(&raw, &[], &mut out).unwrap();
            out
        };
        let (a, b) = std::thread::scope(|scope| {
            let other = scope.spawn(|| radiance(first.clone()));
            (radiance(first.clone()), other.join().unwrap())
        });
        clone.radiance(&raw[INPUTS..], &[], &mut [0.0]).unwrap();
        assert!(a == b && a == radiance(clone) && a[0] > 0.0, "{a:?} {b:?}");
    }

    /// Within the tolerance of products on other forms: some units in the last place of each of nine levels.
    #[test]
    fn instruction_sets_agree() {
        let form = InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine };
        let n = 20;
        let raw: Vec<f32> = (0..n * INPUTS).map(|i| (i * 7919 % 1009) as f32 * 0.001).collect();
        for variant in Variant::ALL {
            let weights = Weights::initial(variant, Head::Radiance, 3, 8.0);
            for (precision, tolerance) in [(Precision::F32, 1e-5), (Precision::Bf16, 1e-2)] {
                let inference = Inference::new(&weights, form, precision).unwrap();
                let mut results = InstructionSet::available().map(|set| {
                    let mut on_set = inference.clone().with_instruction_set(set).unwrap();
                    assert!(
                        on_set.instruction_set() <= set && on_set.network.shares_with(&inference.network)
                    );
                    let mut out = vec![0.0; n];
                    on_set.radiance(&raw, &[], &mut out).unwrap();
                    (set, out)
                });
                let (_, portable) = results.next().unwrap();
                assert!(portable.iter().all(|&v| v > 0.1), "{variant:?}: dark outputs prove nothing");
                for (set, out) in results {
                    for (a, b) in out.iter().zip(&portable) {
                        assert!(
                            (a - b).abs() <= tolerance * (1.0 + b),
                            "{variant:?} {precision:?} {set}: {a} {b}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_set_that_is_lacking_is_refused() {
        let weights = Weights::zeros(Variant::SharedLevels, Head::Radiance);
        let inference = Inference::new(&weights, InputForm::default(), Precision::F32).unwrap();
        for set in InstructionSet::ALL {
            let result = inference.clone().with_instruction_set(set);
            assert_eq!(result.is_ok(), set <= InstructionSet::detect(), "{set}");
            assert!(!matches!(result, Err(ref e) if !matches!(e, RpnnError::Unsupported(_))));
        }
    }

    #[test]
    fn sharing_with_oneself_changes_no_bit() {
        let variant = Variant::SharedLevelsAndOctants;
        let weights = Weights::initial(variant, Head::Radiance, 3, 8.0);
        let form = InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine };
        let n = BATCH + 9;
        let raw: Vec<f32> = (0..n * INPUTS).map(|i| (i * 7919 % 1009) as f32 * 0.01).collect();
        for precision in [Precision::F32, Precision::Bf16] {
            let mut inference = Inference::new(&weights, form, precision).unwrap();
            let mut whole = vec![0.0; n];
            inference.radiance(&raw, &[], &mut whole).unwrap();
            for fine in [1, 4, 8] {
                let finest: Vec<f32> =
                    raw.chunks_exact(INPUTS).flat_map(|s| s[..fine * LEVEL_INPUTS].to_vec()).collect();
                // Places in the reverse order of the samples.
                let places: Vec<u32> = (0..n as u32).rev().collect();
                let reversed: Vec<f32> = raw.chunks_exact(INPUTS).rev().flatten().copied().collect();
                let states = inference.coarse_states(fine, &reversed).unwrap();
                let mut shared = vec![0.0; n];
                inference.outputs_near(&states, &places, &vec![1.0; n], &finest, &mut shared).unwrap();
                assert_eq!(shared, whole, "{precision:?}, {fine} fine levels");
                // Two shares of one place are that place.
                let twice: Vec<u32> = places.iter().flat_map(|&p| [p, p]).collect();
                let halves = vec![0.5; 2 * n];
                inference.outputs_near(&states, &twice, &halves, &finest, &mut shared).unwrap();
                assert_eq!(shared, whole);
                // Another place's surroundings do matter.
                inference.outputs_near(&states, &vec![0; n], &vec![1.0; n], &finest, &mut shared).unwrap();
                assert_ne!(shared, whole);
                assert!(
                    inference
                        .outputs_near(&states, &vec![n as u32; n], &vec![1.0; n], &finest, &mut shared)
                        .is_err()
                );
                assert!(inference.outputs_near(&states, &places, &vec![1.0; n], &raw, &mut shared).is_err());
            }
            assert!(inference.coarse_states(0, &raw).is_err() && inference.coarse_states(9, &raw).is_err());
        }
        let mut other = Inference::new(&weights, InputForm::default(), Precision::F32).unwrap();
        assert!(other.coarse_states(4, &raw).unwrap_err().to_string().contains("order"));
    }
}
