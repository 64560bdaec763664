//! Slabs of constant extinction whose albedo changes from voxel to voxel: the setting in which Rittig et al. 2021, section
//! 5.4, compare differentiable rendering with the heuristic.
//!
//! | module | owns |
//! | --- | --- |
//! | [`tracer`] | radiance by paths, and its derivative by the albedos by path replay |
//! | [`field`] | colours over the surface, and Gaussians over it |
//! | [`loss`] | what descent lowers |
//! | [`rule`] | stochastic gradient descent and Adam |
//! | [`heuristic`] | surface-first corrections |
//! | [`judge`] | errors by fresh paths |

pub mod field;
pub mod heuristic;
pub mod judge;
pub mod loss;
pub mod rule;
pub mod tracer;

use pellucid::voxel::MaterialTable;

/// Least albedo of a voxel. Above 0: path replay divides by it.
pub const LEAST: f32 = 0.02;
/// Weight below which paths play Russian roulette.
const ROULETTE: f64 = 0.1;
/// What the backing reflects, evenly into all directions.
const BACKING: f64 = 0.95;

/// A slab of cubic voxels that repeats sideways, over a diffuse backing.
#[derive(Clone, Debug)]
pub struct Slab {
    /// Voxels a side, along x and along y.
    pub edge: usize,
    /// Voxels from the surface to the backing.
    pub layers: usize,
    /// Edge of a voxel in mm.
    pub voxel_mm: f64,
    /// Extinction by channel, 1/mm; the phase function is isotropic.
    pub extinction: [f64; 3],
    /// Greatest albedo by channel: white.
    pub white: [f32; 3],
    /// Refractive index at the surface; 1 never reflects.
    pub index: f64,
    /// Reflectance of the backing, 0 to 1.
    pub backing: f64,
    /// Weight below which paths play Russian roulette; 0 for never.
    pub roulette: f64,
}

impl Slab {
    /// A slab of the print materials' white, made isotropic by similarity: (1 - g) of its scattering. `None` when the
    /// table has no white of three channels.
    pub fn of_white(edge: usize, layers: usize, voxel_mm: f64, index: f64) -> Option<Self> {
        let table = MaterialTable::cmykw();
        let white = table.get(table.label_of("white")?)?;
        let three = |values: &[f32]| values.get(..3).map(|v| [v[0], v[1], v[2]].map(f64::from));
        let (scattering, absorption) = (three(&white.sigma_s)?, three(&white.sigma_a)?);
        let scattering: [f64; 3] = std::array::from_fn(|c| (1.0 - f64::from(white.g.at(c))) * scattering[c]);
        let extinction: [f64; 3] = std::array::from_fn(|c| scattering[c] + absorption[c]);
        let white = std::array::from_fn(|c| (scattering[c] / extinction[c]) as f32);
        Some(Self { edge, layers, voxel_mm, extinction, white, index, backing: BACKING, roulette: ROULETTE })
    }

    /// Surface voxels.
    pub fn points(&self) -> usize {
        self.edge * self.edge
    }

    /// Voxels.
    pub fn voxels(&self) -> usize {
        self.points() * self.layers
    }

    /// Layers whose middle lies above a depth in mm.
    pub fn layers_above(&self, depth_mm: f64) -> usize {
        (0..self.layers).filter(|&layer| (layer as f64 + 0.5) * self.voxel_mm < depth_mm).count()
    }
}

/// One albedo a channel and voxel, each from [`LEAST`] to the slab's white.
#[derive(Clone, Debug, PartialEq)]
pub struct Albedo {
    /// `[channel][z][y][x]`, z from the surface down.
    values: [Vec<f32>; 3],
}

impl Albedo {
    /// Albedos by channel and voxel (z, y, x), brought into their range.
    pub fn of(slab: &Slab, value: impl Fn(usize, usize) -> f64) -> Self {
        let channel = |c: usize| {
            let within = |v: f64| (v as f32).clamp(LEAST, slab.white[c]);
            (0..slab.voxels()).map(|voxel| within(value(c, voxel))).collect()
        };
        Self { values: std::array::from_fn(channel) }
    }

    /// Of one channel, `[z][y][x]`.
    pub fn channel(&self, channel: usize) -> &[f32] {
        &self.values[channel]
    }

    /// Of all white that voxels take away, what those of the uppermost `depth_mm` take; 0 when there is nothing.
    pub fn share_above(&self, slab: &Slab, depth_mm: f64) -> f64 {
        let above = slab.layers_above(depth_mm) * slab.points();
        let taken = |c: usize, values: &[f32]| -> f64 {
            values.iter().map(|v| f64::from(slab.white[c]) - f64::from(*v)).sum()
        };
        let sum = |upto: usize| (0..3).map(|c| taken(c, &self.values[c][..upto])).sum::<f64>();
        let all = sum(slab.voxels());
        if all > 0.0 { sum(above) / all } else { 0.0 }
    }
}

#[cfg(test)]
pub(crate) fn small_slab() -> Slab {
    Slab {
        edge: 4,
        layers: 3,
        voxel_mm: 0.1,
        extinction: [4.0, 7.0, 12.0],
        white: [0.998, 0.999, 0.997],
        index: 1.5,
        backing: 0.9,
        roulette: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_keeps_its_similarity() {
        let slab = Slab::of_white(4, 3, 0.05, 1.5).unwrap();
        let table = MaterialTable::cmykw();
        let white = table.get(table.label_of("white").unwrap()).unwrap();
        for c in 0..3 {
            let reduced = white.sigma_a[c] / (white.sigma_a[c] + (1.0 - white.g.at(c)) * white.sigma_s[c]);
            assert!((1.0 - slab.white[c] - reduced).abs() < 1e-6);
        }
        assert_eq!(slab.layers_above(0.1), 2);
    }

    #[test]
    fn albedos_stay_in_range_and_depth_is_seen() {
        let slab = small_slab();
        let albedo = Albedo::of(&slab, |c, voxel| if voxel < 16 { 0.3 + c as f64 } else { 2.0 });
        assert_eq!(albedo.channel(1)[0], slab.white[1]);
        assert_eq!(albedo.channel(0)[16], slab.white[0]);
        assert_eq!(Albedo::of(&slab, |_, _| -1.0).channel(2), &[LEAST; 48]);
        assert_eq!(albedo.share_above(&slab, 0.1), 1.0);
        assert!((Albedo::of(&slab, |_, _| 0.5).share_above(&slab, 0.2) - 2.0 / 3.0).abs() < 1e-9);
    }
}
