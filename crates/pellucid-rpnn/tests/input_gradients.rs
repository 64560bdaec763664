//! Derivatives of outputs by raw stencils against differences of the naive network, and of shared levels against
//! those of whole stencils.

mod common;
#[path = "conformance/naive.rs"]
mod naive;

use common::uniform;
use pellucid_rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
use pellucid_rpnn::variant::{Head, INPUTS, LEVEL_INPUTS, LEVELS};
use pellucid_rpnn::{Inference, InputGradients, InstructionSet, Precision, Variant, Weights};
use rand_pcg::Pcg64;

const FORMS: [InputForm; 2] = [
    InputForm { transform: FeatureTransform::Scaled, order: LevelOrder::FineToCoarse },
    InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine },
];

/// Biases everywhere, so that no activation is zero by construction, and a last layer that matters.
fn weights(variant: Variant, head: Head) -> Weights {
    let mut weights = Weights::initial(variant, head, 8, 0.8);
    let layout = weights.layout().clone();
    let mut rng = Pcg64::new(8, 11);
    for layer in &layout.layers {
        let values = weights.values_mut();
        if layer.name == "end3" {
            values[layer.weight.clone()].iter_mut().for_each(|w| *w *= 10.0);
        } else {
            values[layer.bias.clone()].iter_mut().for_each(|b| *b = 0.1 * (uniform(&mut rng) - 0.4));
        }
    }
    weights
}

/// Coefficients in 1/mm, scattering ten times absorption.
fn stencils(n: usize, seed: u64) -> Vec<f32> {
    let mut rng = Pcg64::new(u128::from(seed), 7);
    (0..n * INPUTS).map(|i| uniform(&mut rng) * if i % 2 == 0 { 10.0 } else { 1.0 }).collect()
}

fn inference(weights: &Weights, form: InputForm) -> Inference {
    Inference::new(weights, form, Precision::F32).unwrap()
}

#[test]
fn derivatives_are_the_limits_of_differences_of_the_naive_network() {
    for (i, variant) in Variant::ALL.into_iter().enumerate() {
        let (form, head) = (FORMS[i % 2], Head::ALL[i / 2]);
        let weights = weights(variant, head);
        let outputs = head.outputs();
        let raw = stencils(3, 2);
        let d_out: Vec<f32> = (0..3 * outputs).map(|i| 0.5 - 0.3 * (i % 4) as f32).collect();
        let mut derivatives = vec![f32::NAN; raw.len()];
        inference(&weights, form).input_gradients().outputs(&raw, &d_out, &mut derivatives).unwrap();
        let largest = derivatives.iter().fold(0.0f32, |most, d| most.max(d.abs()));
        assert!(largest > 1e-3, "{variant:?}: {largest}");
        let sum = |stencil: &[f32], sample: usize| -> f64 {
            let d_out = &d_out[sample * outputs..][..outputs];
            naive::outputs(&weights, form, stencil).iter().zip(d_out).map(|(o, &d)| o * f64::from(d)).sum()
        };
        // Every level and both features, in a sample that is not the first.
        for place in (0..INPUTS).step_by(241) {
            let stencil = &raw[2 * INPUTS..];
            let moved = |by: f32| {
                let mut stencil = stencil.to_vec();
                stencil[place] += by;
                (f64::from(stencil[place]), sum(&stencil, 2))
            };
            let step = 1e-4 * (1.0 + stencil[place]);
            let ((high, more), (low, less)) = (moved(step), moved(-step));
            let difference = (more - less) / (high - low);
            let derivative = f64::from(derivatives[2 * INPUTS + place]);
            // Of f32 products over nine levels, and of a ReLU here and there that is passed within a step.
            let tolerance = 1e-3 * derivative.abs() + 3e-4 * f64::from(largest);
            assert!(
                (difference - derivative).abs() < tolerance,
                "{variant:?} {head:?} {place}: {difference} {derivative}, largest {largest}"
            );
        }
    }
}

