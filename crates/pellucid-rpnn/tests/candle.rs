//! The network in candle: its parameters, and its gradients and training runs against the own kernels. What it gives is
//! tested with all other forms in `conformance`.

mod common;

use candle_core::{DType, Device, Tensor};
use candle_nn::{AdamW, Module, Optimizer, ParamsAdamW, VarBuilder, VarMap};
use common::{inputs, uniform, weights};
use pellucid_rpnn::adamw::AdamWSettings;
use pellucid_rpnn::candle::{InputLayer, Rpnn, radiance, tensors};
use pellucid_rpnn::train::{Batch, Engine, SampleSource, TrainSettings, Trainer};
use pellucid_rpnn::transform::{FeatureTransform, InputForm};
use pellucid_rpnn::variant::{FirstFlight, Head, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Network, Precision, RpnnError, Variant, Weights};
use rand_pcg::Pcg64;

/// The weights in candle, as variables.
fn rpnn(weights: &Weights) -> (VarMap, Rpnn) {
    let mut map = VarMap::new();
    let vb = VarBuilder::from_varmap(&map, DType::F32, &Device::Cpu);
    let rpnn = Rpnn::new(weights.variant(), weights.head(), vb).unwrap();
    map.set(tensors(weights, &Device::Cpu).unwrap().iter()).unwrap();
    (map, rpnn)
}

