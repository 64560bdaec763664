//! From raw stencils to the network's input.

use pellucid_core::InstructionSet;

use crate::kernel;
use crate::variant::{INPUTS, LEVEL_INPUTS};

/// How coefficients are brought into the network's range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum FeatureTransform {
    /// Level k times 2^(k-1) / 64: optical density kept under isometric scaling (section 4.4, Γ = 6).
    #[default]
    #[serde(rename = "scaled")]
    Scaled,
    /// `ln(1 + 0.2 s)/3` and `ln(1 + 30 a)/4` of the coefficients s, a times 2^(k-1): compresses the
    /// range, which spans five decades over the levels.
    #[serde(rename = "log")]
    Log,
}

impl FeatureTransform {
    /// Transforms one sample of 9 x 270 raw values (1/mm, none negative) in place.
    pub fn apply(self, sample: &mut [f32; INPUTS]) {
        for (k, level) in sample.chunks_exact_mut(LEVEL_INPUTS).enumerate() {
            self.apply_level(k, level);
        }
    }

    /// Turns derivatives by one level's values after the transform into those by the raw ones.
    fn pull_back_level(self, k: usize, raw: &[f32], derivatives: &mut [f32]) {
        let scale = (1u32 << k) as f32;
        match self {
            Self::Scaled => derivatives.iter_mut().for_each(|d| *d *= scale / 64.0),
            Self::Log => {
                let pairs = derivatives.as_chunks_mut::<2>().0.iter_mut().zip(raw.as_chunks::<2>().0);
                for ([d_s, d_a], [s, a]) in pairs {
                    *d_s *= 0.2 * scale / (3.0 * (1.0 + 0.2 * scale * s));
                    *d_a *= 30.0 * scale / (4.0 * (1.0 + 30.0 * scale * a));
                }
            }
        }
    }

    fn apply_level(self, k: usize, level: &mut [f32]) {
        let scale = (1u32 << k) as f32;
        match self {
            Self::Scaled => level.iter_mut().for_each(|v| *v *= scale / 64.0),
            Self::Log => kernel::log_features(InstructionSet::chosen(), level, scale),
        }
    }
}

/// Which level the network reads first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LevelOrder {
    /// From the voxel outward (the paper's Figure 5).
    #[default]
    FineToCoarse,
    /// From the whole inward: what the coarse levels make of the surroundings hardly differs between
    /// neighbours, who can share it.
    CoarseToFine,
}

/// What is done to a raw stencil before the network reads it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct InputForm {
    /// What is done to the coefficients.
    pub transform: FeatureTransform,
    /// Order of the levels; files without it were trained from fine to coarse.
    #[serde(default)]
    pub order: LevelOrder,
}

impl InputForm {
    /// Brings one sample of 9 x 270 raw values (1/mm, none negative, finest level first) into this form in
    /// place.
    pub fn apply(self, sample: &mut [f32; INPUTS]) {
        self.apply_levels(0, sample);
    }

    /// [`InputForm::apply`] for some levels of a sample, `[level][270]`, the finest being number `first`,
    /// from 0.
    pub fn apply_levels(self, first: usize, levels: &mut [f32]) {
        for (k, level) in levels.chunks_exact_mut(LEVEL_INPUTS).enumerate() {
            self.transform.apply_level(first + k, level);
        }
        self.turn(levels);
    }

    /// Turns derivatives by levels in this form, ordered as [`InputForm::apply_levels`] left them, into derivatives by
    /// their `raw` values, the finest first, in place.
    pub fn pull_back_levels(self, first: usize, raw: &[f32], derivatives: &mut [f32]) {
        self.turn(derivatives);
        let levels = derivatives.chunks_exact_mut(LEVEL_INPUTS).zip(raw.chunks_exact(LEVEL_INPUTS));
        for (k, (derivatives, raw)) in levels.enumerate() {
            self.transform.pull_back_level(first + k, raw, derivatives);
        }
    }

    /// Exchanges the order of levels, finest first, and the one in which they are read.
    fn turn(self, levels: &mut [f32]) {
        if self.order == LevelOrder::CoarseToFine {
            let count = levels.len() / LEVEL_INPUTS;
            let (front, back) = levels.split_at_mut(count / 2 * LEVEL_INPUTS);
            let back = back.chunks_exact_mut(LEVEL_INPUTS).rev();
            front.chunks_exact_mut(LEVEL_INPUTS).zip(back).for_each(|(a, b)| a.swap_with_slice(b));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_the_scale_of_a_level_keeps_its_input() {
        // A medium shrunk to half its size and twice its density looks the same one level finer.
        for transform in [FeatureTransform::Scaled, FeatureTransform::Log] {
            let mut coarse = Box::new([0.75; INPUTS]);
            let mut fine = Box::new([1.5; INPUTS]);
            transform.apply(&mut coarse);
            transform.apply(&mut fine);
            assert_eq!(coarse[LEVEL_INPUTS..2 * LEVEL_INPUTS], fine[..LEVEL_INPUTS]);
        }
    }

    #[test]
    fn coarse_to_fine_turns_the_levels_round() {
        let raw: [f32; INPUTS] = std::array::from_fn(|i| i as f32);
        let (mut fine_first, mut coarse_first) = (raw, raw);
        InputForm::default().apply(&mut fine_first);
        InputForm { order: LevelOrder::CoarseToFine, ..Default::default() }.apply(&mut coarse_first);
        let levels = fine_first.chunks_exact(LEVEL_INPUTS);
        assert!(levels.rev().eq(coarse_first.chunks_exact(LEVEL_INPUTS)));
        let old: InputForm = serde_json::from_str(r#"{"transform": "log"}"#).unwrap();
        assert_eq!(old, InputForm { transform: FeatureTransform::Log, order: LevelOrder::FineToCoarse });
    }
}
