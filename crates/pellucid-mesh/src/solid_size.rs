//! How large the solid of a mesh is in voxels, told before it is voxelised.

use pellucid_voxel::Pitch;

use crate::geometry::{area_vector, cross, dot};
use crate::{Model, Placement};

/// How large a solid is, by its triangles alone: they are looked at one by one.
///
/// Surface and volume are those of closed shells that face outwards and do not cross; walls inside other shells count as
/// surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct SolidSize {
    /// Area of the surface in mm².
    pub area_mm2: f64,
    /// Volume in mm³.
    pub volume_mm3: f64,
    /// Voxels of the surface: a plane has as many as it covers along the axis on which it covers most.
    pub surface_voxels: f64,
}

impl SolidSize {
    /// Measures a placed model for voxels of a pitch.
    ///
    /// ```
    /// use pellucid_mesh::{ImportLimits, Placement, Scale, SolidSize};
    /// # let tetrahedron = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
    /// let model = pellucid_mesh::import_slice("tetrahedron.obj", tetrahedron, None, &ImportLimits::default())?;
    /// let placement = Placement::new(&model, Scale::HeightMm(10.0))?;
    /// let size = SolidSize::of(&model, &placement, pellucid_voxel::Pitch::new([0.1; 3])?);
    /// assert!((size.volume_mm3 - 1000.0 / 6.0).abs() < 1e-6);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn of(model: &Model, placement: &Placement, pitch: Pitch) -> Self {
        let face = faces(pitch);
        let mut size = Self { area_mm2: 0.0, volume_mm3: 0.0, surface_voxels: 0.0 };
        for triangle in 0..model.triangles().len() as u32 {
            let corners = model.corners_m(triangle).map(|corner| placement.to_mm(corner));
            let area = area_vector(corners);
            size.area_mm2 += dot(area, area).sqrt();
            size.volume_mm3 += dot(corners[0], cross(corners[1], corners[2])) / 6.0;
            size.surface_voxels += voxels_of(area, face);
        }
        size.volume_mm3 = size.volume_mm3.abs();
        size
    }

    /// Surface voxels of a placed model in `layers` of equal height, from the bottom up; they add up to those of
    /// [`SolidSize::of`]. Of each triangle they are spread evenly over its own height.
    pub fn surface_voxels_by_layer(
        model: &Model,
        placement: &Placement,
        pitch: Pitch,
        layers: usize,
    ) -> Vec<f64> {
        let face = faces(pitch);
        let mut found = vec![0.0; layers.max(1)];
        let scale = found.len() as f64 / placement.extent_mm()[2].max(f64::MIN_POSITIVE);
        for triangle in 0..model.triangles().len() as u32 {
            let corners = model.corners_m(triangle).map(|corner| placement.to_mm(corner));
            let heights = corners.map(|corner| (corner[2] * scale).clamp(0.0, found.len() as f64));
            let [low, high] = heights.iter().fold([f64::INFINITY, 0.0f64], |[l, h], &z| [l.min(z), h.max(z)]);
            let voxels = voxels_of(area_vector(corners), face);
            let (first, last) = (low as usize, (high as usize).min(found.len() - 1));
            for (layer, sum) in found.iter_mut().enumerate().take(last + 1).skip(first.min(last)) {
                let within = (high.min(layer as f64 + 1.0) - low.max(layer as f64)).max(0.0);
                *sum += if high > low { voxels * within / (high - low) } else { voxels };
            }
        }
        found
    }

    /// The same solid so many times as large.
    pub fn times(self, factor: f64) -> Self {
        Self {
            area_mm2: self.area_mm2 * factor.powi(2),
            volume_mm3: self.volume_mm3 * factor.powi(3),
            surface_voxels: self.surface_voxels * factor.powi(2),
        }
    }
}

/// Areas in mm² of a voxel's faces across each axis.
fn faces(pitch: Pitch) -> [f64; 3] {
    let mm = pitch.mm();
    std::array::from_fn(|a| mm[(a + 1) % 3] * mm[(a + 2) % 3])
}

/// Surface voxels of a plane with an area vector.
fn voxels_of(area: [f64; 3], face: [f64; 3]) -> f64 {
    (0..3).map(|a| area[a].abs() / face[a]).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;
    use crate::{PlacedMesh, Scale, VoxeliseOptions};
    use pellucid_voxel::{Control, Surface, SurfaceOptions};

    /// Surface voxels that voxelisation finds, in parts of what was told.
    fn found(shape: &Shape) -> f64 {
        let model = shape.model();
        let options =
            VoxeliseOptions { pitch: Pitch::new([0.04, 0.08, 0.03]).unwrap(), ..VoxeliseOptions::default() };
        let mesh = PlacedMesh::new(&model, Scale::Native).unwrap();
        let grid = mesh.voxelise(&options, &Control::none()).unwrap().grid;
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        surface.len() as f64 / SolidSize::of(&model, mesh.placement(), options.pitch).surface_voxels
    }

    #[test]
    fn a_ball_and_a_block_have_as_many_surface_voxels_as_told() {
        let ball = found(&Shape::sphere([0.0; 3], 2.0, 4));
        assert!((ball - 1.0).abs() < 0.03, "{ball}");
        // Edges are counted twice.
        let block = found(&Shape::cuboid([0.0; 3], [4.0, 3.0, 5.0]));
        assert!((block - 1.0).abs() < 0.03, "{block}");
    }

    #[test]
    fn sizes_are_those_of_closed_forms() {
        let model = Shape::cuboid([-1.0; 3], [4.0, 3.0, 5.0]).model();
        let placement = Placement::new(&model, Scale::Native).unwrap();
        let size = SolidSize::of(&model, &placement, Pitch::new([0.04, 0.08, 0.03]).unwrap());
        assert!((size.volume_mm3 / 120.0 - 1.0).abs() < 1e-9, "{size:?}");
        assert!((size.area_mm2 / 148.0 - 1.0).abs() < 1e-9, "{size:?}");
        let faces = 2.0 * (20.0 / 0.0032 + 30.0 / 0.0012 + 24.0 / 0.0024);
        assert!((size.surface_voxels / faces - 1.0).abs() < 1e-9, "{size:?}");
        let layers = SolidSize::surface_voxels_by_layer(
            &model,
            &placement,
            Pitch::new([0.04, 0.08, 0.03]).unwrap(),
            10,
        );
        // Lids lie in the first and the last, and sides are spread evenly.
        let (lid, side) = (20.0 / 0.0032, 0.2 * (30.0 / 0.0012 + 24.0 / 0.0024));
        for (layer, &voxels) in layers.iter().enumerate() {
            let own = if layer % 9 == 0 { side + lid } else { side };
            assert!((voxels / own - 1.0).abs() < 1e-9, "{layers:?}");
        }
        let twice = size.times(2.0);
        let larger = Placement::new(&model, Scale::WidthMm(10.0)).unwrap();
        let own = SolidSize::of(&model, &larger, Pitch::new([0.04, 0.08, 0.03]).unwrap());
        assert!((twice.volume_mm3 / own.volume_mm3 - 1.0).abs() < 1e-9, "{twice:?} {own:?}");
        assert!((twice.surface_voxels / own.surface_voxels - 1.0).abs() < 1e-9);
    }
}
