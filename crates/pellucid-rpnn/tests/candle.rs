//! The network on candle against the packed one: outputs, gradients and training runs.

mod common;

use candle_core::{Device, Tensor};
use common::{inputs, uniform, weights};
use pellucid_rpnn::adamw::AdamWSettings;
use pellucid_rpnn::train::{Batch, Engine, SampleSource, TrainSettings, Trainer};
use pellucid_rpnn::variant::{FirstFlight, Head, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Network, Precision, RpnnError, Variant, reference::CandleNetwork};
use rand_pcg::Pcg64;

#[test]
fn outputs_agree() {
    for variant in Variant::ALL {
        let weights = weights(variant, 5);
        let x = inputs(6, 1);
        let mut network = Network::new(variant, Head::Radiance, 8, Precision::F32).unwrap();
        network.load(&weights).unwrap();
        let mut out = vec![0.0; 6];
        network.forward(&x, &mut out).unwrap();
        let tensor = Tensor::from_slice(&x, (6, LEVELS, LEVEL_INPUTS), &Device::Cpu).unwrap();
        let candle =
            CandleNetwork::new(&weights).unwrap().forward(&tensor).unwrap().to_vec1::<f32>().unwrap();
        for (a, b) in out.iter().zip(candle) {
            assert!(b > 0.01, "{variant:?}: a dead output proves nothing");
            assert!((a - b).abs() < 2e-5 * (1.0 + b), "{variant:?} {a} {b}");
        }
    }
}

#[test]
fn gradients_agree_with_candle_and_reach_every_parameter_tensor() {
    for variant in Variant::ALL {
        let weights = weights(variant, 8);
        let n = 24;
        let x = inputs(n, 2);
        let labels: Vec<f32> = (0..n).map(|i| 0.1 + 0.03 * i as f32).collect();

        let mut network = Network::new(variant, Head::Radiance, n, Precision::F32).unwrap();
        network.load(&weights).unwrap();
        let mut out = vec![0.0; n];
        let mut gradient = vec![0.0; weights.values().len()];
        network.forward(&x, &mut out).unwrap();
        let d_out: Vec<f32> = out.iter().zip(&labels).map(|(o, l)| 2.0 * (o - l) / n as f32).collect();
        network.backward(&d_out, &mut gradient).unwrap();

        let model = CandleNetwork::new(&weights).unwrap();
        let tensor = Tensor::from_slice(&x, (n, LEVELS, LEVEL_INPUTS), &Device::Cpu).unwrap();
        let labels = Tensor::from_slice(&labels, n, &Device::Cpu).unwrap();
        let loss = (model.forward(&tensor).unwrap() - labels).unwrap().sqr().unwrap().mean_all().unwrap();
        let grads = loss.backward().unwrap();
        for (layer, (weight, bias)) in weights.layout().layers.iter().zip(model.parameters()) {
            for (var, range) in [(Some(weight), layer.weight.clone()), (bias.as_ref(), layer.bias.clone())] {
                let Some(var) = var else { continue };
                let oracle = grads.get(var).unwrap_or_else(|| panic!("{} has no gradient", layer.name));
                let oracle = oracle.flatten_all().unwrap().to_vec1::<f32>().unwrap();
                let norm = oracle.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
                assert!(norm > 0.0, "{variant:?} {} receives no gradient", layer.name);
                let difference = oracle
                    .iter()
                    .zip(&gradient[range])
                    .map(|(&a, &b)| f64::from(a - b).powi(2))
                    .sum::<f64>()
                    .sqrt();
                assert!(difference < 1e-4 * norm, "{variant:?} {}: {}", layer.name, difference / norm);
            }
        }
    }
}

#[test]
fn loading_replaces_every_parameter() {
    let variant = Variant::SharedLevelsAndOctants;
    let mut model = CandleNetwork::new(&weights(variant, 3)).unwrap();
    let other = weights(variant, 4);
    model.load(&other).unwrap();
    let fresh = CandleNetwork::new(&other).unwrap();
    let values = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    for ((weight, bias), (fresh_weight, fresh_bias)) in model.parameters().iter().zip(fresh.parameters()) {
        assert_eq!(values(weight), values(fresh_weight));
        assert_eq!(bias.as_ref().map(|b| values(b)), fresh_bias.as_ref().map(|b| values(b)));
    }
    assert!(model.load(&weights(Variant::SharedLevels, 3)).is_err());
}

/// Uniform media whose radiance is known, below a surface at a random height. Every eighth stencil is empty,
/// so that sums are exactly zero while the biases are, and its label lies below what a ReLU can give.
struct Surfaces;

impl SampleSource for Surfaces {
    fn batch(
        &mut self,
        index: u64,
        batch: Batch<'_>,
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        batch.flights.fill(FirstFlight { masses: [0.3, 0.5, 0.15], escaped: 0.02, returned: 0.01 });
        let mut rng = Pcg64::new(u128::from(index), 78);
        for (i, (sample, radiance)) in batch.stencils.chunks_exact_mut(INPUTS).zip(batch.radiance).enumerate()
        {
            let scattering = 2.0 + 10.0 * uniform(&mut rng);
            let absorption = 0.01 * 200f32.powf(uniform(&mut rng));
            let height = if i % 8 == 5 { 0 } else { 3 + (7.0 * uniform(&mut rng)) as usize };
            for level in sample.chunks_exact_mut(LEVEL_INPUTS) {
                for (z, slice) in level.chunks_exact_mut(LEVEL_INPUTS / 9).enumerate() {
                    let medium = if z < height { [scattering, absorption] } else { [0.0; 2] };
                    slice.chunks_exact_mut(2).for_each(|cell| cell.copy_from_slice(&medium));
                }
            }
            let of_medium = (-(absorption / (absorption + scattering)).sqrt() * 2.0).exp();
            *radiance = if height == 0 { -0.1 } else { of_medium };
        }
        Ok(())
    }
}

