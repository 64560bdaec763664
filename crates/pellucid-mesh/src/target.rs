//! The colour each surface voxel should have.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Control, Surface};
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::geometry::{Bounds, Vec3, area_vector, dot, length, nearest_on_triangle, scale};
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
    let mm = pitch.mm();
    let diagonal = length(mm);
    let done = AtomicU64::new(0);
    let mut colors = vec![[0f32; 3]; surface.len()];
    let chunks = colors.par_chunks_mut(CHUNK).zip(surface.voxels().par_chunks(CHUNK));
    chunks.zip(surface.normals().par_chunks(CHUNK)).try_for_each(|((out, voxels), normals)| {
        control.check()?;
        for ((color, voxel), normal) in out.iter_mut().zip(voxels).zip(normals) {
            let normal = normal.map(f64::from);
            let p = surface.frame().centre_mm(voxel.map(i64::from));
            let (triangle, barycentric) = nearest.find(p, normal, diagonal);
            // A surface of normal n meets one voxel per this area.
            let area = pitch.volume_mm3() / (0..3).map(|a| mm[a] * normal[a].abs()).sum::<f64>();
            let footprint_m = area.min(diagonal * diagonal).sqrt() / placement.mm_per_m();
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