/// A whole derivative, made of a sample's own finest levels and of the others as its only place.
fn by_parts(
    of: &mut InputGradients,
    from: &mut Inference,
    fine: usize,
    raw: &[f32],
    d_out: &[f32],
) -> Vec<f32> {
    let n = raw.len() / INPUTS;
    let finest: Vec<f32> = raw.chunks_exact(INPUTS).flat_map(|s| s[..fine * LEVEL_INPUTS].to_vec()).collect();
    let states = from.coarse_states(fine, raw).unwrap();
    let mut d_mixed = vec![f32::NAN; n * of.state_width()];
    let mut d_finest = vec![f32::NAN; finest.len()];
    let places: Vec<u32> = (0..n as u32).collect();
    of.outputs_near(&states, &places, &vec![1.0; n], &finest, d_out, &mut d_finest, &mut d_mixed).unwrap();
    let mut whole = vec![f32::NAN; raw.len()];
    of.coarse_states(fine, raw, &d_mixed, &mut whole).unwrap();
    for (whole, own) in whole.chunks_exact_mut(INPUTS).zip(d_finest.chunks_exact(fine * LEVEL_INPUTS)) {
        assert!(whole[..own.len()].iter().all(|&d| d == 0.0));
        whole[..own.len()].copy_from_slice(own);
    }
    whole
}

#[test]
fn parts_of_a_stencil_make_the_whole_derivative() {
    for precision in [Precision::F32, Precision::Bf16] {
        for variant in [Variant::SharedLevels, Variant::SharedLevelsAndOctants] {
            let weights = weights(variant, Head::FirstFlight);
            let mut inference = Inference::new(&weights, FORMS[1], precision).unwrap();
            let mut gradients = inference.input_gradients();
            // More than one batch.
            let n = 70;
            let raw = stencils(n, 3);
            let d_out: Vec<f32> = (0..4 * n).map(|i| 0.5 - 0.1 * (i % 11) as f32).collect();
            let mut whole = vec![0.0; raw.len()];
            gradients.outputs(&raw, &d_out, &mut whole).unwrap();
            for fine in [1, 3, 8] {
                let parts = by_parts(&mut gradients, &mut inference, fine, &raw, &d_out);
                assert!(parts == whole, "{precision:?} {variant:?}, {fine} fine levels");
            }
            // A sample's derivative is its own, on every clone.
            let mut alone = vec![0.0; INPUTS];
            let last = (n - 1) * INPUTS;
            gradients.clone().outputs(&raw[last..], &d_out[4 * (n - 1)..], &mut alone).unwrap();
            assert!(alone == whole[last..], "{precision:?} {variant:?}");
        }
    }
}

#[test]
fn mixed_states_have_the_limit_of_differences() {
    let weights = weights(Variant::SharedLevelsAndOctants, Head::FirstFlight);
    let mut inference = inference(&weights, FORMS[1]);
    let fine = 3;
    let (own, about) = (stencils(1, 5), stencils(2, 6));
    let (places, shares) = ([0, 1, 0], [0.8, 0.5, -0.3]);
    let d_out = [0.4, -0.2, 0.7, 0.3];
    let mut sum = |about: &[f32]| -> f64 {
        let states = inference.coarse_states(fine, about).unwrap();
        let mut out = [0.0; 4];
        inference.outputs_near(&states, &places, &shares, &own[..fine * LEVEL_INPUTS], &mut out).unwrap();
        out.iter().zip(d_out).map(|(o, d)| f64::from(*o) * f64::from(d)).sum()
    };
    let step = 0.02;
    // Whole levels at a time, so that differences stand out of f32 rounding.
    let differences: Vec<f64> = (0..2 * LEVELS)
        .map(|i| {
            let moved = |by: f32| {
                let mut about = about.clone();
                about[i * LEVEL_INPUTS..][..LEVEL_INPUTS].iter_mut().for_each(|v| *v *= 1.0 + by);
                about
            };
            (sum(&moved(step)) - sum(&moved(-step))) / f64::from(2.0 * step)
        })
        .collect();

    let states = inference.coarse_states(fine, &about).unwrap();
    let mut gradients = inference.input_gradients();
    let width = gradients.state_width();
    let (mut d_own, mut d_mixed) = (vec![0.0; fine * LEVEL_INPUTS], vec![0.0; width]);
    let own = &own[..fine * LEVEL_INPUTS];
    gradients.outputs_near(&states, &places, &shares, own, &d_out, &mut d_own, &mut d_mixed).unwrap();
    let mut d_states = vec![0.0; 2 * width];
    for (&place, share) in places.iter().zip(shares) {
        let to = &mut d_states[place as usize * width..][..width];
        to.iter_mut().zip(&d_mixed).for_each(|(to, d)| *to += share * d);
    }
    let mut d_about = vec![0.0; about.len()];
    gradients.coarse_states(fine, &about, &d_states, &mut d_about).unwrap();
    let derivatives: Vec<f64> = (0..2 * LEVELS)
        .map(|i| {
            let of = i * LEVEL_INPUTS..(i + 1) * LEVEL_INPUTS;
            d_about[of.clone()].iter().zip(&about[of]).map(|(&d, &v)| f64::from(d) * f64::from(v)).sum()
        })
        .collect();
    let largest = derivatives.iter().fold(0.0f64, |most, d| most.max(d.abs()));
    assert!(largest > 1e-3);
    for (i, (difference, derivative)) in differences.iter().zip(&derivatives).enumerate() {
        // ReLUs that a step of 2 % passes bend the difference.
        let close = (difference - derivative).abs() < 0.03 * largest;
        assert!(close, "level {i}: {difference} {derivative}, largest {largest}");
        assert_eq!(*derivative == 0.0, i % LEVELS < fine);
    }
}

