//! The colour each surface voxel should have.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Control, Surface};
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::geometry::{Bounds, Vec3, area_vector, dot, length, nearest_on_triangle, scale};
use crate::thickness::patch_area_mm2;
use crate::voxelise::{Placement, topology};
use crate::{MeshError, Model};

/// Voxels that one task handles.
const CHUNK: usize = 4096;
/// Cosine between voxel and triangle normal from which a triangle is on the voxel's side.
const SAME_SIDE: f64 = 0.1;

/// Linear RGB of every surface voxel, in the surface's order: the texture at the nearest point of
/// the mesh, averaged over the patch of surface that the voxel shows.
///
/// Among mesh points at most a voxel's diagonal farther than the nearest, one whose triangle faces
/// the way the voxel's normal does is preferred, which gives each side of a thin sheet its own
/// colour. Ties go to the lower triangle index. The result does not depend on the number of
/// threads.
///
/// # Errors
/// [`MeshError::Cancelled`].
pub fn surface_colors(
    model: &Model,
    placement: &Placement,
    surface: &Surface,
    control: &Control,
) -> Result<Vec<[f32; 3]>, MeshError> {
    let nearest = NearestTriangle::build(model, placement);
    let pitch = surface.frame().pitch();
    let diagonal = length(pitch.mm());
    let done = AtomicU64::new(0);
    let mut colors = vec![[0f32; 3]; surface.len()];
    let chunks = colors.par_chunks_mut(CHUNK).zip(surface.voxels().par_chunks(CHUNK));
    chunks.zip(surface.normals().par_chunks(CHUNK)).try_for_each(|((out, voxels), normals)| {
        control.check()?;
        for ((color, voxel), normal) in out.iter_mut().zip(voxels).zip(normals) {
            let p = surface.frame().centre_mm(voxel.map(i64::from));
            let (triangle, barycentric) = nearest.find(p, normal.map(f64::from), diagonal);
            let footprint_m = patch_area_mm2(pitch, *normal).sqrt() / placement.mm_per_m();
            *color = model.color_at(triangle, barycentric, footprint_m);
        }
        control.advance(&done, voxels.len() as u64, surface.len() as u64);
        Ok::<(), MeshError>(())
    })?;
    Ok(colors)
}

/// Nearest-point queries on a model's triangles in print space.
struct NearestTriangle {
    bvh: Bvh,
    corners: Vec<[Vec3; 3]>,
    /// Unit normals with orientation put right; zero for triangles without area.
    normals: Vec<Vec3>,
}

/// The best triangle so far: squared distance, index, barycentric weights.
type Hit = (f64, u32, [f64; 3]);

impl NearestTriangle {
    fn build(model: &Model, placement: &Placement) -> Self {
        let corners: Vec<[Vec3; 3]> = (0..model.triangles().len() as u32)
            .map(|t| model.corners_m(t).map(|p| placement.to_mm(p)))
            .collect();
        let mut normals: Vec<Vec3> = corners
            .iter()
            .map(|c| {
                let n = area_vector(*c);
                let l = length(n);
                if l > 0.0 { scale(n, 1.0 / l) } else { [0.0; 3] }
            })
            .collect();
        let topology = topology(model, placement);
        for (&source, _) in topology.source.iter().zip(&topology.reversed).filter(|(_, r)| **r) {
            normals[source as usize] = scale(normals[source as usize], -1.0);
        }
        let boxes: Vec<Bounds> = corners.iter().map(|c| Bounds::of(*c)).collect();
        Self { bvh: Bvh::build(&boxes), corners, normals }
    }

    /// The triangle nearest to `p`, preferring one that faces along `normal` among those at most
    /// `slack` farther than the nearest of all.
    fn find(&self, p: Vec3, normal: Vec3, slack: f64) -> (u32, [f64; 3]) {
        let any = self.nearest(p, f64::INFINITY, |_| true);
        let faces = |t: u32| dot(self.normals[t as usize], normal) > SAME_SIDE;
        let (d2, triangle, weights) = any;
        if faces(triangle) {
            return (triangle, weights);
        }
        let (found, facing, facing_weights) = self.nearest(p, (d2.sqrt() + slack).powi(2), faces);
        if found.is_finite() { (facing, facing_weights) } else { (triangle, weights) }
    }

    /// The nearest triangle within `radius2` that `accept` takes; an infinite distance when none is.
    fn nearest(&self, p: Vec3, radius2: f64, accept: impl Fn(u32) -> bool) -> Hit {
        let mut hit = (f64::INFINITY, 0, [1.0, 0.0, 0.0]);
        self.bvh.nearest(p, radius2, |t, best| {
            if accept(t) {
                let (weights, d2) = nearest_on_triangle(p, self.corners[t as usize]);
                if d2 <= best && (d2, t) < (hit.0, hit.1) {
                    hit = (d2, t, weights);
                    return d2;
                }
            }
            best
        });
        hit
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::Shape;
    use crate::voxelise::{VoxeliseOptions, Voxelised, voxelise};
    use pellucid_voxel::SurfaceOptions;
    use proptest::prelude::*;

    const RED: [f32; 3] = [0.8, 0.1, 0.05];
    const BLUE: [f32; 3] = [0.02, 0.2, 0.7];

    fn prepare(model: &Model) -> (Voxelised, Surface) {
        let control = Control::none();
        let v = voxelise(model, &VoxeliseOptions::default(), &control).unwrap();
        let surface = Surface::extract(&v.grid, &SurfaceOptions::default(), &control).unwrap();
        (v, surface)
    }

    fn colors(model: &Model) -> (Surface, Vec<[f32; 3]>) {
        let (v, surface) = prepare(model);
        let colors = surface_colors(model, &v.placement, &surface, &Control::none()).unwrap();
        assert_eq!(colors.len(), surface.len());
        (surface, colors)
    }

    #[test]
    fn each_side_of_a_two_coloured_cube_has_its_colour() {
        let cube = Shape::cuboid([0.0; 3], [3.0; 3]);
        let corners = cube.corners();
        // The two faces along x are red, the others blue.
        let model = cube.colored(|i| if area_vector(corners[i])[0].abs() > 1.0 { RED } else { BLUE });
        let (surface, colors) = colors(&model);
        let mut checked = [0, 0];
        for (i, color) in colors.iter().enumerate() {
            let p = surface.position_mm(i as u32);
            let from_face: Vec3 = p.map(|c| c.min(3.0 - c));
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| from_face[a].total_cmp(&from_face[b]));
            // On an edge of the cube either colour is right.
            if from_face[order[1]] > 0.1 {
                let expected = if order[0] == 0 { RED } else { BLUE };
                assert_eq!(*color, expected, "at {p:?}");
                checked[usize::from(order[0] == 0)] += 1;
            }
        }
        assert!(checked.iter().all(|&n| n > 1000), "{checked:?}");
    }

