//! The packed network and the candle network against a naive f64 implementation and each other.

use candle_core::{Device, Tensor};
use pellucid_rpnn::variant::{
    CELLS_XYZ, FEATURES, INPUTS, LEVEL_INPUTS, LEVELS, OCTANT_INPUTS, OCTANTS, octant_gather,
};
use pellucid_rpnn::{Network, Variant, Weights, reference::CandleNetwork};
use rand_core::Rng;
use rand_pcg::Pcg64;

fn uniform(rng: &mut Pcg64) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1 << 24) as f32
}

/// Stencil-like inputs: non-negative, some cells empty.
fn inputs(n: usize, seed: u64) -> Vec<f32> {
    let mut rng = Pcg64::new(u128::from(seed), 7);
    (0..n * INPUTS).map(|_| (uniform(&mut rng) - 0.3).max(0.0)).collect()
}

/// Weights with biases everywhere, so that no activation is zero by construction.
fn weights(variant: Variant, seed: u64) -> Weights {
    let mut weights = Weights::initial(variant, seed, 0.8);
    let layout = weights.layout().clone();
    let mut rng = Pcg64::new(u128::from(seed), 11);
    for layer in layout.layers.iter().filter(|l| l.name != "end3") {
        for b in &mut weights.values_mut()[layer.bias.clone()] {
            *b = 0.1 * (uniform(&mut rng) - 0.4);
        }
    }
    weights
}

/// The design's table written out directly, one sample in f64.
fn naive(weights: &Weights, sample: &[f32]) -> f64 {
    let variant = weights.variant();
    let layer = |name: &str, x: &[f64]| -> Vec<f64> {
        let l = weights.layout().layers.iter().find(|l| l.name == name).unwrap();
        let (w, b) = (&weights.values()[l.weight.clone()], &weights.values()[l.bias.clone()]);
        assert_eq!(x.len(), l.inputs);
        (0..l.outputs)
            .map(|o| {
                let dot: f64 = (0..l.inputs).map(|i| f64::from(w[o * l.inputs + i]) * x[i]).sum();
                dot + b.get(o).map_or(0.0, |&b| f64::from(b))
            })
            .collect()
    };
    let relu = |x: Vec<f64>| -> Vec<f64> { x.into_iter().map(|v| v.max(0.0)).collect() };
    let add = |a: Vec<f64>, b: &[f64]| -> Vec<f64> { a.into_iter().zip(b).map(|(a, b)| a + b).collect() };
    let octant_layers = matches!(variant, Variant::SharedOctants | Variant::SharedLevelsAndOctants);
    let one_block = matches!(variant, Variant::SharedLevels | Variant::SharedLevelsAndOctants);
    let mut state = vec![0.0; if octant_layers { 480 } else { 270 }];
    for k in 0..9 {
        let p = if one_block { "level".to_owned() } else { format!("level{}", k + 1) };
        let x: Vec<f64> = sample[k * 270..(k + 1) * 270].iter().map(|&v| f64::from(v)).collect();
        let through = |x: &[f64], names: [&str; 2]| {
            let h = relu(layer(&format!("{p}.{}", names[0]), x));
            relu(layer(&format!("{p}.{}", names[1]), &h))
        };
        let value: Vec<f64> = if octant_layers {
            (0..8)
                .flat_map(|o| {
                    let part: Vec<f64> = octant_gather(o).iter().map(|&i| x[usize::from(i)]).collect();
                    through(&part, ["octant1", "octant2"])
                })
                .collect()
        } else if k == 0 && !one_block {
            through(&x, ["dense1", "dense2"])
        } else {
            x
        };
        if k == 0 && !one_block {
            state = value;
            continue;
        }
        let new = if variant == Variant::SharedOctants { value } else { layer(&format!("{p}.a"), &value) };
        let mixed = relu(add(new, &layer(&format!("{p}.b"), &state)));
        state = relu(add(layer(&format!("{p}.c"), &mixed), &state));
    }
    let rows = if octant_layers { 60 } else { 270 };
    let total: f64 =
        state.chunks(rows).map(|row| layer("end3", &relu(layer("end2", &relu(layer("end1", row)))))[0]).sum();
    total.max(0.0)
}