#[test]
fn gradients_agree_with_candle_and_reach_every_parameter_tensor() {
    for variant in Variant::ALL {
        let weights = weights(variant, Head::Radiance, 8);
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

        let (_, model) = rpnn(&weights);
        let tensor = Tensor::from_slice(&x, (n, LEVELS, LEVEL_INPUTS), &Device::Cpu).unwrap();
        let labels = Tensor::from_slice(&labels, n, &Device::Cpu).unwrap();
        let loss = (model.forward(&tensor).unwrap() - labels).unwrap().sqr().unwrap().mean_all().unwrap();
        let grads = loss.backward().unwrap();
        for (layer, linear) in weights.layout().layers.iter().zip(model.layers()) {
            let of_layer =
                [(Some(linear.weight()), layer.weight.clone()), (linear.bias(), layer.bias.clone())];
            for (var, range) in of_layer {
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
fn weights_come_back_bit_for_bit() {
    for variant in Variant::ALL {
        let (mut map, rpnn) = rpnn(&weights(variant, Head::Radiance, 3));
        assert_eq!(rpnn.weights().unwrap(), weights(variant, Head::Radiance, 3));
        let other = weights(variant, Head::Radiance, 4);
        map.set(tensors(&other, &Device::Cpu).unwrap().iter()).unwrap();
        assert_eq!(rpnn.weights().unwrap(), other);
    }
}

#[test]
fn variables_have_the_names_and_the_number_of_the_layout() {
    for (variant, head) in Variant::ALL.into_iter().flat_map(|v| Head::ALL.map(|h| (v, h))) {
        let map = VarMap::new();
        let vb = VarBuilder::from_varmap(&map, DType::F32, &Device::Cpu);
        let rpnn = Rpnn::new(variant, head, vb).unwrap();
        let count: usize = map.all_vars().iter().map(|v| v.elem_count()).sum();
        assert_eq!(count, variant.layout(head).parameters);
        if head == Head::Radiance {
            let of_variant = [2_046_871, 365_851, 3_767_341, 706_861];
            assert_eq!(count, of_variant[Variant::ALL.iter().position(|v| *v == variant).unwrap()]);
        }
        let mut names: Vec<String> = map.data().lock().unwrap().keys().cloned().collect();
        let mut expected: Vec<String> =
            tensors(&Weights::zeros(variant, head), &Device::Cpu).unwrap().into_keys().collect();
        names.sort();
        expected.sort();
        assert_eq!(names, expected);
        assert_eq!(rpnn.weights().unwrap().values().len(), count);
    }
}

#[test]
fn a_builder_over_variables_draws_them_as_initial_weights() {
    let (variant, head) = (Variant::SharedLevelsAndOctants, Head::FirstFlight);
    let vb = VarBuilder::from_varmap(&VarMap::new(), DType::F32, &Device::Cpu);
    let drawn = Rpnn::new(variant, head, vb).unwrap().weights().unwrap();
    let own = Weights::initial(variant, head, 1, head.mean_output());
    for layer in &own.layout().layers {
        let variance = |w: &Weights| {
            let w = &w.values()[layer.weight.clone()];
            w.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / w.len() as f64
        };
        // Eight standard errors of the ratio of two samples' variances: candle draws others in every run.
        let error = (4.0 / (layer.weight.len() as f64)).sqrt();
        let ratio = variance(&drawn) / variance(&own);
        assert!((ratio - 1.0).abs() < 8.0 * error, "{}: {ratio}", layer.name);
        assert_eq!(drawn.values()[layer.bias.clone()], own.values()[layer.bias.clone()]);
    }
}

#[test]
fn whatever_is_not_the_variants_is_refused() {
    let weights = weights(Variant::SharedLevels, Head::Radiance, 3);
    let tensors = tensors(&weights, &Device::Cpu).unwrap();
    let build = |variant, head, tensors| {
        Rpnn::new(variant, head, VarBuilder::from_tensors(tensors, DType::F32, &Device::Cpu))
    };
    let missing = build(Variant::Baseline, Head::Radiance, tensors.clone()).unwrap_err().to_string();
    assert!(missing.contains("level1.dense1.weight"), "{missing}");
    let shape = build(Variant::SharedLevels, Head::FirstFlight, tensors.clone()).unwrap_err().to_string();
    assert!(shape.contains("end3.weight"), "{shape}");
    let rpnn = build(Variant::SharedLevels, Head::Radiance, tensors).unwrap();
    for dims in [vec![9, 270], vec![9, 4, 270], vec![4, 270, 9], vec![4, 9 * 270]] {
        let inputs = Tensor::zeros(dims.clone(), DType::F32, &Device::Cpu).unwrap();
        assert!(rpnn.forward(&inputs).is_err(), "{dims:?}");
    }
}

#[test]
fn radiance_is_composed_as_by_the_head() {
    let n = 64;
    let mut rng = Pcg64::new(5, 79);
    let outputs: Vec<f32> = (0..n * 4).map(|_| 1.6 * uniform(&mut rng) - 0.6).collect();
    let flights: Vec<FirstFlight> =
        (0..n).map(|_| FirstFlight::from_array(std::array::from_fn(|_| 0.3 * uniform(&mut rng)))).collect();
    let mut truth = vec![0.0; n];
    Head::FirstFlight.radiance(&outputs, &flights, &mut truth);
    let of_flights: Vec<f32> = flights.iter().flat_map(|f| f.to_array()).collect();
    let outputs = Tensor::from_vec(outputs, (n, 4), &Device::Cpu).unwrap();
    let flights = Tensor::from_vec(of_flights, (n, FirstFlight::VALUES), &Device::Cpu).unwrap();
    let composed = radiance(&outputs, &flights).unwrap().to_vec1::<f32>().unwrap();
    for (a, b) in composed.iter().zip(&truth) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    assert!(radiance(&outputs, &flights.narrow(1, 0, 4).unwrap()).is_err());
}

/// AdamW of candle-nn on a batch of samples: the loss falls, and every variable moves.
#[test]
fn optimisers_of_candle_nn_train_it() {
    for variant in [Variant::SharedLevels, Variant::SharedLevelsAndOctants] {
        let start = weights(variant, Head::FirstFlight, 6);
        let (map, rpnn) = rpnn(&start);
        let n = 16;
        let (mut x, mut labels) = (vec![0.0; n * INPUTS], vec![0.0; n]);
        let batch = Batch { stencils: &mut x, flights: &mut [], radiance: &mut labels };
        Surfaces.batch(0, batch).unwrap();
        let x = Tensor::from_vec(x, (n, LEVELS, LEVEL_INPUTS), &Device::Cpu).unwrap();
        let labels = Tensor::from_vec(labels, (n, 1), &Device::Cpu).unwrap();
        let form = InputForm { transform: FeatureTransform::Log, ..Default::default() };
        let inputs = InputLayer::new(form, DType::F32, &Device::Cpu).unwrap().forward(&x).unwrap();
        let loss = || {
            let outputs = rpnn.forward(&inputs).unwrap();
            outputs.broadcast_sub(&labels).unwrap().sqr().unwrap().mean_all().unwrap()
        };
        let before = loss().to_scalar::<f32>().unwrap();
        let parameters = ParamsAdamW { lr: 2e-4, weight_decay: 0.0, ..Default::default() };
        let mut optimiser = AdamW::new(map.all_vars(), parameters).unwrap();
        let losses: Vec<f32> = (0..30)
            .map(|_| {
                let loss = loss();
                optimiser.backward_step(&loss).unwrap();
                loss.to_scalar().unwrap()
            })
            .collect();
        let after = loss().to_scalar::<f32>().unwrap();
        assert!(after < 0.5 * before, "{variant:?}: {before} {after} {losses:?}");
        let trained = rpnn.weights().unwrap();
        for layer in &start.layout().layers {
            for range in [layer.weight.clone(), layer.bias.clone()].into_iter().filter(|r| !r.is_empty()) {
                assert_ne!(trained.values()[range.clone()], start.values()[range], "{}", layer.name);
            }
        }
    }
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
