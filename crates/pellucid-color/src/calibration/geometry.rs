//! From what an instrument reads to the radiance that is simulated.

use crate::ColorError;
use crate::plane_parallel::fresnel_internal;

/// How patches were lit and looked at.
///
/// The simulated radiance L counts neither light that the surface mirrors nor what it keeps out: L of a medium that
/// absorbs nothing is 1. Readings are reflectance factors, relative to a perfect diffuser.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Geometry {
    /// Values are L itself, as this library's own predictions are.
    Radiance,
    /// Lit from 45 degrees all round or from two sides, seen along the normal (45°:0°): most instruments of the
    /// graphic arts, flat-bed scanners, and copy stands.
    #[default]
    FortyFive,
    /// Lit from everywhere, the mirrored light kept out (d:8°, specular excluded).
    DiffuseExcluded,
    /// Lit from everywhere, the mirrored light counted (d:8°, specular included).
    DiffuseIncluded,
}

impl Geometry {
    /// All of them.
    pub const ALL: [Self; 4] =
        [Self::FortyFive, Self::DiffuseExcluded, Self::DiffuseIncluded, Self::Radiance];

    /// A short name: `45/0`, `d/8-excluded`, `d/8-included`, `radiance`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Radiance => "radiance",
            Self::FortyFive => "45/0",
            Self::DiffuseExcluded => "d/8-excluded",
            Self::DiffuseIncluded => "d/8-included",
        }
    }

    /// `reading = factor · L + mirrored`, for a smooth surface of a refractive index.
    ///
    /// Light of the normal leaves by 1 - F(0). Of light at 45° 1 - F(45°) gets in, of light from everywhere the mean
    /// over the hemisphere, which is what L = 1 stands for; the first is greater, so that for n = 1.5 the two
    /// factors of 45°:0° make 1.004.
    fn line(self, index: f64) -> (f64, f64) {
        let normal = fresnel_internal(1.0, index);
        match self {
            Self::Radiance => (1.0, 0.0),
            Self::FortyFive => {
                // The cosine inside of light at 45° outside: reflectance is the same from both sides.
                let inside = (1.0 - 0.5 / (index * index)).sqrt();
                let entering = 1.0 - fresnel_internal(inside, index);
                ((1.0 - normal) * entering / (1.0 - diffuse_external(index)), 0.0)
            }
            Self::DiffuseExcluded => (1.0 - normal, 0.0),
            Self::DiffuseIncluded => (1.0 - normal, normal),
        }
    }

    /// L of a reading, both relative to a perfect diffuser. Noise can put it outside 0..=1.
    ///
    /// ```
    /// use pellucid_color::calibration::Geometry;
    /// assert_eq!(Geometry::Radiance.radiance(0.5, 1.5)?, 0.5);
    /// assert!((Geometry::FortyFive.radiance(0.5, 1.5)? - 0.498).abs() < 5e-4);
    /// assert!((Geometry::DiffuseIncluded.radiance(1.0, 1.5)? - 1.0).abs() < 1e-12);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// [`ColorError::Invalid`] for a refractive index outside 1 to 3.
    pub fn radiance(self, reading: f64, refractive_index: f64) -> Result<f64, ColorError> {
        if !(1.0..=3.0).contains(&refractive_index) {
            let reason = format!("{refractive_index} must lie within 1 to 3");
            return Err(ColorError::invalid("refractive index", reason));
        }
        let (factor, mirrored) = self.line(refractive_index);
        Ok((reading - mirrored) / factor)
    }
}

/// Mean reflectance of a surface for light from everywhere outside, ∫ 2 µ F(µ) dµ, by the midpoint rule.
fn diffuse_external(index: f64) -> f64 {
    const STEPS: usize = 2000;
    let at = |i: usize| {
        let mu = (i as f64 + 0.5) / STEPS as f64;
        let inside = (1.0 - (1.0 - mu * mu) / (index * index)).sqrt();
        2.0 * mu * fresnel_internal(inside, index)
    };
    (0..STEPS).map(at).sum::<f64>() / STEPS as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_reflectance_is_walshs() {
        assert!((diffuse_external(1.5) - 0.0918).abs() < 1e-4);
        assert_eq!(diffuse_external(1.0), 0.0);
    }

    #[test]
    fn without_an_index_step_all_read_the_same() {
        for geometry in Geometry::ALL {
            assert_eq!(geometry.radiance(0.4, 1.0).unwrap(), 0.4);
            assert!(geometry.radiance(0.4, 0.9).is_err());
        }
        let (factor, mirrored) = Geometry::FortyFive.line(1.5);
        assert!((factor - 1.004).abs() < 1e-3 && mirrored == 0.0, "{factor}");
    }
}
