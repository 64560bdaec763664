//! What is wrong with a mesh, and what voxelisation put right.

use crate::mesh_places::MeshPlaces;
use crate::shell::Shell;
use crate::topology::Topology;

/// Voxels that were kept for what is thinner.
pub(crate) struct Thin {
    pub count: u64,
    /// Where some of them are.
    pub places_mm: Vec<[f64; 3]>,
}

/// Findings about a model's mesh at its print size, after vertices that meet in position were
/// joined.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MeshReport {
    /// Distinct vertex positions.
    pub vertices: u64,
    /// Triangles of the model.
    pub triangles: u64,
    /// Edges of the triangles that were kept.
    pub edges: u64,
    /// Every edge is run as often one way as the other once orientation is put right: the mesh
    /// has no holes.
    pub closed: bool,
    /// Edges with one triangle only.
    pub boundary_edges: u64,
    /// Connected boundary curves; each was closed.
    pub holes: u64,
    /// Edges with three or more triangles.
    pub non_manifold_edges: u64,
    /// Edges that their two triangles run the same way in the model.
    pub inconsistent_edges: u64,
    /// Triangles whose orientation was reversed, alone or with their shell.
    pub reversed_triangles: u64,
    /// Parts that bound solid, bodies and cavities; bodies that share a wall are one each.
    pub shells: u64,
    /// Shells that faced inwards and were not cavities; they were turned round.
    pub flipped_shells: u64,
    /// Shells that face inwards inside solid: hollows, kept.
    pub cavities: u64,
    /// Triangles without area.
    pub degenerate_triangles: u64,
    /// Triangles left out because the same surface is there already, facing the same way or, as a
    /// back for viewers that show one side only, the other way.
    pub duplicate_triangles: u64,
    /// Extent `[x, y, z]` in millimetres.
    pub extent_mm: [f64; 3],
    /// Enclosed volume in mm³ with holes closed; where shells overlap it counts twice.
    pub volume_mm3: f64,
    /// Voxels kept for parts too thin to hold a voxel centre.
    pub thin_voxels: u64,
    /// Where some of these are.
    #[cfg_attr(feature = "serde", serde(default))]
    pub places: MeshPlaces,
}

impl MeshReport {
    pub(crate) fn new(topology: &Topology, extent_mm: [f64; 3], triangles: u64, thin: Thin) -> Self {
        let copies = topology.shells.iter().filter(|s| s.is_back());
        let copied: usize = copies.map(|s| s.triangles.len()).sum();
        let mut used: Vec<u32> = topology.triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        Self {
            vertices: used.len() as u64,
            triangles,
            edges: topology.edges,
            closed: topology.walls().all(|s| s.caps.is_empty()),
            boundary_edges: topology.boundary_edges,
            holes: topology.walls().map(|s| s.holes).sum(),
            non_manifold_edges: topology.non_manifold_edges,
            inconsistent_edges: topology.inconsistent_edges,
            reversed_triangles: topology.reversed.iter().filter(|r| **r).count() as u64,
            shells: topology.walls().count() as u64,
            flipped_shells: topology.walls().filter(|s| s.flipped).count() as u64,
            cavities: topology.walls().filter(|s| s.enclosed() < 0.0).count() as u64,
            degenerate_triangles: topology.degenerate,
            duplicate_triangles: topology.duplicate + copied as u64,
            extent_mm,
            volume_mm3: topology.walls().map(Shell::enclosed).sum(),
            thin_voxels: thin.count,
            places: MeshPlaces::of(topology, thin.places_mm),
        }
    }

    /// What a user should know before the print, in sentences.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if !self.closed {
            warnings.push(format!("the mesh is open; {} holes were closed", self.holes));
        }
        if self.flipped_shells > 0 {
            warnings.push(format!("{} shells faced inwards and were turned round", self.flipped_shells));
        }
        if self.thin_voxels > 0 {
            warnings.push("parts thinner than a voxel were kept one voxel thick".to_owned());
        }
        warnings
    }
}
