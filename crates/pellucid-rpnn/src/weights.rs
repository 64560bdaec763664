//! Parameters of a network as one flat vector.

use pellucid_core::Digest;
use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::variant::{Head, Layer, Layout, OCTANTS};
use crate::{RpnnError, Variant};

/// The parameters of one variant, in the order of its [`Layout`].
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    variant: Variant,
    head: Head,
    layout: Layout,
    values: Vec<f32>,
}

impl Weights {
    /// Wraps a flat vector.
    ///
    /// # Errors
    /// [`RpnnError::Invalid`] when its length is not the variant's or a value is not finite.
    pub fn new(variant: Variant, head: Head, values: Vec<f32>) -> Result<Self, RpnnError> {
        let layout = variant.layout(head);
        if values.len() != layout.parameters {
            return Err(RpnnError::invalid(
                "weights",
                format!("{} values; {} has {}", values.len(), variant.name(), layout.parameters),
            ));
        }
        if let Some(layer) = layout.layers.iter().find(|l| {
            let all = l.weight.start..l.bias.end;
            values[all].iter().any(|v| !v.is_finite())
        }) {
            return Err(RpnnError::invalid(format!("weights of {}", layer.name), "a value is not finite"));
        }
        Ok(Self { variant, head, layout, values })
    }

    /// All zero.
    pub fn zeros(variant: Variant, head: Head) -> Self {
        let layout = variant.layout(head);
        let values = vec![0.0; layout.parameters];
        Self { variant, head, layout, values }
    }

    /// Random parameters: He et al. 2015 normal, times 0.3 on the residual products B and C and times 0.1
    /// on the last layer, whose bias starts at `mean` shared over the octants that are summed: the mean radiance, or
    /// the mean throughput after the first flight.
    pub fn initial(variant: Variant, head: Head, seed: u64, mean: f32) -> Self {
        let mut weights = Self::zeros(variant, head);
        let layout = weights.layout.clone();
        for (i, layer) in layout.layers.iter().enumerate() {
            let deviation = deviation(layer);
            let mut normal = Normal::new(seed, i as u64);
            for w in &mut weights.values[layer.weight.clone()] {
                *w = (deviation * normal.next()) as f32;
            }
            weights.values[layer.bias.clone()].fill(bias(layer, variant, mean));
        }
        weights
    }

    /// The architecture.
    pub fn variant(&self) -> Variant {
        self.variant
    }

    /// What the last layer gives.
    pub fn head(&self) -> Head {
        self.head
    }

    /// Where each layer lies.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// All parameters.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// A [`Digest`] of the variant, the layers' names and all values, in hexadecimal, to tell weights apart in reports.
    pub fn digest(&self) -> String {
        let mut digest = Digest::new();
        digest.add(self.variant.name().as_bytes());
        for layer in &self.layout.layers {
            // A byte that no name holds keeps names and values apart.
            digest.add(&[0xff]);
            digest.add(layer.name.as_bytes());
            digest.add(&[0xff]);
            let values = self.values[layer.weight.clone()].iter().chain(&self.values[layer.bias.clone()]);
            values.for_each(|v| digest.add(&v.to_bits().to_le_bytes()));
        }
        digest.hex()
    }

    /// All parameters, for an optimiser.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }
}

/// Standard deviation of a layer's initial matrix.
pub(crate) fn deviation(layer: &Layer) -> f64 {
    let gain = match layer.name.rsplit('.').next() {
        Some("b" | "c") => 0.3,
        Some("end3") => 0.1,
        _ => 1.0,
    };
    gain * (2.0 / layer.inputs as f64).sqrt()
}

/// A layer's initial bias, in a network of `variant` whose outputs are to be about `mean`.
pub(crate) fn bias(layer: &Layer, variant: Variant, mean: f32) -> f32 {
    match (layer.name == "end3", variant.shares_octants()) {
        (true, true) => mean / OCTANTS as f32,
        (true, false) => mean,
        (false, _) => 0.0,
    }
}

/// Standard normal numbers by Box and Muller's transform, addressed by (seed, stream).
struct Normal {
    rng: Pcg64,
    spare: Option<f64>,
}

impl Normal {
    fn new(seed: u64, stream: u64) -> Self {
        Self { rng: Pcg64::new(u128::from(seed), u128::from(stream)), spare: None }
    }

    fn uniform(&mut self) -> f64 {
        // (0, 1]: the logarithm below stays finite.
        ((self.rng.next_u64() >> 11) as f64 + 1.0) / (1u64 << 53) as f64
    }

    fn next(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        self.spare = Some(radius * sin);
        radius * cos
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn initial_values_have_the_stated_moments() {
        let weights = Weights::initial(Variant::SharedLevelsAndOctants, Head::Radiance, 3, 0.4);
        for layer in &weights.layout().layers {
            let w = &weights.values()[layer.weight.clone()];
            let n = w.len() as f64;
            let mean = w.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
            let variance = w.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>() / n;
            let gain = match layer.name.as_str() {
                "level.b" | "level.c" => 0.3,
                "end3" => 0.1,
                _ => 1.0,
            };
            let expected = gain * gain * 2.0 / layer.inputs as f64;
            // Five standard errors of a normal sample's mean and variance.
            assert!(mean.abs() < 5.0 * (expected / n).sqrt(), "{} mean {mean}", layer.name);
            assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{} {variance}", layer.name);
        }
        assert_eq!(*weights.values().last().unwrap(), 0.05);
        assert_eq!(weights, Weights::initial(Variant::SharedLevelsAndOctants, Head::Radiance, 3, 0.4));
        assert_ne!(weights, Weights::initial(Variant::SharedLevelsAndOctants, Head::Radiance, 4, 0.4));
    }

    #[test]
    fn digests_tell_weights_apart() {
        let weights = Weights::initial(Variant::SharedLevels, Head::Radiance, 3, 0.4);
        assert_eq!(weights.digest(), weights.clone().digest());
        assert_eq!(weights.digest().len(), 32);
        let mut other = weights.clone();
        let last = other.values().len() - 1;
        other.values_mut()[last] = f32::from_bits(other.values()[last].to_bits() ^ 1);
        assert_ne!(weights.digest(), other.digest());
        assert_ne!(
            Weights::zeros(Variant::SharedOctants, Head::Radiance).digest(),
            Weights::zeros(Variant::Baseline, Head::Radiance).digest()
        );
    }

    #[test]
    fn refuses_wrong_lengths_and_values() {
        assert!(Weights::new(Variant::SharedLevels, Head::Radiance, vec![0.0; 3]).is_err());
        let mut values = vec![0.0; Variant::SharedLevels.parameters()];
        values[72_900] = f32::NAN;
        let error = Weights::new(Variant::SharedLevels, Head::Radiance, values).unwrap_err().to_string();
        assert!(error.contains("level.b"), "{error}");
    }
}