/// Steps are short, or they would overshoot and rounding grow with every one. Epsilon is large: where rounding
/// lifts a unit that was silent so far over its ReLU in one engine alone, AdamW would turn that first trace of
/// a gradient into steps as long as any.
fn settings(variant: Variant) -> TrainSettings {
    let optimiser = AdamWSettings { epsilon: 1e-4, ..Default::default() };
    TrainSettings {
        variant,
        steps: 20,
        warm_up: 4,
        batch: 16,
        peak_rate: 2e-4,
        optimiser,
        ..Default::default()
    }
}

fn distance(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).map(|(&a, &b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

/// Trains both and compares every loss and gradient, and the weights at the end with the way they came.
///
/// The engines add the same f32 terms in different orders, and every step starts from what rounding left of
/// the last: up to 7e-6 of a loss, 3e-5 of a gradient's norm and 7e-6 of the way after 20 steps. Now and then
/// a unit close to zero passes its ReLU in one engine alone, so the bounds are some thirty times wider.
fn assert_same_run(mut own: Trainer, mut candle: Trainer) {
    assert_eq!((own.engine(), candle.engine()), (Engine::Own, Engine::Candle));
    let variant = own.settings().variant;
    let start = own.weights().clone();
    while !own.finished() {
        let (a, b) = (own.step(&mut Surfaces).unwrap(), candle.step(&mut Surfaces).unwrap());
        let near = |a: f64, b: f64, tolerance: f64| (a - b).abs() <= tolerance * b;
        assert!(near(a.loss, b.loss, 1e-4), "{variant:?}: {a:?} {b:?}");
        assert!(near(a.gradient_norm, b.gradient_norm, 1e-3), "{variant:?}: {a:?} {b:?}");
        assert_eq!((a.step, a.rate), (b.step, b.rate));
    }
    let travelled = distance(own.weights().values(), start.values());
    let apart = distance(own.weights().values(), candle.weights().values());
    assert!(travelled > 0.02, "{variant:?}: {travelled}");
    assert!(apart < 3e-4 * travelled, "{variant:?}: {apart} of {travelled}");
    let averages = distance(&own.optimiser().average, &candle.optimiser().average);
    assert!(averages < 3e-4 * travelled, "{variant:?}: {averages} of {travelled}");
}

#[test]
fn engines_train_alike() {
    for variant in Variant::ALL {
        let own = Trainer::new(settings(variant)).unwrap();
        let candle = own.clone().with_engine(Engine::Candle).unwrap();
        assert_same_run(own, candle);
    }
}

#[test]
fn engines_raise_outputs_that_are_cut_off_alike() {
    let settings = TrainSettings {
        head: Head::Radiance,
        mean_output: -4.0,
        ..settings(Variant::SharedLevelsAndOctants)
    };
    let (mut x, mut labels) = (vec![0.0; 16 * INPUTS], vec![0.0; 16]);
    let mut flights = vec![FirstFlight::default(); 16];
    Surfaces.batch(0, Batch { stencils: &mut x, flights: &mut flights, radiance: &mut labels }).unwrap();
    let of_darkness = labels.iter().map(|&l| f64::from(l).powi(2)).sum::<f64>() / 16.0;
    let own = Trainer::new(settings).unwrap();
    let first = own.clone().step(&mut Surfaces).unwrap();
    assert!((first.loss - of_darkness).abs() < 1e-12, "an output is not cut off");
    let candle = own.clone().with_engine(Engine::Candle).unwrap();
    assert_same_run(own, candle);
}

#[test]
fn candle_goes_on_from_a_checkpoint_of_the_own_engine_and_its_clones_are_apart() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.safetensors");
    let mut own = Trainer::new(settings(Variant::SharedLevelsAndOctants)).unwrap();
    for _ in 0..5 {
        own.step(&mut Surfaces).unwrap();
    }
    own.save(&path).unwrap();
    let resumed = Trainer::resume(&path).unwrap();
    assert_eq!(resumed.engine(), Engine::Own);
    let mut candle = resumed.with_engine(Engine::Candle).unwrap();
    candle.step(&mut Surfaces).unwrap();
    own.step(&mut Surfaces).unwrap();
    let mut copy = candle.clone();
    let report_of = |trainer: &mut Trainer| trainer.step(&mut Surfaces).unwrap();
    assert_eq!(report_of(&mut copy), report_of(&mut candle));
    assert_eq!(copy.weights(), candle.weights());
    own.step(&mut Surfaces).unwrap();
    assert_same_run(own, candle);
}

#[test]
fn candle_has_no_bf16() {
    let settings = TrainSettings { precision: Precision::Bf16, ..settings(Variant::SharedLevels) };
    let error = Trainer::new(settings).unwrap().with_engine(Engine::Candle).unwrap_err();
    assert!(matches!(&error, RpnnError::Invalid(fault) if fault.subject == "precision"), "{error}");
}
