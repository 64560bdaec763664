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

use common::weights;
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

fn all_agree(variant: Variant, head: Head) {
    let (cases, forms) = (cases::all(), forms::all());
    let weights = weights(variant, head, 5);
    for (transform, order) in [
        (FeatureTransform::Log, LevelOrder::CoarseToFine),
        (FeatureTransform::Scaled, LevelOrder::CoarseToFine),
        (FeatureTransform::Log, LevelOrder::FineToCoarse),
        (FeatureTransform::Scaled, LevelOrder::FineToCoarse),
    ] {
        let form = InputForm { transform, order };
        for case in &cases {
            let plain: Vec<Vec<f64>> =
                case.stencils.chunks_exact(INPUTS).map(|s| naive::outputs(&weights, form, s)).collect();
            if case.name == "mixtures" {
                let alive = plain.iter().flatten().filter(|v| **v > 0.01).count();
                assert!(2 * alive > plain.len(), "dead outputs prove nothing: {plain:?}");
            }
            for f in &forms {
                let off = difference(head, &plain, &(f.compute)(&weights, form, &case.stencils));
                let what = format!("{}: {variant:?}, {head:?}, {form:?}, {}", f.name, case.name);
                assert!(off <= f.tolerance, "{what}: {off:e}");
            }
        }
    }
}

#[test]
fn baseline() {
    Head::ALL.into_iter().for_each(|head| all_agree(Variant::Baseline, head));
}

#[test]
fn shared_levels() {
    Head::ALL.into_iter().for_each(|head| all_agree(Variant::SharedLevels, head));
}

#[test]
fn shared_octants() {
    Head::ALL.into_iter().for_each(|head| all_agree(Variant::SharedOctants, head));
}

#[test]
fn shared_levels_and_octants() {
    Head::ALL.into_iter().for_each(|head| all_agree(Variant::SharedLevelsAndOctants, head));
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
