//! Trained weights carried in the library.

use std::path::Path;

use crate::RpnnError;
use crate::file::{TrainedNetwork, parse};

/// The file of the weights that the library carries, for readers of one's own such as
/// `VarBuilder::from_slice_safetensors`; [`shipped`] is what it holds.
pub const SHIPPED: &[u8] = pellucid_weights::SHARED_LEVELS_OCTANTS;

/// The weights of the paper's proposal, [`Variant::SharedLevelsAndOctants`](crate::Variant), with the head
/// [`Head::FirstFlight`](crate::variant::Head), and what they were trained for: 600 x 300 x 940 DPI, refractive index
/// 1.5, the default materials and others about them.
///
/// # Errors
/// Never in practice: only when the file in the library is damaged.
///
/// ```
/// let network = pellucid_rpnn::shipped().unwrap();
/// assert_eq!(network.weights.values().len(), 707_044);
/// assert_eq!(network.provenance.refractive_index, 1.5);
/// ```
pub fn shipped() -> Result<TrainedNetwork, RpnnError> {
    parse(Path::new("shared-levels-octants.safetensors"), SHIPPED)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variant::INPUTS;
    use crate::{Inference, Precision};
    use pellucid_stencil::{FLIGHT_BINS, FLIGHT_DEPTHS_MM, FirstFlight};

    /// A half-space of one material, seen from its surface: z up, the point's voxel the topmost.
    fn half_space(sigma_s: f32, sigma_a: f32) -> Vec<f32> {
        let mut stencil = vec![0.0; INPUTS];
        for (cell, value) in stencil.chunks_exact_mut(2).enumerate() {
            let (level, z) = (cell / 135, cell % 135 / 15);
            // Share of the cell below the top of the point's voxel, half a voxel above its centre.
            let edge = f64::powi(2.0, level as i32);
            let bottom = (z as f64 - 4.5) * edge;
            let share = ((0.5 - bottom) / edge).clamp(0.0, 1.0) as f32;
            value.copy_from_slice(&[sigma_s * share, sigma_a * share]);
        }
        stencil
    }

    /// Its first flight, straight down: Beer and Lambert's law.
    fn flight(sigma_s: f32, sigma_a: f32) -> FirstFlight {
        let extinction = f64::from(sigma_s + sigma_a);
        let left = |bin: usize| match bin {
            0 => 1.0,
            bin if bin < FLIGHT_BINS => (-extinction * FLIGHT_DEPTHS_MM[bin - 1]).exp(),
            _ => 0.0,
        };
        let albedo = f64::from(sigma_s) / extinction;
        let masses = std::array::from_fn(|bin| (albedo * (left(bin) - left(bin + 1))) as f32);
        FirstFlight { masses, ..FirstFlight::default() }
    }

    #[test]
    fn brighter_material_is_predicted_brighter() {
        let TrainedNetwork { weights, provenance } = shipped().unwrap();
        for precision in [Precision::F32, Precision::Bf16] {
            let mut inference = Inference::new(&weights, provenance.form, precision).unwrap();
            // Black, a mid tone and white of about 6/mm: radiance at index 1.5 near 0.03, 0.3 and 0.9.
            let media = [[2.0, 4.0], [5.9, 0.1], [5.995, 0.005]];
            let mut out = [0.0; 3];
            let stencils: Vec<f32> = media.iter().flat_map(|&[s, a]| half_space(s, a)).collect();
            let flights = media.map(|[s, a]| flight(s, a));
            inference.radiance(&stencils, &flights, &mut out).unwrap();
            assert!(out[0] < 0.15 && out[1] > out[0] + 0.1 && out[2] > out[1] + 0.1, "{out:?}");
            assert!(out[2] < 1.05, "{out:?}");
        }
    }
}
