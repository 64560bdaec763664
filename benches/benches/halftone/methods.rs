//! Ways of making labels from one mixture.

use pellucid::halftone::{BlueNoiseMask, Spread, Thresholds, diffuse_errors};
use pellucid::voxel::{Control, LabelGrid, Pitch};
use pellucid_benches::appearance::Error;

use super::plate::{Plate, WHITE};

/// Labels from the darkest on, as the refinement's thresholds have them: black, cyan, magenta, yellow, white.
pub const ORDER: [u8; 5] = [4, 1, 2, 3, WHITE];

/// Of the mask, and of the errors that diffusion starts with.
const SEED: u64 = 0;

/// A way of halftoning.
pub enum Method {
    /// Thresholds of a blue-noise mask.
    Mask(BlueNoiseMask),
    /// Error diffusion.
    Diffusion(Spread),
}

/// Names and ways.
pub fn all(control: &Control<'_>) -> Result<Vec<(&'static str, Method)>, Error> {
    let mask = BlueNoiseMask::new(Pitch::j750(), SEED, control)?;
    Ok(vec![
        ("blue-noise mask", Method::Mask(mask)),
        ("error diffusion, layer by layer", Method::Diffusion(Spread::layer())),
        ("error diffusion, half upwards", Method::Diffusion(Spread::layers())),
        ("error diffusion by pitch", Method::Diffusion(Spread::of_pitch(Pitch::j750()))),
    ])
}

impl Method {
    /// The plate with its skin in a mixture, fractions by [`ORDER`].
    pub fn labels(
        &self,
        plate: &Plate,
        mixture: &[f32; 5],
        control: &Control<'_>,
    ) -> Result<LabelGrid, Error> {
        let chosen: Box<dyn Fn([u32; 3]) -> u8 + Sync> = match self {
            Self::Mask(mask) => {
                let mut row = [0; 4];
                Thresholds::write(mixture, &mut row);
                Box::new(move |voxel| ORDER[Thresholds::choose(&row, mask.threshold(voxel))])
            }
            Self::Diffusion(spread) => {
                let [sx, sy, _] = plate.frame.size().map(|s| s as usize);
                let fractions = |voxel, fractions: &mut [f32]| {
                    fractions.copy_from_slice(mixture);
                    plate.in_skin(voxel)
                };
                let found = diffuse_errors(plate.frame.size(), 5, spread, SEED, fractions, control)?;
                Box::new(move |[x, y, z]| {
                    ORDER[usize::from(found[(z as usize * sy + y as usize) * sx + x as usize])]
                })
            }
        };
        Ok(plate.labels(chosen))
    }
}
