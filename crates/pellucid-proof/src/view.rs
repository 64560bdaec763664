//! Directions to look from.

use glam::DVec3;

use crate::ProofError;

/// A direction to look from, orthographic.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    name: String,
    azimuth_deg: f64,
    elevation_deg: f64,
}

impl View {
    /// A view called `name`, such as `front`. `azimuth_deg` turns about the vertical print axis: 0 looks along +y (at
    /// glTF's front), 90 along -x. `elevation_deg` is the height of the eye above the horizon, -90 to 90.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] for angles that are not finite or an elevation out of range.
    pub fn new(name: impl Into<String>, azimuth_deg: f64, elevation_deg: f64) -> Result<Self, ProofError> {
        if !azimuth_deg.is_finite() {
            return Err(ProofError::invalid(
                "azimuth",
                format!("{azimuth_deg} degrees; a finite angle is needed"),
            ));
        }
        if !(-90.0..=90.0).contains(&elevation_deg) {
            return Err(ProofError::invalid(
                "elevation",
                format!("{elevation_deg} degrees; -90 to 90 are possible"),
            ));
        }
        Ok(Self { name: name.into(), azimuth_deg, elevation_deg })
    }

    /// Front and back, each from a little above.
    pub fn front_and_back() -> Vec<Self> {
        [("front", 25.0), ("back", 205.0)]
            .map(|(name, azimuth_deg)| Self { name: name.into(), azimuth_deg, elevation_deg: 20.0 })
            .to_vec()
    }

    /// The view's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Angle about the vertical print axis in degrees.
    pub fn azimuth_deg(&self) -> f64 {
        self.azimuth_deg
    }

    /// Height of the eye above the horizon in degrees.
    pub fn elevation_deg(&self) -> f64 {
        self.elevation_deg
    }

    /// The axes of the picture: right, up, and into the scene; orthonormal.
    pub(crate) fn axes(&self) -> [DVec3; 3] {
        let (sin_a, cos_a) = self.azimuth_deg.to_radians().sin_cos();
        let (sin_e, cos_e) = self.elevation_deg.to_radians().sin_cos();
        let into = DVec3::new(-sin_a * cos_e, cos_a * cos_e, -sin_e);
        let right = DVec3::new(cos_a, sin_a, 0.0);
        [right, right.cross(into), into]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_orthonormal_and_up_is_up() {
        for (azimuth, elevation) in [(0.0, 0.0), (25.0, 20.0), (205.0, -60.0), (90.0, 89.0)] {
            let [right, up, into] = View::new("a", azimuth, elevation).unwrap().axes();
            for (a, b) in [(right, up), (up, into), (into, right)] {
                assert!(a.dot(b).abs() < 1e-12 && (a.length() - 1.0).abs() < 1e-12);
            }
            assert!(up.z > 0.0, "{azimuth} {elevation}: {up}");
        }
    }

    #[test]
    fn angles_out_of_range_are_refused() {
        for (azimuth, elevation) in [(f64::NAN, 0.0), (f64::INFINITY, 0.0), (0.0, 91.0), (0.0, f64::NAN)] {
            assert!(matches!(View::new("a", azimuth, elevation), Err(ProofError::Invalid(_))));
        }
    }
}
