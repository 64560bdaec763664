//! The colour each surface voxel should have.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Control, Surface};
use rayon::prelude::*;

use crate::geometry::length;
use crate::nearest::NearestTriangle;
use crate::thickness::patch_area_mm2;
use crate::{MeshError, Model, PlacedMesh, Placement};

/// Voxels that one task handles.
pub(crate) const CHUNK: usize = 4096;

/// Linear RGB of every surface voxel, in the surface's order: the texture at the nearest point of
/// the mesh that shows, averaged over the patch of surface that the voxel shows.
///
/// Among mesh points at most a voxel's diagonal farther than the nearest, one whose triangle faces
/// the way the voxel's normal does is preferred, which gives each side of a thin sheet its own
/// colour. What lies in front of that point and faces the same way (cloth on a body, a decal in
/// front of a face) covers it, the outermost first, up to the next solid voxel. A sheet covers
/// from behind where its material is double-sided. Ties go to the lower triangle index. The result
/// does not depend on the number of threads.
///
/// # Errors
/// [`MeshError::Cancelled`].
pub fn surface_colors(
    model: &Model,
    placement: &Placement,
    surface: &Surface,
    control: &Control,
) -> Result<Vec<[f32; 3]>, MeshError> {
    PlacedMesh::at(model, *placement).surface_colors(surface, control)
}

