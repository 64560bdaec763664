//! Every form of the network through one suite: the own kernels in f32 and bf16 on every instruction set of the
//! machine, and candle (feature `candle`), against a naive one in f64.

mod cases;
#[path = "../common/mod.rs"]
mod common;
mod forms;
mod naive;
#[cfg(all(feature = "candle", feature = "weights"))]
mod shipped;
mod symmetry;

use cases::Case;
use common::weights;
use forms::Form;
use pellucid_rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
use pellucid_rpnn::variant::{Head, INPUTS};
use pellucid_rpnn::{Network, Precision, Variant, Weights};

/// Greatest difference of a form from the naive network, as a part of what its tolerance refers to.
fn difference(head: Head, plain: &[Vec<f64>], out: &[f64]) -> f64 {
    let scale = plain.iter().flatten().fold(1.0, |s, v| v.abs().max(s)) + 1.0;
    let off = plain.iter().zip(out.chunks_exact(head.outputs())).flat_map(|(plain, out)| {
        plain.iter().zip(out).map(|(&plain, &out)| {
            assert!(out.is_finite());
            (out - if head == Head::Radiance { plain.max(0.0) } else { plain }).abs()
        })
    });
    off.fold(0.0, f64::max) / scale
}

/// Weights of which no radiance is cut off to zero: the last layer has no negative one.
fn bright(mut weights: Weights) -> Weights {
    let end = weights.layout().layers.last().unwrap().weight.clone();
    weights.values_mut()[end].iter_mut().for_each(|w| *w = w.abs());
    weights
}

fn all_agree(variant: Variant) {
    let (cases, forms) = (cases::all(), forms::all());
    let orders = [LevelOrder::CoarseToFine, LevelOrder::FineToCoarse];
    let transforms = [FeatureTransform::Log, FeatureTransform::Scaled];
    let inputs =
        orders.into_iter().flat_map(|order| transforms.map(|transform| InputForm { transform, order }));
    for form in inputs {
        for weights in [
            bright(weights(variant, Head::Radiance, 5)),
            weights(variant, Head::Radiance, 6),
            weights(variant, Head::FirstFlight, 7),
        ] {
            agree(&weights, form, &cases, &forms);
        }
    }
}

fn agree(weights: &Weights, form: InputForm, cases: &[Case], forms: &[Form]) {
    let (variant, head) = (weights.variant(), weights.head());
    let mut alive = 0;
    for case in cases {
        let plain: Vec<Vec<f64>> =
            case.stencils.chunks_exact(INPUTS).map(|s| naive::outputs(weights, form, s)).collect();
        alive += plain.iter().flatten().filter(|v| **v > 0.01).count();
        for f in forms {
            let off = difference(head, &plain, &(f.compute)(weights, form, &case.stencils));
            let what = format!("{}: {variant:?}, {head:?}, {form:?}, {}", f.name, case.name);
            assert!(off <= f.tolerance, "{what}: {off:e}");
        }
    }
    // Outputs that are all cut off prove nothing; single ones that are do.
    let last = weights.layout().layers.last().unwrap().weight.clone();
    let bright = weights.values()[last].iter().all(|w| *w >= 0.0);
    assert!(!bright || alive > 20, "{variant:?}, {form:?}: {alive} outputs above zero");
}

#[test]
fn baseline() {
    all_agree(Variant::Baseline);
}

#[test]
fn shared_levels() {
    all_agree(Variant::SharedLevels);
}

#[test]
fn shared_octants() {
    all_agree(Variant::SharedOctants);
}

#[test]
fn shared_levels_and_octants() {
    all_agree(Variant::SharedLevelsAndOctants);
}

/// The paper's Table 2, and three more outputs of the last layer.
#[test]
fn parameter_counts_are_exact() {
    assert_eq!(Variant::ALL.map(Variant::parameters), [2_046_871, 365_851, 3_767_341, 706_861]);
    for variant in Variant::ALL {
        let end = if variant.shares_octants() { 60 } else { 270 };
        let of = |head| Weights::zeros(variant, head).values().len();
        assert_eq!(of(Head::Radiance), variant.parameters());
        assert_eq!(of(Head::FirstFlight), variant.parameters() + 3 * (end + 1));
    }
}

#[test]
fn buffers_of_wrong_length_are_refused() {
    let weights = weights(Variant::SharedLevels, Head::Radiance, 1);
    let mut network = Network::new(Variant::SharedLevels, Head::Radiance, 2, Precision::F32).unwrap();
    network.load(&weights).unwrap();
    assert!(network.forward(&[0.0; INPUTS], &mut [0.0; 2]).is_err());
    assert!(network.forward(&vec![0.0; 3 * INPUTS], &mut [0.0; 3]).is_err());
    assert!(network.load(&Weights::zeros(Variant::Baseline, Head::Radiance)).is_err());
    assert!(network.backward(&[0.0], &mut [0.0; 5]).is_err());
    assert!(Network::new(Variant::Baseline, Head::Radiance, 0, Precision::F32).is_err());
}
