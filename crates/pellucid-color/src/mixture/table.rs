//! The inverse as a table: colour to fractions in tens of nanoseconds.

use pellucid_voxel::Control;
use rayon::prelude::*;

use super::inverse::{Inverse, MatchOptions};
use super::{Fractions, MAX_MATERIALS, MixtureModel};
use crate::ColorError;

/// Nodes per axis by default.
pub const DEFAULT_NODES: usize = 33;

/// Colour to fractions over a cube of linear RGB relative to the media white.
///
/// The axes are cube roots, near to perceptual steps, and the interpolation is trilinear.
pub struct MixtureTable {
    nodes: usize,
    /// Nodes per unit of the cube root.
    scale: f32,
    count: usize,
    /// Fractions, `[blue][green][red]`, red fastest.
    values: Vec<[f32; MAX_MATERIALS]>,
}

impl MixtureTable {
    /// Tabulates the inverse of `model` over 0 to the brightest component that an absolute white
    /// has relative to the media white. `nodes` a side, 2 to 129. Runs on rayon's pool; the
    /// result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] for another number of nodes, [`ColorError::Cancelled`].
    pub fn build(
        model: &MixtureModel,
        options: MatchOptions,
        nodes: usize,
        control: &Control<'_>,
    ) -> Result<Self, ColorError> {
        if !(2..=129).contains(&nodes) {
            return Err(ColorError::invalid("table nodes", format!("{nodes} must lie within 2 to 129")));
        }
        let inverse = Inverse::new(model, options);
        let brightest = model.media_white().iter().map(|w| 1.0 / w).fold(1.0, f64::max).cbrt();
        let step = brightest / (nodes - 1) as f64;
        let done = std::sync::atomic::AtomicU64::new(0);
        let mut values = vec![[0.0_f32; MAX_MATERIALS]; nodes * nodes * nodes];
        values.par_chunks_mut(nodes).enumerate().try_for_each(|(row, out)| {
            control.check()?;
            let (green, blue) = ((row % nodes) as f64 * step, (row / nodes) as f64 * step);
            for (i, out) in out.iter_mut().enumerate() {
                let found = inverse.find([i as f64 * step, green, blue].map(|v| v * v * v));
                *out = found.fractions.values;
            }
            control.advance(&done, 1, (nodes * nodes) as u64);
            Ok::<(), ColorError>(())
        })?;
        Ok(Self { nodes, scale: (1.0 / step) as f32, count: model.materials(), values })
    }

    /// Fractions of a linear RGB colour relative to the media white. Outside the table's cube the
    /// nearest colour in it counts; a component that is not a number counts as 0.
    pub fn fractions(&self, rgb: [f32; 3]) -> Fractions {
        let last = (self.nodes - 1) as f32;
        let mut corner = [0; 3];
        let mut part = [0.0; 3];
        for i in 0..3 {
            let at = (rgb[i].max(0.0).cbrt() * self.scale).min(last);
            corner[i] = (at as usize).min(self.nodes - 2);
            part[i] = at - corner[i] as f32;
        }
        let base = (corner[2] * self.nodes + corner[1]) * self.nodes + corner[0];
        let mut sum = [0.0_f32; MAX_MATERIALS];
        for (blue, weight_blue) in [(0, 1.0 - part[2]), (1, part[2])] {
            for (green, weight_green) in [(0, 1.0 - part[1]), (1, part[1])] {
                let at = base + (blue * self.nodes + green) * self.nodes;
                let weight = weight_blue * weight_green;
                let (low, high) = (&self.values[at], &self.values[at + 1]);
                let (weight_low, weight_high) = (weight * (1.0 - part[0]), weight * part[0]);
                for k in 0..MAX_MATERIALS {
                    sum[k] += weight_low * low[k] + weight_high * high[k];
                }
            }
        }
        Fractions { values: sum, count: self.count }
    }

    /// Number of materials.
    pub fn materials(&self) -> usize {
        self.count
    }
}
