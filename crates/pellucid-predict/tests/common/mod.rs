//! An untrained network, as far from zero everywhere as a trained one.

use pellucid_predict::Network;
use pellucid_rpnn::transform::{FeatureTransform, InputForm, LevelOrder};
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

pub fn network(provenance: Provenance) -> Network {
    let weights = Weights::initial(Variant::SharedLevelsAndOctants, 2, 8.0);
    Network::new(TrainedNetwork { weights, provenance }, Precision::F32)
}
