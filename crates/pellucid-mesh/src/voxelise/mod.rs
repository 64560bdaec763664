//! Voxelisation by generalised winding number.
//!
//! 1. Vertices are welded, shells found and oriented, and holes closed with caps ([`PlacedMesh`]).
//!    Bodies that touch keep a wall each; the back copy of a surface and a sheet within solid do not
//!    count.
//! 2. Mesh and caps together are closed, so crossings along x count their winding number exactly.
//! 3. Near holes the caps' own generalised winding number is taken off again, which leaves the
//!    mesh's (Jacobson et al. 2013; Barill et al. 2018 for its hierarchical evaluation). A voxel is
//!    solid where that is at least one half in size.
//! 4. Parts thinner than a voxel are kept one voxel thick.

#[cfg(test)]
mod body_tests;
mod cap_field;
mod fill;
mod scan;
#[cfg(test)]
mod tests;
mod thin;

use pellucid_voxel::{AIR, Control, LabelGrid, Pitch};

pub use crate::placement::{MAX_VOXELS, Placement, Scale};

use crate::geometry::Vec3;
use crate::mesh_report::Thin;
use crate::{MeshError, MeshReport, Model, PlacedMesh};
use cap_field::CapField;

/// How a model is voxelised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxeliseOptions {
    /// Voxel edges; the default is [`Pitch::j750`].
    pub pitch: Pitch,
    /// Print size; the default is the model's own.
    pub scale: Scale,
    /// The label of every solid voxel, not 0; the default is 5, white in the default materials.
    pub label: u8,
    /// Voxels of air on every side, at least 1; the default is 1.
    pub margin: u32,
}

impl Default for VoxeliseOptions {
    fn default() -> Self {
        Self { pitch: Pitch::j750(), scale: Scale::Native, label: 5, margin: 1 }
    }
}

/// A voxelised model.
#[derive(Clone, Debug)]
pub struct Voxelised {
    /// One label for every solid voxel, in print space (millimetres, z up).
    pub grid: LabelGrid,
    /// From the model's metres to the grid's millimetres.
    pub placement: Placement,
    /// What is wrong with the mesh, and what was put right.
    pub report: MeshReport,
}

/// Voxelises a model.
///
/// A voxel is solid when the mesh winds around its centre by at least one half in either direction:
/// holes are closed, shells that overlap, touch or lie in each other united, shells that face inwards
/// turned round, and shells that face inwards inside solid kept as cavities. Of a surface that is
/// there twice, facing both ways for viewers that show one side only, the front counts. A part thinner than a voxel is kept one voxel
/// thick where no centre falls into it. The result does not depend on the number of threads.
///
/// ```
/// use pellucid_mesh::{BaseColor, Model, Triangle, Vertex};
/// use pellucid_mesh::voxelise::{Scale, VoxeliseOptions, voxelise};
/// use pellucid_voxel::Control;
/// // A tetrahedron with three edges of 3 mm along the axes.
/// let corners = [[0.0; 3], [0.003, 0.0, 0.0], [0.0, 0.003, 0.0], [0.0, 0.0, 0.003]];
/// let vertices = corners.map(|position_m| Vertex { position_m, uv: [0.0; 2], color: [1.0; 4] });
/// let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
/// let triangles = faces.map(|vertices| Triangle { vertices, material: 0 });
/// let white = BaseColor { name: String::new(), factor: [1.0; 4], texture: None, double_sided: false };
/// let model = Model::new("tetrahedron", vertices.to_vec(), triangles.to_vec(), vec![white], vec![])?;
///
/// let options = VoxeliseOptions { scale: Scale::HeightMm(6.0), ..Default::default() };
/// let result = voxelise(&model, &options, &Control::none())?;
/// let volume = result.grid.histogram()[5] as f64 * options.pitch.volume_mm3();
/// assert!((volume - 36.0).abs() < 0.5);
/// assert!(result.report.closed);
/// # Ok::<(), pellucid_mesh::MeshError>(())
/// ```
///
/// # Errors
/// [`MeshError::Invalid`] for a bad height, label or margin or a model without extent,
/// [`MeshError::Unsupported`] past [`MAX_VOXELS`], [`MeshError::Cancelled`].
pub fn voxelise(model: &Model, options: &VoxeliseOptions, control: &Control) -> Result<Voxelised, MeshError> {
    check(model, options)?;
    let placement = Placement::new(model, options.scale)?;
    placement.frame(model, options.pitch, options.margin)?;
    PlacedMesh::at(model, placement).voxelise(options, control)
}

fn check(model: &Model, options: &VoxeliseOptions) -> Result<(), MeshError> {
    if options.label == AIR || options.margin == 0 {
        return Err(MeshError::invalid(
            model.name(),
            "voxelisation options",
            format!("label {} and margin {}", options.label, options.margin),
            "both must be at least 1",
        ));
    }
    Ok(())
}

impl PlacedMesh<'_> {
    /// Voxelises the model as [`voxelise`] does, at the size it was placed at: the options' scale
    /// is not looked at.
    ///
    /// # Errors
    /// As [`voxelise`], but for the height.
    pub fn voxelise(&self, options: &VoxeliseOptions, control: &Control) -> Result<Voxelised, MeshError> {
        let (model, placement, topology) = (self.model(), *self.placement(), self.topology());
        check(model, options)?;
        let frame = placement.frame(model, options.pitch, options.margin)?;
        control.check()?;

        let mm = options.pitch.mm();
        let shift = f64::from(options.margin) - 0.5;
        let to_voxels = |c: [Vec3; 3]| c.map(|p| std::array::from_fn(|a| p[a] / mm[a] + shift));
        let caps = topology.caps();
        let walls = topology.wall_triangles().map(|t| topology.corners(t));
        let closed: Vec<[Vec3; 3]> = walls.chain(caps.iter().copied()).map(to_voxels).collect();

        let stage = |from: u64, to: u64| {
            move |done: u64, total: u64| control.report(from + (to - from) * done / total.max(1), 100)
        };
        let (scanning, filling, thinning) = (stage(0, 20), stage(20, 80), stage(80, 100));
        let rows = fill::Rows::scan(&closed, &frame, &control.silent().with_progress(&scanning))?;
        drop(closed);
        let field = CapField::build(caps);
        let mut grid =
            fill::fill(frame, &rows, &field, options.label, &control.silent().with_progress(&filling))?;
        drop(rows);
        let corners: Vec<[Vec3; 3]> =
            topology.wall_triangles().map(|t| to_voxels(topology.corners(t))).collect();
        let (count, some) =
            thin::keep_thin(&mut grid, &corners, options.label, &control.silent().with_progress(&thinning))?;
        let triangles = model.triangles().len() as u64;
        let places_mm = some.into_iter().map(|v| grid.frame().centre_mm(v.map(i64::from))).collect();
        let thin = Thin { count, places_mm };
        let report = MeshReport::new(topology, placement.extent_mm(), triangles, thin);
        Ok(Voxelised { grid, placement, report })
    }
}
