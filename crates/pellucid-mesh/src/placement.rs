//! How large a model is printed, and where it lies in print space.

use pellucid_voxel::{Frame, Pitch};

use crate::{MeshError, Model};

/// How large a model is printed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "snake_case"))]
pub enum Scale {
    /// The model's own metres.
    Native,
    /// Scaled evenly so that it is this many millimetres high (along print z).
    HeightMm(f64),
    /// Scaled evenly so that it is this many millimetres wide (along print x).
    WidthMm(f64),
}

/// An extent below this share of the largest is what rounding leaves of a flat model.
const FLAT: f64 = 1e-6;

/// Most voxels in the box of a voxelised model: a 250 mm cube at 600 x 300 x 940 DPI.
pub const MAX_VOXELS: u64 = 1 << 38;

/// Maps model space (metres) to print space (millimetres): `(p - origin) * scale`, so that the
/// lower corner of the model's box lies at 0.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Placement {
    origin_m: [f64; 3],
    mm_per_m: f64,
    extent_mm: [f64; 3],
}

impl Placement {
    /// Places a model at a scale.
    ///
    /// Cheap: looks at every triangle once.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] for a height or width that is not positive and finite, a model
    /// without extent, or one that is flat along the axis to scale.
    pub fn new(model: &Model, scale: Scale) -> Result<Self, MeshError> {
        let [low, high] = model.bounds_m();
        let extent: [f64; 3] = std::array::from_fn(|a| high[a] - low[a]);
        let largest = extent.into_iter().fold(0.0, f64::max);
        let fail = |object: &str, reason: String, remedy: &str| {
            MeshError::invalid(model.name(), object, reason, remedy)
        };
        if largest <= 0.0 {
            return Err(fail(
                "model",
                "all its vertices are one point".into(),
                "export a mesh with an extent",
            ));
        }
        let along = |name: &str, axis: usize, mm: f64| {
            if !(mm.is_finite() && mm > 0.0) {
                return Err(fail(name, format!("{mm} mm"), "give a positive number of millimetres"));
            }
            if extent[axis] <= FLAT * largest {
                let (reason, remedy) = match name {
                    "height" => {
                        ("it has no extent along z", "give a width, print it at its own size or stand it up")
                    }
                    _ => ("it has no extent along x", "give a height, print it at its own size or turn it"),
                };
                return Err(fail(name, format!("the model is flat: {reason} to scale"), remedy));
            }
            Ok(mm / extent[axis])
        };
        let mm_per_m = match scale {
            Scale::Native => 1000.0,
            Scale::HeightMm(mm) => along("height", 2, mm)?,
            Scale::WidthMm(mm) => along("width", 0, mm)?,
        };
        if !mm_per_m.is_finite() {
            return Err(fail("model", format!("it is {largest:e} m large"), "export it in metres"));
        }
        Ok(Self { origin_m: low, mm_per_m, extent_mm: extent.map(|e| e * mm_per_m) })
    }

    /// Millimetres of print per metre of model.
    pub fn mm_per_m(&self) -> f64 {
        self.mm_per_m
    }

    /// The model's extent `[x, y, z]` in print space, in millimetres.
    pub fn extent_mm(&self) -> [f64; 3] {
        self.extent_mm
    }

