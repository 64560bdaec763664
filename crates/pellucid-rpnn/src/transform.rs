//! From raw stencils to the network's input.

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
    /// Transforms one sample of 9 x 270 raw values (1/mm) in place.
    pub fn apply(self, sample: &mut [f32; INPUTS]) {
        for (k, level) in sample.chunks_exact_mut(LEVEL_INPUTS).enumerate() {
            let scale = (1u32 << k) as f32;
            match self {
                Self::Scaled => level.iter_mut().for_each(|v| *v *= scale / 64.0),
                Self::Log => {
                    for cell in level.chunks_exact_mut(2) {
                        cell[0] = (0.2 * scale * cell[0]).ln_1p() / 3.0;
                        cell[1] = (30.0 * scale * cell[1]).ln_1p() / 4.0;
                    }
                }
            }
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
}
