//! What a scattering counts for materials of other phase functions.

use pellucid_voxel::MaterialTable;

use crate::phase::cosine_density;

/// Below this in 1/mm a material counts as clear.
const CLEAR: f32 = 1e-6;

/// The phase functions of a table in a channel, and a channel's scattering by palette position.
pub(crate) struct Phases {
    /// The different mean cosines.
    cosines: Vec<f32>,
    /// Position in `cosines` by material.
    of_material: Vec<usize>,
    /// Mean cosine by palette position.
    by_position: [f32; 16],
    /// One over sigma_s in mm by palette position, 0 where that is clear.
    pub(crate) inv_sigma_s: [f32; 16],
}

impl Phases {
    pub(crate) fn new(materials: &MaterialTable, palette: &[u8], channel: usize) -> Self {
        let mut cosines: Vec<f32> = Vec::new();
        let of_material = materials
            .materials()
            .iter()
            .map(|m| {
                let own = m.g.at(channel);
                cosines.iter().position(|&g| g == own).unwrap_or_else(|| {
                    cosines.push(own);
                    cosines.len() - 1
                })
            })
            .collect();
        let (mut by_position, mut inv_sigma_s) = ([0.0; 16], [0.0; 16]);
        for (p, &label) in palette.iter().enumerate() {
            if let Some(m) = materials.get(label) {
                by_position[p] = m.g.at(channel);
                inv_sigma_s[p] = if m.sigma_s[channel] >= CLEAR { 1.0 / m.sigma_s[channel] } else { 0.0 };
            }
        }
        Self { cosines, of_material, by_position, inv_sigma_s }
    }

    /// Number of different phase functions.
    pub(crate) fn len(&self) -> usize {
        self.cosines.len()
    }

    #[inline(always)]
    pub(crate) fn several(&self) -> bool {
        self.cosines.len() > 1
    }

    /// Position of a material's phase function; materials count from 0.
    pub(crate) fn of(&self, material: usize) -> usize {
        self.of_material[material]
    }

    /// Density of phase function `k` at a cosine, over that of the palette's material.
    #[inline]
    pub(crate) fn ratio(&self, k: usize, position: u32, cosine: f32) -> f32 {
        let (g, own) = (self.cosines[k], self.by_position[position as usize]);
        if g == own {
            return 1.0;
        }
        let cosine = f64::from(cosine.clamp(-1.0, 1.0));
        (cosine_density(cosine, f64::from(g)) / cosine_density(cosine, f64::from(own))) as f32
    }
}