    /// A model point in print space.
    pub fn to_mm(&self, point_m: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| (point_m[a] - self.origin_m[a]) * self.mm_per_m)
    }

    /// Voxels `[x, y, z]` that the model's box takes at a pitch, without margin; at least 1 each.
    pub fn size_voxels(&self, pitch: Pitch) -> [u64; 3] {
        let mm = pitch.mm();
        // A box that passes a voxel face by rounding only does not take one more voxel. The cast
        // saturates.
        std::array::from_fn(|a| (self.extent_mm[a] / mm[a] - 1e-6).ceil().max(1.0) as u64)
    }

    /// The frame that holds the model with `margin` voxels of air around it. The lower corner of
    /// the model's box lies on a voxel corner.
    ///
    /// # Errors
    /// [`MeshError::Unsupported`] past [`Frame::MAX_EDGE`] or [`MAX_VOXELS`].
    pub fn frame(&self, model: &Model, pitch: Pitch, margin: u32) -> Result<Frame, MeshError> {
        let size = self.size_voxels(pitch).map(|s| s.saturating_add(2 * u64::from(margin)));
        let voxels = size.iter().try_fold(1u64, |product, &s| product.checked_mul(s));
        let edges = size.map(|s| u32::try_from(s).ok().filter(|&s| s <= Frame::MAX_EDGE));
        let ([Some(x), Some(y), Some(z)], true) = (edges, voxels.is_some_and(|v| v <= MAX_VOXELS)) else {
            return Err(MeshError::unsupported(
                model.name(),
                "print size",
                format!(
                    "{} mm is {size:?} voxels, past {} an edge or {MAX_VOXELS} in all",
                    self.extent_mm.map(millimetres).join(" x "),
                    Frame::MAX_EDGE
                ),
                "print it smaller, or at a coarser pitch",
            ));
        };
        let origin = pitch.mm().map(|p| -p * f64::from(margin));
        Ok(Frame::new(origin, pitch, [x, y, z])?)
    }
}

/// A length to read: a tenth of a millimetre, or powers of ten where that is long.
fn millimetres(mm: f64) -> String {
    if mm < 1e7 { format!("{mm:.1}") } else { format!("{mm:.3e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;

    #[test]
    fn a_size_is_known_without_voxelising() {
        let sheet = Shape::sheet([0.0; 3], [600.0, 0.0, 0.0], [0.0, 0.0, 600.0]).model();
        let placement = Placement::new(&sheet, Scale::Native).unwrap();
        let extent = placement.extent_mm();
        assert!((extent[0] - 600.0).abs() < 1e-9 && extent[1] == 0.0 && (extent[2] - 600.0).abs() < 1e-9);
        assert_eq!(placement.size_voxels(Pitch::new([0.1, 0.2, 0.5]).unwrap()), [6000, 1, 1200]);
        let wide = Placement::new(&sheet, Scale::WidthMm(30.0)).unwrap();
        assert!((wide.extent_mm()[2] - 30.0).abs() < 1e-9);
        assert!(wide.frame(&sheet, Pitch::j750(), 1).is_ok());
    }

    #[test]
    fn flat_models_are_told_that_they_are_flat() {
        // Flat but for the rounding of a rotation.
        for noise in [0.0, 1e-7, 5e-7] {
            let sheet = Shape::sheet([0.0; 3], [1.0, 0.0, noise], [0.0, 1.0, 0.0]).model();
            let error = Placement::new(&sheet, Scale::HeightMm(20.0)).unwrap_err().to_string();
            assert!(error.contains("flat") && error.contains("give a width"), "{error}");
            assert!(Placement::new(&sheet, Scale::WidthMm(20.0)).is_ok());
            let upright = sheet.vertices().iter().map(|v| {
                let [x, y, z] = v.position_m;
                crate::Vertex { position_m: [z, x, y], ..*v }
            });
            let upright = Model::new(
                "upright",
                upright.collect(),
                sheet.triangles().to_vec(),
                sheet.materials().to_vec(),
                vec![],
            )
            .unwrap();
            let error = Placement::new(&upright, Scale::WidthMm(20.0)).unwrap_err().to_string();
            assert!(error.contains("flat") && error.contains("give a height"), "{error}");
        }
        // Thin is not flat.
        let foil = Shape::cuboid([0.0; 3], [200.0, 200.0, 0.01]).model();
        assert!(Placement::new(&foil, Scale::HeightMm(0.02)).is_ok());
    }

    #[test]
    fn sizes_past_every_bound_are_refused() {
        let cube = Shape::cuboid([0.0; 3], [1.0; 3]).model();
        for height in [1e5, 1e12, 1e300] {
            let placement = Placement::new(&cube, Scale::HeightMm(height)).unwrap();
            let error = placement.frame(&cube, Pitch::j750(), 1).unwrap_err();
            assert!(
                matches!(error, MeshError::Unsupported { .. }) && error.to_string().len() < 300,
                "{error}"
            );
        }
    }
}