#[test]
fn forward_agrees_with_the_naive_network_and_candle() {
    for variant in Variant::ALL {
        let weights = weights(variant, 5);
        let x = inputs(6, 1);
        let mut network = Network::new(variant, 8).unwrap();
        let mut out = vec![0.0; 6];
        network.forward(&weights, &x, &mut out).unwrap();
        let tensor = Tensor::from_slice(&x, (6, LEVELS, LEVEL_INPUTS), &Device::Cpu).unwrap();
        let candle =
            CandleNetwork::new(&weights).unwrap().forward(&tensor).unwrap().to_vec1::<f32>().unwrap();
        for (i, sample) in x.chunks_exact(INPUTS).enumerate() {
            let truth = naive(&weights, sample);
            assert!(truth > 0.01, "{variant:?}: a dead output proves nothing");
            // f32 rounding over sums of 480 terms and nine levels.
            assert!(
                (f64::from(out[i]) - truth).abs() < 2e-5 * (1.0 + truth),
                "{variant:?} {} {truth}",
                out[i]
            );
            assert!(
                (f64::from(candle[i]) - truth).abs() < 2e-5 * (1.0 + truth),
                "{variant:?} {} {truth}",
                candle[i]
            );
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

        let mut network = Network::new(variant, n).unwrap();
        let mut out = vec![0.0; n];
        let mut gradient = vec![0.0; weights.values().len()];
        network.forward(&weights, &x, &mut out).unwrap();
        let d_out: Vec<f32> = out.iter().zip(&labels).map(|(o, l)| 2.0 * (o - l) / n as f32).collect();
        network.backward(&weights, &out, &d_out, &mut gradient).unwrap();

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

/// Mirrors every level of a sample along the axes of `mask` (bit 0 = x).
fn mirrored(sample: &[f32], mask: usize) -> Vec<f32> {
    let [nx, ny, nz] = CELLS_XYZ;
    let mut out = vec![0.0; sample.len()];
    for k in 0..sample.len() / LEVEL_INPUTS {
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let flip =
                        |axis: usize, n: usize, i: usize| if mask >> axis & 1 == 1 { n - 1 - i } else { i };
                    let from = (flip(2, nz, z) * ny + flip(1, ny, y)) * nx + flip(0, nx, x);
                    let to = (z * ny + y) * nx + x;
                    for f in 0..FEATURES {
                        out[(k * 135 + to) * FEATURES + f] = sample[(k * 135 + from) * FEATURES + f];
                    }
                }
            }
        }
    }
    out
}

#[test]
fn mirroring_exchanges_octants_exactly() {
    let x = inputs(1, 3);
    for mask in 0..OCTANTS {
        let m = mirrored(&x, mask);
        for octant in 0..OCTANTS {
            for (a, b) in octant_gather(octant).into_iter().zip(octant_gather(octant ^ mask)) {
                for k in 0..LEVELS {
                    assert_eq!(m[k * LEVEL_INPUTS + usize::from(a)], x[k * LEVEL_INPUTS + usize::from(b)]);
                }
            }
        }
    }
    assert_eq!(OCTANT_INPUTS, octant_gather(0).len());
}

/// The 480-wide layers mix octants freely, so one evaluation is not invariant; the mean over the eight
/// mirrors is, because it sums the same eight numbers.
#[test]
fn the_mean_over_mirrors_is_invariant_and_one_evaluation_is_not() {
    let variant = Variant::SharedLevelsAndOctants;
    let weights = weights(variant, 4);
    let mut network = Network::new(variant, 8).unwrap();
    let mut over_mirrors = |x: &[f32]| {
        let all: Vec<f32> = (0..8).flat_map(|m| mirrored(x, m)).collect();
        let mut out = vec![0.0; 8];
        network.forward(&weights, &all, &mut out).unwrap();
        out
    };
    let x = inputs(1, 6);
    let plain = over_mirrors(&x);
    let spread = plain.iter().fold(0.0f32, |s, v| s.max((v - plain[0]).abs()));
    assert!(spread > 1e-3, "octants should mix; spread {spread}");
    let mut sorted = plain.clone();
    sorted.sort_by(f32::total_cmp);
    for mask in 1..8 {
        let mut other = over_mirrors(&mirrored(&x, mask));
        other.sort_by(f32::total_cmp);
        assert_eq!(sorted, other, "the same eight evaluations in another order");
    }
}

#[test]
fn buffers_of_wrong_length_are_refused() {
    let weights = weights(Variant::SharedLevels, 1);
    let mut network = Network::new(Variant::SharedLevels, 2).unwrap();
    assert!(network.forward(&weights, &[0.0; INPUTS], &mut [0.0; 2]).is_err());
    assert!(network.forward(&weights, &vec![0.0; 3 * INPUTS], &mut [0.0; 3]).is_err());
    let other = Weights::zeros(Variant::Baseline);
    assert!(network.forward(&other, &[0.0; INPUTS], &mut [0.0; 1]).is_err());
    assert!(network.backward(&weights, &[0.0], &[0.0], &mut [0.0; 5]).is_err());
    assert!(Network::new(Variant::Baseline, 0).is_err());
}
