//! Radiance of raw stencils, any number of them, on one thread.

use crate::transform::InputForm;
use crate::variant::INPUTS;
use crate::{Network, Precision, RpnnError, Weights};

/// Samples of a batch: activations of all levels stay within a core's caches.
const BATCH: usize = 64;

/// A network ready to predict.
#[derive(Clone, Debug)]
pub struct Inference {
    network: Network,
    form: InputForm,
    inputs: Vec<f32>,
}

impl Inference {
    /// Prepares `weights`, trained on inputs of `form`.
    ///
    /// # Errors
    /// As [`Network::new`].
    pub fn new(weights: &Weights, form: InputForm, precision: Precision) -> Result<Self, RpnnError> {
        let mut network = Network::new(weights.variant(), BATCH, precision)?;
        network.load(weights)?;
        Ok(Self { network, form, inputs: vec![0.0; BATCH * INPUTS] })
    }

    /// Radiance of each sample; `stencils` holds raw coefficients in 1/mm, `[sample][level][cell z][cell
    /// y][cell x][sigma_s, sigma_a]`. A sample's value does not depend on the others.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when the lengths do not agree.
    pub fn radiance(&mut self, stencils: &[f32], out: &mut [f32]) -> Result<(), RpnnError> {
        if stencils.len() != out.len() * INPUTS {
            return Err(RpnnError::invalid(
                "stencils",
                format!("{} values for {} samples of {INPUTS}", stencils.len(), out.len()),
            ));
        }
        for (stencils, out) in stencils.chunks(BATCH * INPUTS).zip(out.chunks_mut(BATCH)) {
            let inputs = &mut self.inputs[..stencils.len()];
            inputs.copy_from_slice(stencils);
            for sample in inputs.as_chunks_mut::<INPUTS>().0 {
                self.form.apply(sample);
            }
            self.network.forward(inputs, out)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Variant;

    #[test]
    fn values_do_not_depend_on_the_company() {
        let variant = Variant::SharedLevelsAndOctants;
        let weights = Weights::initial(variant, 3, 8.0);
        for precision in [Precision::F32, Precision::Bf16] {
            let mut inference = Inference::new(&weights, InputForm::default(), precision).unwrap();
            let n = BATCH + 37;
            let raw: Vec<f32> = (0..n * INPUTS).map(|i| (i * 7919 % 1009) as f32 * 0.01).collect();
            let mut together = vec![0.0; n];
            inference.radiance(&raw, &mut together).unwrap();
            assert!(together.iter().any(|&v| v > 0.0));
            for i in [0, 1, 11, 12, 63, 64, 100] {
                let mut alone = [0.0];
                inference.radiance(&raw[i * INPUTS..(i + 1) * INPUTS], &mut alone).unwrap();
                assert_eq!(alone[0], together[i], "{precision:?} sample {i}");
            }
            assert!(inference.radiance(&raw[1..], &mut together).is_err());
        }
    }
}
