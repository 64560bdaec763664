//! The packed network against a naive f64 implementation, and the symmetry of octants.

mod common;

use common::{inputs, weights};
use pellucid_rpnn::variant::{
    CELLS_XYZ, FEATURES, Head, INPUTS, LEVEL_INPUTS, LEVELS, OCTANT_INPUTS, OCTANTS, octant_gather,
};
use pellucid_rpnn::{Network, Precision, Variant, Weights};

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
fn forward_agrees_with_the_naive_network() {
    for variant in Variant::ALL {
        let weights = weights(variant, 5);
        let x = inputs(6, 1);
        let mut network = Network::new(variant, Head::Radiance, 8, Precision::F32).unwrap();
        network.load(&weights).unwrap();
        let mut out = vec![0.0; 6];
        network.forward(&x, &mut out).unwrap();
        for (i, sample) in x.chunks_exact(INPUTS).enumerate() {
            let truth = naive(&weights, sample);
            assert!(truth > 0.01, "{variant:?}: a dead output proves nothing");
            // f32 rounding over sums of 480 terms and nine levels.
            assert!(
                (f64::from(out[i]) - truth).abs() < 2e-5 * (1.0 + truth),
                "{variant:?} {} {truth}",
                out[i]
            );
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
    let mut network = Network::new(variant, Head::Radiance, 8, Precision::F32).unwrap();
    network.load(&weights).unwrap();
    let mut over_mirrors = |x: &[f32]| {
        let all: Vec<f32> = (0..8).flat_map(|m| mirrored(x, m)).collect();
        let mut out = vec![0.0; 8];
        network.forward(&all, &mut out).unwrap();
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
    let mut network = Network::new(Variant::SharedLevels, Head::Radiance, 2, Precision::F32).unwrap();
    network.load(&weights).unwrap();
    assert!(network.forward(&[0.0; INPUTS], &mut [0.0; 2]).is_err());
    assert!(network.forward(&vec![0.0; 3 * INPUTS], &mut [0.0; 3]).is_err());
    assert!(network.load(&Weights::zeros(Variant::Baseline, Head::Radiance)).is_err());
    assert!(network.backward(&[0.0], &mut [0.0; 5]).is_err());
    assert!(Network::new(Variant::Baseline, Head::Radiance, 0, Precision::F32).is_err());
}
