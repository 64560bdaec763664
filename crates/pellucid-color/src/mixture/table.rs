//! The inverse as a table: colour to fractions in tens of nanoseconds.

use pellucid_voxel::Control;

use super::inverse::{Inverse, MatchOptions};
use super::{Fractions, MAX_MATERIALS, MixtureModel};
use crate::ColorError;
use crate::cube::ColorCube;

/// Nodes per axis by default.
pub const DEFAULT_NODES: usize = 33;

/// Colour to fractions over a cube of linear RGB relative to the media white.
///
/// The axes are cube roots, near to perceptual steps, and the interpolation is trilinear.
pub struct MixtureTable {
    cube: ColorCube<MAX_MATERIALS>,
    count: usize,
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
        let inverse = Inverse::new(model, options);
        let cube =
            ColorCube::build(nodes, model.brightest(), control, |rgb| inverse.find(rgb).fractions.values)?;
        Ok(Self { cube, count: model.materials() })
    }

    /// Fractions of a linear RGB colour relative to the media white. Outside the table's cube the
    /// nearest colour in it counts; a component that is not a number counts as 0.
    pub fn fractions(&self, rgb: [f32; 3]) -> Fractions {
        Fractions { values: self.cube.at(rgb), count: self.count }
    }

    /// Number of materials.
    pub fn materials(&self) -> usize {
        self.count
    }
}