impl PlacedMesh<'_> {
    /// The colours of [`surface_colors`], without analysing the mesh again.
    ///
    /// # Errors
    /// [`MeshError::Cancelled`].
    pub fn surface_colors(&self, surface: &Surface, control: &Control) -> Result<Vec<[f32; 3]>, MeshError> {
        let opaque = |_: u32, _: [f64; 3], _: f64| false;
        let color =
            |t: u32, weights: [f64; 3], footprint_m: f64| self.model().color_at(t, weights, footprint_m);
        self.looks(surface, opaque, color, control)
    }

    /// The colours of [`surface_colors`], and whether the mesh is see-through there ([`Model::is_clear_at`]). Decals and
    /// what covers others are looked through where they are see-through.
    ///
    /// # Errors
    /// [`MeshError::Cancelled`].
    pub fn surface_looks(
        &self,
        surface: &Surface,
        control: &Control,
    ) -> Result<Vec<([f32; 3], bool)>, MeshError> {
        let model = self.model();
        let clear = |t: u32, weights: [f64; 3], footprint_m: f64| model.is_clear_at(t, weights, footprint_m);
        let look = |t: u32, weights: [f64; 3], footprint_m: f64| {
            (model.color_at(t, weights, footprint_m), model.is_clear_at(t, weights, footprint_m))
        };
        self.looks(surface, clear, look, control)
    }

    /// What `look` says of the place on the mesh that each surface voxel shows: triangle, barycentric weights, and how
    /// wide a patch of the mesh that is in metres.
    pub(crate) fn looks<T: Copy + Default + Send>(
        &self,
        surface: &Surface,
        clear: impl Fn(u32, [f64; 3], f64) -> bool + Sync,
        look: impl Fn(u32, [f64; 3], f64) -> T + Sync,
        control: &Control,
    ) -> Result<Vec<T>, MeshError> {
        let nearest = NearestTriangle::build(self);
        let pitch = surface.frame().pitch();
        let diagonal = length(pitch.mm());
        let done = AtomicU64::new(0);
        let mut looks = vec![T::default(); surface.len()];
        let chunks = looks.par_chunks_mut(CHUNK).zip(surface.voxels().par_chunks(CHUNK));
        chunks.zip(surface.normals().par_chunks(CHUNK)).try_for_each(|((out, voxels), normals)| {
            control.check()?;
            for ((out, voxel), normal) in out.iter_mut().zip(voxels).zip(normals) {
                let p = surface.frame().centre_mm(voxel.map(i64::from));
                let footprint_m = patch_area_mm2(pitch, *normal).sqrt() / self.placement().mm_per_m();
                let clear = |t: u32, weights: [f64; 3]| clear(t, weights, footprint_m);
                let normal = normal.map(f64::from);
                let below = nearest.find(p, normal, diagonal, clear);
                let (triangle, barycentric) =
                    nearest.cover(below, p, normal, surface, clear).unwrap_or(below);
                *out = look(triangle, barycentric, footprint_m);
            }
            control.advance(&done, voxels.len() as u64, surface.len() as u64);
            Ok::<(), MeshError>(())
        })?;
        Ok(looks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Vec3, area_vector};
    use crate::shapes::Shape;
    use crate::voxelise::{VoxeliseOptions, Voxelised, voxelise};
    use pellucid_voxel::SurfaceOptions;

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

    /// Shapes with a colour each, one material.
    fn painted(parts: &[(Shape, [f32; 3])]) -> Model {
        let mut ends = Vec::new();
        let mut all = Shape::default();
        for (part, _) in parts {
            all = all.and(part);
            ends.push(all.triangles.len());
        }
        all.colored(|i| parts[ends.partition_point(|&end| end <= i)].1)
    }

    /// The same with double-sided materials.
    fn double_sided(model: &Model) -> Model {
        let mut materials = model.materials().to_vec();
        materials.iter_mut().for_each(|m| m.double_sided = true);
        let (vertices, triangles) = (model.vertices().to_vec(), model.triangles().to_vec());
        Model::new("shape", vertices, triangles, materials, vec![]).unwrap()
    }

    /// Shares of red and blue among all surface voxels.
    fn shares(model: &Model) -> [f64; 2] {
        let (_, colors) = colors(model);
        [RED, BLUE].map(|c| colors.iter().filter(|&&found| found == c).count() as f64 / colors.len() as f64)
    }

    fn turned(shape: Shape) -> Shape {
        let (c, s) = (0.7f64.cos(), 0.7f64.sin());
        shape
            .moved(|[x, y, z]| [x, c * y - s * z, s * y + c * z])
            .moved(|[x, y, z]| [c * x - s * y, s * x + c * y, z])
    }

    #[test]
    fn cloth_covers_a_body_at_any_gap() {
        for gap in [1e-3, 0.015, 0.06, 0.1, 0.25] {
            let body = Shape::sphere([0.0; 3], 1.0 - gap, 3);
            let cloth = Shape::sphere([0.0; 3], 1.0, 3);
            for parts in [
                [(cloth.clone(), RED), (body.clone(), BLUE)],
                [(body, BLUE), (cloth, RED)],
                [(Shape::cuboid([gap; 3], [2.0 - gap; 3]), BLUE), (Shape::cuboid([0.0; 3], [2.0; 3]), RED)],
                [
                    (turned(Shape::cuboid([0.0; 3], [2.0; 3])), RED),
                    (turned(Shape::cuboid([gap; 3], [2.0 - gap; 3])), BLUE),
                ],
            ] {
                assert_eq!(shares(&painted(&parts)), [1.0, 0.0], "gap {gap}");
            }
        }
    }

    #[test]
    fn layers_of_cloth_show_the_outermost() {
        let ball = |r: f64| Shape::sphere([0.0; 3], r, 3);
        let parts = [
            (ball(0.9), BLUE),
            (ball(1.0), RED),
            (ball(0.93), BLUE),
            (ball(0.97), BLUE),
            (ball(0.985), BLUE),
        ];
        assert_eq!(shares(&painted(&parts)), [1.0, 0.0]);
    }

    #[test]
    fn a_decal_in_front_of_a_face_covers_it() {
        let cube = Shape::cuboid([0.0; 3], [2.0; 3]);
        for (axis, high) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
            for gap in [0.0, 1e-3, 0.015, 0.04, 0.1] {
                let place = |u: f64, v: f64| {
                    let mut p = [0.0; 3];
                    p[axis] = if high { 2.0 + gap } else { -gap };
                    (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (u, v);
                    p
                };
                let corners = [place(0.4, 0.4), place(1.6, 0.4), place(1.6, 1.6), place(0.4, 1.6)];
                let mut decal = Shape { positions: corners.to_vec(), triangles: vec![[0, 1, 2], [0, 2, 3]] };
                if !high {
                    decal = decal.inverted();
                }
                for parts in
                    [[(cube.clone(), BLUE), (decal.clone(), RED)], [(decal, RED), (cube.clone(), BLUE)]]
                {
                    let (surface, colors) = colors(&painted(&parts));
                    for (i, color) in colors.iter().enumerate() {
                        let p = surface.position_mm(i as u32);
                        // The grid starts where the decal does.
                        let shift = if high { 0.0 } else { gap };
                        let depth = if high { 2.0 - p[axis] } else { p[axis] - shift };
                        let across = [p[(axis + 1) % 3], p[(axis + 2) % 3]].map(|c| (c - 1.0).abs());
                        let within = across[0].max(across[1]);
                        // Where the decal has no voxels of its own.
                        if gap <= 0.015 && depth < 0.09 && (within < 0.55 || (0.65..0.8).contains(&within)) {
                            let expected = if within < 0.6 { RED } else { BLUE };
                            assert_eq!(*color, expected, "axis {axis}, {high}, gap {gap}, at {p:?}");
                        }
                    }
                    let red = colors.iter().filter(|&&c| c == RED).count();
                    assert!(red > 200, "axis {axis}, gap {gap}: {red} red");
                }
            }
        }
    }

    #[test]
    fn a_decal_that_faces_back_shows_where_its_material_is_double_sided() {
        let cube = Shape::cuboid([0.0; 3], [2.0; 3]);
        let decal = Shape::sheet([0.0, 0.0, 2.015], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]).inverted();
        let model = painted(&[(cube, BLUE), (decal, RED)]);
        for (model, expected) in [(double_sided(&model), RED), (model, BLUE)] {
            let (surface, colors) = colors(&model);
            for (i, color) in colors.iter().enumerate() {
                let p = surface.position_mm(i as u32);
                if p[2] > 1.96 && p[0].min(p[1]) > 0.2 && p[0].max(p[1]) < 1.8 {
                    assert_eq!(*color, expected, "{p:?}");
                }
            }
        }
    }

    #[test]
    fn the_front_of_a_doubled_surface_shows_in_any_order() {
        let front = Shape::cuboid([0.0; 3], [2.0, 1.5, 2.0]);
        let mut other = front.clone();
        for [first, second] in other.triangles.as_chunks_mut::<2>().0 {
            let ([a, b, c], d) = (*first, second[2]);
            (*first, *second) = ([b, c, d], [b, d, a]);
        }
        for back in [front.clone().inverted(), other.inverted()] {
            for turn in [false, true] {
                let place = |s: &Shape| if turn { turned(s.clone()) } else { s.clone() };
                let (front, back) = ((place(&front), RED), (place(&back), BLUE));
                assert_eq!(shares(&painted(&[front.clone(), back.clone()])), [1.0, 0.0]);
                assert_eq!(shares(&painted(&[back.clone(), front.clone()])), [1.0, 0.0]);
                assert_eq!(shares(&double_sided(&painted(&[back, front]))), [1.0, 0.0]);
            }
        }
        // Each side of a doubled sheet has its own.
        let sheet = Shape::sheet([0.0; 3], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]);
        for parts in [
            [(sheet.clone(), RED), (sheet.clone().inverted(), BLUE)],
            [(sheet.clone().inverted(), BLUE), (sheet, RED)],
        ] {
            let model = painted(&parts);
            let (v, _) = prepare(&model);
            for (normal, expected) in [([0.0, 0.0, 1.0], RED), ([0.0, 0.0, -1.0], BLUE)] {
                let surface = Surface::from_parts(*v.grid.frame(), vec![[20, 10, 1]], vec![normal]).unwrap();
                let colors = surface_colors(&model, &v.placement, &surface, &Control::none()).unwrap();
                assert_eq!(colors, [expected]);
            }
        }
    }

    #[test]
    fn what_lies_across_an_air_gap_does_not_cover() {
        // Two plates a few voxels apart: the lower one's top keeps its colour.
        let lower = Shape::cuboid([0.0; 3], [2.0, 2.0, 0.3]);
        for gap in [0.06, 0.12] {
            let upper = Shape::cuboid([0.0, 0.0, 0.3 + gap], [2.0, 2.0, 0.36 + gap]);
            let (surface, colors) = colors(&painted(&[(lower.clone(), BLUE), (upper, RED)]));
            let mut checked = 0;
            for (i, color) in colors.iter().enumerate() {
                let p = surface.position_mm(i as u32);
                if p[2] < 0.3 && p[2] > 0.2 && p[0].min(p[1]) > 0.3 && p[0].max(p[1]) < 1.7 {
                    assert_eq!(*color, BLUE, "gap {gap}, {p:?}");
                    checked += 1;
                }
            }
            assert!(checked > 100, "gap {gap}: {checked}");
        }
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
}
