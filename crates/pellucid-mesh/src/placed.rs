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
        let positions: Vec<Vec3> = model.vertices().iter().map(|v| placement.to_mm(v.position_m)).collect();
        let triangles: Vec<[u32; 3]> = model.triangles().iter().map(|t| t.vertices).collect();
        let [low, high] = model.bounds_m().map(|p| placement.to_mm(p));
        let tolerance = WELD * length(sub(high, low));
        Self { model, placement, topology: Topology::build(&positions, &triangles, tolerance) }
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
