//! The network on candle against the packed one: outputs and gradients.

mod common;

use candle_core::{Device, Tensor};
use common::{inputs, weights};
use pellucid_rpnn::variant::{LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Network, Precision, Variant, reference::CandleNetwork};

#[test]
fn outputs_agree() {
    for variant in Variant::ALL {
        let weights = weights(variant, 5);
        let x = inputs(6, 1);
        let mut network = Network::new(variant, 8, Precision::F32).unwrap();
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

        let mut network = Network::new(variant, n, Precision::F32).unwrap();
        network.load(&weights).unwrap();
        let mut out = vec![0.0; n];
        let mut gradient = vec![0.0; weights.values().len()];
        network.forward(&x, &mut out).unwrap();
        let d_out: Vec<f32> = out.iter().zip(&labels).map(|(o, l)| 2.0 * (o - l) / n as f32).collect();
        network.backward(&out, &d_out, &mut gradient).unwrap();

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
