//! How far scattering keeps its direction.

/// Henyey-Greenstein mean cosine of a material: one for every channel, or one a channel.
///
/// In files it is a number or a list of numbers.
///
/// ```
/// use pellucid_voxel::Anisotropy;
/// assert_eq!(Anisotropy::from(0.4).at(7), 0.4);
/// let measured = Anisotropy::PerChannel(vec![0.5, 0.4, 0.3]);
/// assert_eq!((measured.at(0), measured.at(2)), (0.5, 0.3));
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(untagged))]
pub enum Anisotropy {
    /// The same in every channel, within -0.99..=0.99.
    Uniform(f32),
    /// One value a channel, each within -0.99..=0.99.
    PerChannel(Vec<f32>),
}

impl Anisotropy {
    /// The mean cosine in a channel; 0 past the last of a list.
    pub fn at(&self, channel: usize) -> f32 {
        match self {
            Self::Uniform(g) => *g,
            Self::PerChannel(list) => list.get(channel).copied().unwrap_or(0.0),
        }
    }

    /// The values that are told: one, or one a channel.
    pub fn values(&self) -> &[f32] {
        match self {
            Self::Uniform(g) => std::slice::from_ref(g),
            Self::PerChannel(list) => list,
        }
    }
}

impl From<f32> for Anisotropy {
    fn from(g: f32) -> Self {
        Self::Uniform(g)
    }
}
