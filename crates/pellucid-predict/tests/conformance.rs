//! The suite on every predictor of the crate, in any number of channels.

mod common;

use pellucid_predict::conformance::{self, Case};
use pellucid_predict::{Corrected, Correction, MonteCarlo, Predictor};

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
fn the_network_corrected_in_any_number_of_channels() {
    let boxed: Box<dyn Predictor> = Box::new(common::small_network());
    in_channels(&Corrected::new(boxed, paths(), Correction::default()).unwrap(), &[1, 5, 31]);
}
