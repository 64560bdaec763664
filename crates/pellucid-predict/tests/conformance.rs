//! The suite on every predictor of the crate, in any number of channels.

mod common;

use pellucid_predict::conformance::{self, Case};
use pellucid_predict::{Corrected, Correction, MonteCarlo, Network, Predictor};
use pellucid_rpnn::variant::Variant;

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
    in_channels(&common::network(common::provenance()), &[1, 3, 5]);
}

#[test]
fn the_network_on_a_spectrum() {
    in_channels(&common::network(common::provenance()), &[31]);
}

#[test]
fn the_network_without_sharing() {
    let network: Network = common::network(common::provenance()).with_sharing(None).unwrap();
    assert_eq!(network.trained().weights.variant(), Variant::SharedLevelsAndOctants);
    in_channels(&network, &[3]);
}

#[cfg(feature = "weights")]
#[test]
fn the_shipped_network() {
    in_channels(&Network::shipped().unwrap(), &[3]);
}

#[test]
fn the_network_corrected_by_paths() {
    let network = common::network(common::provenance());
    let corrected = Corrected::new(network, paths(), Correction::default()).unwrap();
    in_channels(&corrected, &[1, 3, 5]);
}

#[test]
fn the_network_corrected_on_a_spectrum() {
    let boxed: Box<dyn Predictor> = Box::new(common::network(common::provenance()));
    in_channels(&Corrected::new(boxed, paths(), Correction::default()).unwrap(), &[31]);
}
