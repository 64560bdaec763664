//! The suite on every predictor of the crate, in any number of channels.

mod common;

use pellucid_predict::conformance::{self, Case};
use pellucid_predict::{Averaged, Corrected, Correction, MonteCarlo, Predictor};

fn in_channels(predictor: &dyn Predictor, channels: &[usize]) {
    for &channels in channels {
        let case = Case::planted(channels).unwrap();
        if let Err(violation) = conformance::check(predictor, &case) {
            panic!("{channels} channels: {violation}: {:?}", violation.source);
        }
    }
}

fn paths() -> MonteCarlo {
    MonteCarlo::new(2).unwrap()
}

#[test]
fn path_tracing() {
    in_channels(&paths(), &[1, 3, 5, 31]);
}

#[test]
fn the_network() {
    in_channels(&common::network(common::provenance()), &[3]);
}

#[test]
fn the_network_in_any_number_of_channels() {
    in_channels(&common::small_network(), &[1, 5, 31]);
}

#[test]
fn the_network_with_a_first_flight() {
    in_channels(
        &common::network_of(pellucid_rpnn::variant::Head::FirstFlight, common::provenance()),
        &[3, 5],
    );
}

#[test]
fn the_network_without_sharing() {
    in_channels(&common::small_network().with_sharing(None).unwrap(), &[3]);
}

#[cfg(feature = "weights")]
#[test]
fn the_shipped_network() {
    in_channels(&pellucid_predict::Network::shipped().unwrap(), &[3]);
}

#[test]
fn the_network_corrected_by_paths() {
    let network = common::network(common::provenance());
    let corrected = Corrected::new(network, paths(), Correction::default()).unwrap();
    in_channels(&corrected, &[3]);
}

#[test]
fn the_network_between_averaged_paths() {
    let network = common::network(common::provenance());
    in_channels(&Averaged::new(network, paths(), 0.2).unwrap(), &[3]);
    let boxed: Box<dyn Predictor> = Box::new(common::small_network());
    in_channels(&Averaged::new(boxed, paths(), 0.2).unwrap(), &[1, 5]);
}

#[test]
fn the_network_corrected_in_any_number_of_channels() {
    let boxed: Box<dyn Predictor> = Box::new(common::small_network());
    in_channels(&Corrected::new(boxed, paths(), Correction::default()).unwrap(), &[1, 5, 31]);
}

#[cfg(feature = "candle")]
mod candle {
    use pellucid_predict::{CandleNetwork, NetworkDevice, Predictor, Sharing};
    use pellucid_rpnn::variant::Head;
    use pellucid_rpnn::{Precision, TrainedNetwork, Variant, Weights};

    use super::{common, in_channels};

    /// One that takes little time: no octants.
    fn small(head: Head) -> CandleNetwork {
        let weights = Weights::initial(Variant::SharedLevels, head, 2, 8.0);
        let trained = TrainedNetwork { weights, provenance: common::provenance() };
        CandleNetwork::new(trained, NetworkDevice::Cpu.open().unwrap(), Precision::F32).unwrap()
    }

    #[test]
    fn the_network_in_candle() {
        in_channels(&small(Head::Radiance), &[3]);
    }

    #[test]
    fn the_network_in_candle_in_batches_that_points_do_not_fill() {
        in_channels(&small(Head::Radiance).with_batch(32).unwrap(), &[1, 5]);
    }

    #[test]
    fn the_network_in_candle_after_an_exact_first_flight() {
        let shared = small(Head::FirstFlight);
        assert!(shared.identity().settings["sharing"].contains("every 0.25 mm"));
        in_channels(&shared, &[3]);
        let sharing = Sharing { spacing_mm: 0.0, ..Sharing::default() };
        in_channels(&shared.with_sharing(Some(sharing)).unwrap(), &[3]);
    }
}
