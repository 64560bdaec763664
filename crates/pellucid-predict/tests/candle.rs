//! The network in candle against the network on own kernels, as predictors.

mod common;

use std::sync::Arc;

use pellucid_predict::conformance::Case;
use pellucid_predict::{
    CandleNetwork, Changed, Draw, Network, NetworkDevice, Pass, PredictError, Predictor, Sharing,
};
use pellucid_rpnn::variant::Head;
use pellucid_rpnn::{Precision, Provenance, TrainedNetwork, Variant, Weights};
use pellucid_voxel::Control;

fn trained(head: Head, provenance: Provenance) -> Arc<TrainedNetwork> {
    let weights = Weights::initial(Variant::SharedLevelsAndOctants, head, 2, 8.0);
    Arc::new(TrainedNetwork { weights, provenance })
}

fn in_candle(trained: &Arc<TrainedNetwork>, precision: Precision) -> CandleNetwork {
    CandleNetwork::new(trained.clone(), NetworkDevice::Cpu.open().unwrap(), precision).unwrap()
}

/// Radiance of the case's points, and how many values lie outside training.
fn predict(predictor: &dyn Predictor, case: &Case) -> (Vec<f32>, u64) {
    let mut bound = predictor.bind(case.object.clone()).unwrap();
    bound.update(&case.labels, Changed::Unknown, &Control::none()).unwrap();
    let mut out = vec![0.0; case.points.len() * case.object.channels()];
    let draw = Draw::new(0, Pass::Proof);
    let told = bound.predict(&case.points, draw, &mut out, &Control::none()).unwrap();
    (out, told.outside_training)
}

#[test]
fn it_predicts_as_the_own_kernels() {
    let case = Case::planted(3).unwrap();
    // Some of the materials scatter more than this range holds.
    let narrow = Provenance { sigma_s_range: [0.3, 8.0], ..common::provenance() };
    for head in Head::ALL {
        let trained = trained(head, narrow.clone());
        for sharing in [None, Some(Sharing { fine_levels: 9, ..Sharing::default() })] {
            let own = Network::new(trained.clone(), Precision::F32).with_sharing(sharing).unwrap();
            let (own, outside) = predict(&own, &case);
            assert!(outside > 0 && own.iter().any(|v| *v > 0.1));
            // What rounding of bf16 makes of a network that was never trained.
            for (precision, tolerance) in [(Precision::F32, 1e-4), (Precision::Bf16, 0.1)] {
                let candle = in_candle(&trained, precision).with_sharing(sharing).unwrap();
                let (values, seen) = predict(&candle, &case);
                assert_eq!(seen, outside);
                for (a, b) in values.iter().zip(&own) {
                    assert!((a - b).abs() <= tolerance * (1.0 + b), "{head:?} {precision:?}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn what_it_was_not_trained_for_and_devices_that_are_not_there_are_refused() {
    let case = Case::planted(3).unwrap();
    let other = Provenance { refractive_index: 1.0, ..common::provenance() };
    let network = in_candle(&trained(Head::Radiance, other), Precision::F32);
    let error = network.supports(&case.object).unwrap_err();
    assert!(matches!(&error, PredictError::Unsupported(f) if f.subject == "refractive index"), "{error}");
    assert!(network.with_batch(0).is_err());
    for device in [NetworkDevice::Cuda, NetworkDevice::Metal].into_iter().filter(|d| !d.built()) {
        let error = device.open().unwrap_err();
        assert!(matches!(error, PredictError::Unsupported(_)), "{error}");
        assert!(error.to_string().contains(device.feature()), "{error}");
    }
}

#[test]
fn the_identity_tells_engine_and_device() {
    let trained = trained(Head::FirstFlight, common::provenance());
    let identity = in_candle(&trained, Precision::F32).identity();
    let of = |setting: &str| identity.settings[setting].as_str();
    assert_eq!((of("engine"), of("device"), of("precision")), ("candle", "cpu", "f32"));
    assert_eq!(identity.weights.as_ref().unwrap().digest, trained.weights.digest());
    let own = Network::new(trained, Precision::F32).identity();
    assert_ne!(identity, own);
}

#[cfg(feature = "weights")]
#[test]
fn the_shipped_weights_predict_alike() {
    let case = Case::planted(3).unwrap();
    let whole = Some(Sharing { fine_levels: 9, ..Sharing::default() });
    let own = Network::new(pellucid_rpnn::shipped().unwrap(), Precision::F32).with_sharing(whole).unwrap();
    let candle = CandleNetwork::shipped(NetworkDevice::Cpu.open().unwrap()).unwrap();
    let (a, b) = (predict(&candle, &case).0, predict(&own, &case).0);
    let worst = a.iter().zip(&b).fold(0f32, |w, (a, b)| w.max((a - b).abs()));
    assert!(worst <= 1e-5, "{worst:e}");
}