#[test]
fn instruction_sets_agree() {
    let weights = weights(Variant::SharedLevelsAndOctants, Head::FirstFlight);
    let raw = stencils(5, 9);
    let d_out: Vec<f32> = (0..20).map(|i| 0.5 - 0.1 * (i % 11) as f32).collect();
    let on = |set| {
        let inference = inference(&weights, FORMS[1]).with_instruction_set(set).unwrap();
        let mut derivatives = vec![0.0; raw.len()];
        inference.input_gradients().outputs(&raw, &d_out, &mut derivatives).unwrap();
        derivatives
    };
    let portable = on(InstructionSet::Portable);
    let norm = |v: &mut dyn Iterator<Item = f32>| v.map(|d| f64::from(d).powi(2)).sum::<f64>().sqrt();
    let whole = norm(&mut portable.iter().copied());
    for set in InstructionSet::available() {
        let other = on(set);
        let difference = norm(&mut other.iter().zip(&portable).map(|(a, b)| a - b));
        // A ReLU at zero may fall on either side of rounding.
        assert!(difference < 1e-3 * whole, "{set}: {difference} of {whole}");
    }
}

#[test]
fn buffers_of_wrong_length_are_refused() {
    let weights = weights(Variant::SharedLevels, Head::FirstFlight);
    let mut inference = inference(&weights, FORMS[1]);
    let mut gradients = inference.input_gradients();
    let raw = stencils(2, 1);
    let mut d = vec![0.0; raw.len()];
    assert!(gradients.outputs(&raw, &[1.0; 4], &mut d).is_err());
    assert!(gradients.outputs(&raw, &[1.0; 8], &mut d[1..]).is_err());
    let states = inference.coarse_states(4, &raw).unwrap();
    let (own, width) = (&raw[..4 * LEVEL_INPUTS], gradients.state_width());
    let mut d_own = vec![0.0; own.len()];
    let mut near = |place: u32, d_out: usize, d_mixed: usize| {
        let (d_out, mut d_mixed) = (vec![1.0; d_out], vec![0.0; d_mixed]);
        gradients.outputs_near(&states, &[place], &[1.0], own, &d_out, &mut d_own, &mut d_mixed).is_ok()
    };
    assert!(near(1, 4, width) && !near(2, 4, width) && !near(1, 8, width) && !near(1, 4, width + 1));
    assert!(gradients.coarse_states(4, &raw, &vec![0.0; width], &mut d).is_err());
    assert!(gradients.coarse_states(9, &raw, &vec![0.0; 2 * width], &mut d).is_err());
}
