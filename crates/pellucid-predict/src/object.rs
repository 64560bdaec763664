//! A print's shape and materials: what stays while labels change.

use pellucid_core::random::mix;
use pellucid_voxel::{AIR, Frame, LabelGrid, MaterialTable, Surface};

use crate::PredictError;

/// One object under prediction: its surface voxels with their outward normals, the coefficients of the labels, and the
/// optical boundary. Shared by `Arc`; labels are not part of it.
#[derive(Clone, Debug)]
pub struct Object {
    surface: Surface,
    materials: MaterialTable,
    refractive_index: f64,
    id: ObjectId,
}

/// Tells objects apart: a digest of frame, surface voxels, normals, materials and boundary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ObjectId(pub u64);

impl Object {
    /// Checks and puts together.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] for a refractive index outside 1..=4 or a surface without voxels.
    pub fn new(
        surface: Surface,
        materials: MaterialTable,
        refractive_index: f64,
    ) -> Result<Self, PredictError> {
        if !(1.0..=4.0).contains(&refractive_index) {
            return Err(PredictError::invalid(
                "refractive index",
                format!("{refractive_index}; 1 (index-matched) to 4 are possible"),
            ));
        }
        if surface.is_empty() {
            return Err(PredictError::invalid("surface", "has no voxels; nothing is solid"));
        }
        let id = ObjectId(digest(&surface, &materials, refractive_index));
        Ok(Self { surface, materials, refractive_index, id })
    }

    /// Surface voxels and normals; a point is a position in this list.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The coefficients of the labels.
    pub fn materials(&self) -> &MaterialTable {
        &self.materials
    }

    /// Channels of a radiance.
    pub fn channels(&self) -> usize {
        self.materials.channels()
    }

    /// Refractive index of the boundary; 1 is index-matched.
    pub fn refractive_index(&self) -> f64 {
        self.refractive_index
    }

    /// Where the voxels lie.
    pub fn frame(&self) -> &Frame {
        self.surface.frame()
    }

    /// Which object this is.
    pub fn id(&self) -> ObjectId {
        self.id
    }

    /// Every surface point, in order.
    pub fn points(&self) -> Vec<u32> {
        (0..self.surface.len() as u32).collect()
    }

    /// Tells whether labels lie in this object's frame.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] otherwise.
    pub fn check_labels(&self, labels: &LabelGrid) -> Result<(), PredictError> {
        if labels.frame() == self.frame() {
            return Ok(());
        }
        Err(PredictError::invalid("labels", "lie in another frame than the object's surface"))
    }

    /// Tells whether every surface voxel is solid in labels of this object's frame.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] naming a voxel that is air.
    pub fn check_solid(&self, labels: &LabelGrid) -> Result<(), PredictError> {
        match self.surface.voxels().iter().find(|v| labels.at(v.map(i64::from)) == AIR) {
            Some(v) => Err(PredictError::invalid(
                "labels",
                format!("surface voxel {v:?} is air; bind an object with the surface of these labels"),
            )),
            None => Ok(()),
        }
    }

    /// Tells whether points and an output `[point][channel]` fit the object.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] naming the length or the point that does not.
    pub fn check_points(&self, points: &[u32], out: usize) -> Result<(), PredictError> {
        if out != points.len() * self.channels() {
            return Err(PredictError::invalid(
                "output",
                format!("{out} values for {} points in {} channels", points.len(), self.channels()),
            ));
        }
        match points.iter().find(|&&p| p as usize >= self.surface.len()) {
            Some(p) => Err(PredictError::invalid(
                "points",
                format!("{p}; the surface has {} voxels", self.surface.len()),
            )),
            None => Ok(()),
        }
    }
}

#[cfg(feature = "rpnn")]
impl Object {
    /// Tells whether points and derivatives by their radiance, `[point][channel]`, fit the object.
    pub(crate) fn check_derivatives(&self, points: &[u32], d_radiance: &[f32]) -> Result<(), PredictError> {
        let channels = self.channels();
        if d_radiance.len() != points.len() * channels {
            return Err(PredictError::invalid(
                "derivatives by radiance",
                format!("{} values for {} points in {channels} channels", d_radiance.len(), points.len()),
            ));
        }
        self.check_points(points, d_radiance.len())
    }
}

fn digest(surface: &Surface, materials: &MaterialTable, refractive_index: f64) -> u64 {
    let mut state = mix(surface.len() as u64 + 1);
    let mut add = |value: u64| state = mix(state ^ value.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let frame = surface.frame();
    frame.pitch().mm().iter().chain(&frame.origin_mm()).for_each(|v| add(v.to_bits()));
    frame.size().iter().for_each(|&s| add(u64::from(s)));
    for (voxel, normal) in surface.voxels().iter().zip(surface.normals()) {
        add(u64::from(voxel[0]) | u64::from(voxel[1]) << 20 | u64::from(voxel[2]) << 40);
        normal.iter().for_each(|n| add(u64::from(n.to_bits())));
    }
    for material in materials.materials() {
        material.name.bytes().for_each(|b| add(u64::from(b)));
        let coefficients = material.sigma_s.iter().chain(&material.sigma_a).chain(material.g.values());
        coefficients.for_each(|v| add(u64::from(v.to_bits())));
    }
    add(refractive_index.to_bits());
    state
}
