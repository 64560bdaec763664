//! Where the findings about a mesh are.

use crate::geometry::{Vec3, add, centroid, scale};
use crate::shell::Shell;
use crate::topology::Topology;

/// Most places that are kept of a kind of finding; a broken mesh has thousands.
pub(crate) const MOST_PLACES: usize = 8;

/// Places of findings in print millimetres, up to eight of each kind, for whoever wants to look at them.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct MeshPlaces {
    /// Middles of holes that were closed.
    pub holes: Vec<[f64; 3]>,
    /// Middles of edges with three or more triangles.
    pub non_manifold_edges: Vec<[f64; 3]>,
    /// Middles of edges that their two triangles run the same way in the model.
    pub inconsistent_edges: Vec<[f64; 3]>,
    /// A triangle of each shell that was turned round.
    pub flipped_shells: Vec<[f64; 3]>,
    /// A triangle of each hollow.
    pub cavities: Vec<[f64; 3]>,
    /// Triangles that were left out: without area, doubled, or backs of others.
    pub left_out_triangles: Vec<[f64; 3]>,
    /// Voxels kept for parts too thin to hold a voxel centre.
    pub thin_voxels: Vec<[f64; 3]>,
}

impl MeshPlaces {
    pub(crate) fn of(topology: &Topology, thin_voxels: Vec<Vec3>) -> Self {
        let of_shell = |shell: &Shell| shell.triangles.first().map(|&t| centroid(topology.corners(t)));
        let of_shells = |wanted: &dyn Fn(&&Shell) -> bool| -> Vec<Vec3> {
            topology.walls().filter(wanted).filter_map(of_shell).take(MOST_PLACES).collect()
        };
        let copies = topology.shells.iter().filter(|s| s.is_back()).filter_map(of_shell);
        let left_out = topology.left_out.iter().copied().chain(copies);
        Self {
            holes: holes(topology),
            non_manifold_edges: topology.non_manifold_at.clone(),
            inconsistent_edges: topology.inconsistent_at.clone(),
            flipped_shells: of_shells(&|s| s.flipped),
            cavities: of_shells(&|s| s.enclosed() < 0.0),
            left_out_triangles: left_out.take(MOST_PLACES).collect(),
            thin_voxels,
        }
    }
}

/// The apexes over the holes: caps of one hole share theirs.
fn holes(topology: &Topology) -> Vec<Vec3> {
    let mut found: Vec<Vec3> = Vec::new();
    for [.., apex] in topology.walls().flat_map(|s| &s.caps) {
        if found.len() == MOST_PLACES {
            break;
        }
        if !found.contains(apex) {
            found.push(*apex);
        }
    }
    found
}

/// The middle of an edge.
pub(crate) fn middle(a: Vec3, b: Vec3) -> Vec3 {
    scale(add(a, b), 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;
    use crate::voxelise::{VoxeliseOptions, Voxelised, voxelise};
    use pellucid_voxel::{AIR, Control, Pitch};

    fn run(shape: &Shape) -> Voxelised {
        let options = VoxeliseOptions { pitch: Pitch::new([0.1; 3]).unwrap(), ..VoxeliseOptions::default() };
        voxelise(&shape.model(), &options, &Control::none()).unwrap()
    }

    fn near(found: &[[f64; 3]], wanted: [f64; 3], within: f64) {
        let off = |p: &[f64; 3]| (0..3).map(|a| (p[a] - wanted[a]).powi(2)).sum::<f64>().sqrt();
        assert!(found.iter().all(|p| off(p) < within), "{found:?} is not at {wanted:?}");
    }

    #[test]
    fn a_sound_mesh_has_none() {
        assert_eq!(run(&Shape::cuboid([0.0; 3], [2.0; 3])).report.places, MeshPlaces::default());
    }

    #[test]
    fn holes_and_turned_shells_are_found_where_they_are() {
        let half = Shape::sphere([0.0; 3], 3.0, 4).keeping(|_, t| t.iter().all(|p| p[2] >= -1e-9));
        let places = run(&half).report.places;
        assert_eq!(places.holes.len(), 1);
        // The print's corner is its origin.
        near(&places.holes, [3.0, 3.0, 0.0], 0.2);

        let turned = Shape::cuboid([8.0, 0.0, 0.0], [9.0, 1.0, 1.0]).inverted();
        let hollow = Shape::cuboid([1.0; 3], [2.0; 3]).inverted();
        let v = run(&Shape::cuboid([0.0; 3], [3.0; 3]).and(&hollow).and(&turned));
        let places = &v.report.places;
        assert_eq!((places.flipped_shells.len(), places.cavities.len()), (1, 1));
        near(&places.flipped_shells, [8.5, 0.5, 0.5], 0.9);
        near(&places.cavities, [1.5; 3], 0.9);
    }

    #[test]
    fn doubled_triangles_and_shared_edges_are_found() {
        let cube = Shape::cuboid([0.0; 3], [1.0; 3]);
        let twice = cube.clone().and(&cube.clone().keeping(|i, _| i == 0));
        let places = run(&twice).report.places;
        assert_eq!(places.left_out_triangles.len(), 1);
        near(&places.left_out_triangles, [0.5; 3], 0.9);
        let touching = cube.and(&Shape::cuboid([1.0, 1.0, 0.0], [2.0, 2.0, 1.0]));
        let places = run(&touching).report.places;
        near(&places.non_manifold_edges, [1.0, 1.0, 0.5], 1e-6);
        assert_eq!(places.non_manifold_edges.len(), 1);
    }

    #[test]
    fn of_many_some_are_kept() {
        let v = run(&Shape::sheet([0.0; 3], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]));
        let places = &v.report.places;
        assert!(v.report.thin_voxels > 1_000 && places.thin_voxels.len() == MOST_PLACES);
        let frame = v.grid.frame();
        let solid = |p: &[f64; 3]| v.grid.at(frame.voxel_at(*p)) != AIR;
        assert!(places.thin_voxels.iter().all(solid), "{places:?}");
    }
}
