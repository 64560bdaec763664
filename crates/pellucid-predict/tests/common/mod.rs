//! Untrained networks, as far from zero everywhere as a trained one.
#![allow(dead_code, reason = "each test binary uses its own part")]

use pellucid_predict::{Network, Sharing};
use pellucid_rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
use pellucid_rpnn::variant::Head;
use pellucid_rpnn::{Precision, Provenance, TrainedNetwork, Variant, Weights};
use pellucid_voxel::Pitch;

pub fn provenance() -> Provenance {
    Provenance {
        form: InputForm { transform: FeatureTransform::Log, order: LevelOrder::CoarseToFine },
        pitch_mm: Pitch::j750().mm(),
        refractive_index: 1.5,
        sigma_s_range: [0.3, 24.0],
        sigma_a_range: [0.0027, 16.2],
        history: "drawn at random\nnever trained".into(),
    }
}

/// One that takes a tenth of the time: no octants, and all levels but one shared.
pub fn small_network() -> Network {
    let weights = Weights::initial(Variant::SharedLevels, Head::Radiance, 2, 8.0);
    let trained = TrainedNetwork { weights, provenance: provenance() };
    let sharing = Sharing { fine_levels: 1, ..Sharing::default() };
    Network::new(trained, Precision::F32).with_sharing(Some(sharing)).unwrap()
}

pub fn network(provenance: Provenance) -> Network {
    network_of(Head::Radiance, provenance)
}

pub fn network_of(head: Head, provenance: Provenance) -> Network {
    // Far enough from zero that no ReLU at the end cuts off.
    let weights = Weights::initial(Variant::SharedLevelsAndOctants, head, 2, 8.0);
    Network::new(TrainedNetwork { weights, provenance }, Precision::F32)
}
