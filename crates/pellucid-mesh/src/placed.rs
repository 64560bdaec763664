//! A model in print space.

use crate::geometry::{Vec3, length, sub};
use crate::topology::Topology;
use crate::{MeshError, Model, Placement, Scale};

/// Open edges closer than this share of the model's diagonal are joined.
const WELD: f64 = 1e-6;

/// A model in print space with its mesh analysed (welded, oriented, capped): made once, used by
/// [`PlacedMesh::voxelise`] and [`PlacedMesh::surface_colors`].
pub struct PlacedMesh<'m> {
    model: &'m Model,
    placement: Placement,
    topology: Topology,
}

impl<'m> PlacedMesh<'m> {
    /// Places a model at a scale and analyses its mesh. [`Placement::new`] alone is cheap, for what
    /// only needs the size.
    ///
    /// # Errors
    /// As [`Placement::new`].
    pub fn new(model: &'m Model, scale: Scale) -> Result<Self, MeshError> {
        Ok(Self::at(model, Placement::new(model, scale)?))
    }

    /// Analyses a model's mesh at a placement of that model.
    pub fn at(model: &'m Model, placement: Placement) -> Self {
        Self { model, placement, topology: Self::topology_of(model, |p| placement.to_mm(p)) }
    }

    /// The welded, oriented and capped mesh of a model in a space of any scale.
    pub(crate) fn topology_of(model: &Model, to_space: impl Fn(Vec3) -> Vec3) -> Topology {
        let positions: Vec<Vec3> = model.vertices().iter().map(|v| to_space(v.position_m)).collect();
        let triangles: Vec<[u32; 3]> = model.triangles().iter().map(|t| t.vertices).collect();
        let [low, high] = model.bounds_m().map(to_space);
        Topology::build(&positions, &triangles, WELD * length(sub(high, low)))
    }

    /// The model.
    pub fn model(&self) -> &'m Model {
        self.model
    }

    /// From the model's metres to print millimetres.
    pub fn placement(&self) -> &Placement {
        &self.placement
    }

    pub(crate) fn topology(&self) -> &Topology {
        &self.topology
    }
}
