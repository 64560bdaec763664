//! Voxel edge lengths and the placement of a grid in space.

use crate::VoxelError;

/// Edge lengths `[x, y, z]` of a voxel in millimetres, each finite and within 1e-6..=1e3.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Pitch([f64; 3]);

impl Pitch {
    /// Checks and wraps edge lengths in millimetres.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when an edge is not finite or outside 1e-6..=1e3 mm.
    pub fn new(mm: [f64; 3]) -> Result<Self, VoxelError> {
        for (axis, edge) in ["x", "y", "z"].iter().zip(mm) {
            if !(1e-6..=1e3).contains(&edge) {
                return Err(VoxelError::invalid(
                    format!("pitch {axis}"),
                    format!("{edge} mm; an edge must lie within 1e-6 to 1e3 mm"),
                ));
            }
        }
        Ok(Self(mm))
    }

    /// From dots per inch along `[x, y, z]`.
    ///
    /// # Errors
    /// As [`Pitch::new`], for the edge 25.4 / dpi.
    pub fn from_dpi(dpi: [f64; 3]) -> Result<Self, VoxelError> {
        Self::new(dpi.map(|d| 25.4 / d))
    }

    /// The paper's printer (section 4.2): 600 x 300 x 940 DPI, about 42.3 x 84.7 x 27.0 µm.
    pub fn j750() -> Self {
        Self([25.4 / 600.0, 25.4 / 300.0, 25.4 / 940.0])
    }

    /// The edges `[x, y, z]` in millimetres.
    pub fn mm(self) -> [f64; 3] {
        self.0
    }

    /// Volume of one voxel in mm³.
    pub fn volume_mm3(self) -> f64 {
        self.0[0] * self.0[1] * self.0[2]
    }

    /// The longest edge in millimetres.
    pub fn max_mm(self) -> f64 {
        self.0[0].max(self.0[1]).max(self.0[2])
    }

    /// The shortest edge in millimetres.
    pub fn min_mm(self) -> f64 {
        self.0[0].min(self.0[1]).min(self.0[2])
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Pitch {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mm = <[f64; 3]>::deserialize(deserializer)?;
        Pitch::new(mm).map_err(serde::de::Error::custom)
    }
}

/// Where a grid lies: the lower corner of voxel (0, 0, 0) in millimetres, the pitch, and the
/// number of voxels along `[x, y, z]`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Frame {
    origin_mm: [f64; 3],
    pitch: Pitch,
    size: [u32; 3],
}

impl Frame {
    /// Most voxels along one axis.
    pub const MAX_EDGE: u32 = 1 << 20;
    /// Most voxels in a frame.
    pub const MAX_VOXELS: u64 = 1 << 40;

    /// Checks and builds a frame.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] for a non-finite origin or an empty axis,
    /// [`VoxelError::Unsupported`] past [`Frame::MAX_EDGE`] or [`Frame::MAX_VOXELS`].
    pub fn new(origin_mm: [f64; 3], pitch: Pitch, size: [u32; 3]) -> Result<Self, VoxelError> {
        if origin_mm.iter().any(|o| !o.is_finite()) {
            return Err(VoxelError::invalid("frame origin", format!("{origin_mm:?} mm is not finite")));
        }
        if size.contains(&0) {
            return Err(VoxelError::invalid("frame size", format!("{size:?} has an empty axis")));
        }
        let voxels: u128 = size.iter().map(|&s| u128::from(s)).product();
        if size.iter().any(|&s| s > Self::MAX_EDGE) || voxels > u128::from(Self::MAX_VOXELS) {
            return Err(VoxelError::unsupported(
                "frame size",
                format!(
                    "{size:?} passes {} voxels an edge or {} in all; use a smaller object or a coarser pitch",
                    Self::MAX_EDGE,
                    Self::MAX_VOXELS
                ),
            ));
        }
        Ok(Self { origin_mm, pitch, size })
    }

    /// Lower corner of voxel (0, 0, 0) in millimetres.
    pub fn origin_mm(&self) -> [f64; 3] {
        self.origin_mm
    }

    /// Voxel edges.
    pub fn pitch(&self) -> Pitch {
        self.pitch
    }

    /// Voxels along `[x, y, z]`.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// Number of voxels.
    pub fn voxels(&self) -> u64 {
        self.size.iter().map(|&s| u64::from(s)).product()
    }

    /// Centre of a voxel in millimetres; indices outside the frame are extrapolated.
    pub fn centre_mm(&self, voxel: [i64; 3]) -> [f64; 3] {
        let mm = self.pitch.mm();
        std::array::from_fn(|a| self.origin_mm[a] + (voxel[a] as f64 + 0.5) * mm[a])
    }

    /// The voxel that holds a point in millimetres, which may lie outside the frame.
    pub fn voxel_at(&self, point_mm: [f64; 3]) -> [i64; 3] {
        let mm = self.pitch.mm();
        std::array::from_fn(|a| ((point_mm[a] - self.origin_mm[a]) / mm[a]).floor() as i64)
    }

    /// The voxel as unsigned indices when it lies within the frame.
    pub fn checked(&self, voxel: [i64; 3]) -> Option<[u32; 3]> {
        let inside = (0..3).all(|a| voxel[a] >= 0 && voxel[a] < i64::from(self.size[a]));
        inside.then(|| voxel.map(|v| v as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centre_and_voxel_at_invert_each_other() {
        let frame = Frame::new([-3.0, 2.0, 0.5], Pitch::j750(), [70, 40, 90]).unwrap();
        for voxel in [[0, 0, 0], [69, 39, 89], [-4, 50, 7]] {
            assert_eq!(frame.voxel_at(frame.centre_mm(voxel)), voxel);
        }
        assert_eq!(frame.checked([69, 39, 89]), Some([69, 39, 89]));
        assert_eq!(frame.checked([70, 0, 0]), None);
        assert_eq!(frame.checked([0, -1, 0]), None);
    }

    #[test]
    fn refuses_what_is_out_of_range() {
        assert!(Pitch::new([0.1, f64::NAN, 0.1]).is_err());
        assert!(Pitch::from_dpi([600.0, 0.0, 940.0]).is_err());
        assert!(Frame::new([0.0; 3], Pitch::j750(), [1, 0, 1]).is_err());
        assert!(matches!(
            Frame::new([0.0; 3], Pitch::j750(), [1 << 20, 1 << 20, 2]),
            Err(VoxelError::Unsupported { .. })
        ));
    }
}
