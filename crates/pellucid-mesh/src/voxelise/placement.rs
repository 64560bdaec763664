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
}

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
    /// # Errors
    /// [`MeshError::Invalid`] for a height that is not positive and finite, a model without
    /// extent, or a flat one (no extent along z) that is to get a height.
    pub fn new(model: &Model, scale: Scale) -> Result<Self, MeshError> {
        let [low, high] = model.bounds_m();
        let extent: [f64; 3] = std::array::from_fn(|a| high[a] - low[a]);
        let fail = |object: &str, reason: String, remedy: &str| {
            Err(MeshError::invalid(model.name(), object, reason, remedy))
        };
        if extent.iter().all(|&e| e <= 0.0) {
            return fail("model", "all its vertices are one point".into(), "export a mesh with an extent");
        }
        let mm_per_m = match scale {
            Scale::Native => 1000.0,
            Scale::HeightMm(h) if !(h.is_finite() && h > 0.0) => {
                return fail("height", format!("{h} mm"), "give a positive number of millimetres");
            }
            Scale::HeightMm(_) if extent[2] <= 0.0 => {
                return fail(
                    "height",
                    "the model is flat: it has no extent along z to scale".into(),
                    "print it at its own size or stand it up",
                );
            }
            Scale::HeightMm(h) => h / extent[2],
        };
        if !mm_per_m.is_finite() {
            return fail("model", format!("it is {:e} m high", extent[2]), "export it in metres");
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

    /// The frame that holds the model with `margin` voxels of air around it. The lower corner of
    /// the model's box lies on a voxel corner.
    ///
    /// # Errors
    /// [`MeshError::Unsupported`] past [`Frame::MAX_EDGE`] or [`MAX_VOXELS`].
    pub fn frame(&self, model: &Model, pitch: Pitch, margin: u32) -> Result<Frame, MeshError> {
        let mm = pitch.mm();
        // A box that passes a voxel face by rounding only does not take one more voxel.
        let size = std::array::from_fn(|a| {
            (self.extent_mm[a] / mm[a] - 1e-6).ceil().max(1.0) + 2.0 * f64::from(margin)
        });
        let voxels: f64 = size.iter().product();
        if size.iter().any(|&s: &f64| s > f64::from(Frame::MAX_EDGE)) || voxels > MAX_VOXELS as f64 {
            return Err(MeshError::unsupported(
                model.name(),
                "print size",
                format!(
                    "{:.1?} mm is {size:.0?} voxels, past {} an edge or {MAX_VOXELS} in all",
                    self.extent_mm,
                    Frame::MAX_EDGE
                ),
                "print it smaller, or at a coarser pitch",
            ));
        }
        let origin = mm.map(|p| -p * f64::from(margin));
        Ok(Frame::new(origin, pitch, size.map(|s| s as u32))?)
    }
}