    #[test]
    fn each_side_of_a_thin_plate_has_its_colour() {
        for (axis, thickness) in [(0, 0.5), (1, 0.5), (2, 0.5), (2, 0.1), (2, 0.06), (0, 0.09)] {
            let mut high = [3.0; 3];
            high[axis] = thickness;
            let plate = Shape::cuboid([0.0; 3], high);
            let corners = plate.corners();
            let model = plate.colored(|i| if area_vector(corners[i])[axis] > 0.0 { RED } else { BLUE });
            let (surface, colors) = colors(&model);
            let mut checked = 0;
            for (i, color) in colors.iter().enumerate() {
                let p = surface.position_mm(i as u32);
                if (0..3).any(|a| a != axis && p[a].min(3.0 - p[a]) < 0.3) {
                    continue;
                }
                let expected = if p[axis] > 0.5 * thickness { RED } else { BLUE };
                assert_eq!(*color, expected, "axis {axis}, {thickness} mm, at {p:?}");
                checked += 1;
            }
            assert!(checked > 1000, "{checked}");
        }
    }

    #[test]
    fn the_normal_decides_where_the_wrong_side_is_nearer() {
        // Below the middle of a plate of two colours, but facing up.
        let plate = Shape::cuboid([0.0; 3], [3.0, 3.0, 0.05]);
        let corners = plate.corners();
        let model = plate.colored(|i| if area_vector(corners[i])[2] > 0.0 { RED } else { BLUE });
        let (v, _) = prepare(&model);
        let voxel = v.grid.frame().voxel_at([1.5, 1.5, 0.01]).map(|c| c as u32);
        for (normal, expected) in [([0.0, 0.0, 1.0], RED), ([0.0, 0.0, -1.0], BLUE)] {
            let surface = Surface::from_parts(*v.grid.frame(), vec![voxel], vec![normal]).unwrap();
            let colors = surface_colors(&model, &v.placement, &surface, &Control::none()).unwrap();
            assert_eq!(colors, [expected]);
        }
    }

    #[test]
    fn a_shell_that_faces_inwards_is_coloured_all_the_same() {
        let ball = Shape::sphere([0.0; 3], 1.0, 4);
        let middle = |s: &Shape, i: usize| crate::geometry::centroid(s.corners()[i])[2];
        let paint = |s: &Shape| {
            let s = s.clone();
            let z: Vec<f64> = (0..s.triangles.len()).map(|i| middle(&s, i)).collect();
            s.colored(|i| if z[i] > 0.0 { RED } else { BLUE })
        };
        let (_, a) = colors(&paint(&ball));
        let (_, b) = colors(&paint(&ball.clone().inverted()));
        assert_eq!(a, b);
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let ball = Shape::sphere([0.0; 3], 1.0, 4);
        let model = ball.colored(|i| [i as f32 / 6000.0, 0.5, 1.0 - i as f32 / 6000.0]);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| colors(&model).1)
        };
        assert_eq!(with(1), with(3));
    }

    proptest! {
        #[test]
        fn nearest_triangle_agrees_with_brute_force(
            p in prop::array::uniform3(-2.0..2.0f64),
            normal in prop::array::uniform3(-1.0..1.0f64),
            slack in 0.0..0.5f64,
        ) {
            let shape = Shape::torus(1.0, 0.4, 12, 8);
            let model = shape.model();
            let placement = Placement::new(&model, crate::Scale::Native).unwrap();
            let nearest = NearestTriangle::build(&model, &placement);
            let (found, weights) = nearest.find(p, normal, slack);

            let hits: Vec<([f64; 3], f64)> =
                nearest.corners.iter().map(|c| nearest_on_triangle(p, *c)).collect();
            let least = hits.iter().map(|h| h.1).fold(f64::INFINITY, f64::min);
            let lowest = (0..hits.len()).find(|&t| hits[t].1 == least).unwrap();
            let faces = |t: usize| dot(nearest.normals[t], normal) > SAME_SIDE;
            let expected = if faces(lowest) {
                lowest
            } else {
                (0..hits.len())
                    .filter(|&t| faces(t) && hits[t].1 <= (least.sqrt() + slack).powi(2))
                    .min_by(|&a, &b| hits[a].1.total_cmp(&hits[b].1).then(a.cmp(&b)))
                    .unwrap_or(lowest)
            };
            prop_assert_eq!((found as usize, weights), (expected, hits[expected].0));
        }
    }
}
