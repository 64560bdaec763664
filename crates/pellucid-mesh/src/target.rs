//! The colour each surface voxel should have.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Control, Surface};
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::geometry::{
    Bounds, Vec3, area_vector, dot, length, line_meets_triangle, nearest_on_triangle, scale, sub,
};
use crate::shell::Role;
use crate::thickness::patch_area_mm2;
use crate::{MeshError, Model, PlacedMesh, Placement};

/// Voxels that one task handles.
const CHUNK: usize = 4096;
/// Cosine between voxel and triangle normal from which a triangle is on the voxel's side.
const SAME_SIDE: f64 = 0.1;

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
        let nearest = NearestTriangle::build(self);
        let pitch = surface.frame().pitch();
        let diagonal = length(pitch.mm());
        let done = AtomicU64::new(0);
        let mut colors = vec![[0f32; 3]; surface.len()];
        let chunks = colors.par_chunks_mut(CHUNK).zip(surface.voxels().par_chunks(CHUNK));
        chunks.zip(surface.normals().par_chunks(CHUNK)).try_for_each(|((out, voxels), normals)| {
            control.check()?;
            for ((color, voxel), normal) in out.iter_mut().zip(voxels).zip(normals) {
                let p = surface.frame().centre_mm(voxel.map(i64::from));
                let below = nearest.find(p, normal.map(f64::from), diagonal);
                let (triangle, barycentric) =
                    nearest.cover(below, p, normal.map(f64::from), surface).unwrap_or(below);
                let footprint_m = patch_area_mm2(pitch, *normal).sqrt() / self.placement().mm_per_m();
                *color = self.model().color_at(triangle, barycentric, footprint_m);
            }
            control.advance(&done, voxels.len() as u64, surface.len() as u64);
            Ok::<(), MeshError>(())
        })?;
        Ok(colors)
    }
}

/// Nearest-point queries on a model's triangles in print space.
struct NearestTriangle {
    bvh: Bvh,
    corners: Vec<[Vec3; 3]>,
    /// Unit normals with orientation put right; zero for triangles without area.
    normals: Vec<Vec3>,
    sides: Vec<Sides>,
}

/// What a triangle is part of, and from where it shows.
#[derive(Clone, Copy, PartialEq)]
enum Sides {
    /// A closed surface: it shows from the side it faces.
    Closed,
    /// The back copy of a sheet: it shows from the side it faces where the front does not.
    Back,
    /// The back copy of a body: it shows nowhere.
    Hidden,
    /// An open sheet that shows from the side it faces.
    Sheet,
    /// An open sheet that shows from both sides.
    DoubleSheet,
}

/// A cover is looked for up to this many voxel diagonals off.
const REACH: f64 = 3.0;
/// A cover at less than this share of a voxel's diagonal lies on the surface.
const TOUCHING: f64 = 1e-4;

/// A triangle found: distance (squared to the nearest, plain along a line), index, barycentric
/// weights.
type Hit = (f64, u32, [f64; 3]);

impl NearestTriangle {
    fn build(mesh: &PlacedMesh) -> Self {
        let (model, topology) = (mesh.model(), mesh.topology());
        let corners: Vec<[Vec3; 3]> = (0..model.triangles().len() as u32)
            .map(|t| model.corners_m(t).map(|p| mesh.placement().to_mm(p)))
            .collect();
        let mut normals: Vec<Vec3> = corners
            .iter()
            .map(|c| {
                let n = area_vector(*c);
                let l = length(n);
                if l > 0.0 { scale(n, 1.0 / l) } else { [0.0; 3] }
            })
            .collect();
        for (&source, _) in topology.source.iter().zip(&topology.reversed).filter(|(_, r)| **r) {
            normals[source as usize] = scale(normals[source as usize], -1.0);
        }
        let mut sides = vec![Sides::Closed; corners.len()];
        for shell in topology.walls().filter(|s| !s.caps.is_empty()) {
            for source in shell.triangles.iter().map(|&t| topology.source[t as usize]) {
                let material = model.triangles()[source as usize].material;
                let double = model.materials()[material as usize].double_sided;
                sides[source as usize] = if double { Sides::DoubleSheet } else { Sides::Sheet };
            }
        }
        for shell in &topology.shells {
            if let Role::BackCopy(front) = shell.role {
                let front = &topology.shells[front as usize];
                let sheet = front.is_sheet(&topology.vertices, &topology.triangles);
                let role = if sheet { Sides::Back } else { Sides::Hidden };
                shell.triangles.iter().for_each(|&t| sides[topology.source[t as usize] as usize] = role);
            }
        }
        let boxes: Vec<Bounds> = corners.iter().map(|c| Bounds::of(*c)).collect();
        Self { bvh: Bvh::build(&boxes), corners, normals, sides }
    }

    /// The outermost triangle in front of a point `below` of the mesh that shows there, seen
    /// against the point's normal, for a voxel of the surface with its centre at `p`.
    fn cover(
        &self,
        below: (u32, [f64; 3]),
        p: Vec3,
        normal: Vec3,
        surface: &Surface,
    ) -> Option<(u32, [f64; 3])> {
        let (triangle, weights) = below;
        let own = self.normals[triangle as usize];
        let out = if dot(own, normal) > SAME_SIDE { own } else { normal };
        if out == [0.0; 3] {
            return None;
        }
        let diagonal = length(surface.frame().pitch().mm());
        let corners = self.corners[triangle as usize];
        let from: Vec3 = std::array::from_fn(|k| (0..3).map(|c| weights[c] * corners[c][k]).sum());
        let reach = REACH * diagonal;
        // A sheet without volume lies on what it touches.
        let touching = TOUCHING * diagonal;
        let sheet = |t: u32| matches!(self.sides[t as usize], Sides::Sheet | Sides::DoubleSheet);
        let mut hits: Vec<Hit> = Vec::new();
        // Where the way first leads into a closed surface.
        let mut entry = f64::INFINITY;
        self.bvh.along(sub(from, scale(out, touching)), scale(out, reach), |t| {
            let facing = dot(self.normals[t as usize], out);
            if t == triangle || facing.abs() <= SAME_SIDE {
                return;
            }
            let Some((d, weights)) = line_meets_triangle(from, out, self.corners[t as usize]) else {
                return;
            };
            let above = d > touching || (d > -touching && sheet(t) && !sheet(triangle));
            if above && d <= reach {
                match self.sides[t as usize] {
                    Sides::Hidden => {}
                    _ if facing > 0.0 => hits.push((d, t, weights)),
                    Sides::DoubleSheet => hits.push((d, t, weights)),
                    Sides::Closed => entry = entry.min(d),
                    Sides::Back | Sides::Sheet => {}
                }
            }
        });
        if hits.is_empty() {
            return None;
        }
        // What is left before another is entered had the point inside.
        let around = hits.iter().filter(|h| h.0 < entry && self.sides[h.1 as usize] == Sides::Closed);
        let around = around.map(|h| h.0).fold(f64::NEG_INFINITY, f64::max);
        let limit = around.max(free_way(surface, p, out, reach) + dot(sub(p, from), out));
        hits.retain(|h| h.0 <= limit);
        let outermost = hits.iter().map(|h| h.0).fold(f64::NEG_INFINITY, f64::max);
        let faces_in = |t: u32| dot(self.normals[t as usize], out) < 0.0;
        let top = hits.into_iter().filter(|h| h.0 >= outermost - touching);
        top.min_by_key(|h| (faces_in(h.1), h.1)).map(|(_, t, weights)| (t, weights))
    }

    /// The triangle nearest to `p`, preferring one that faces along `normal` among those at most
    /// `slack` farther than the nearest of all. A back copy is taken only if it does.
    fn find(&self, p: Vec3, normal: Vec3, slack: f64) -> (u32, [f64; 3]) {
        let side = |t: u32| self.sides[t as usize];
        let any = self.nearest(p, f64::INFINITY, |t| !matches!(side(t), Sides::Back | Sides::Hidden));
        let faces = |t: u32| side(t) != Sides::Hidden && dot(self.normals[t as usize], normal) > SAME_SIDE;
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

/// How far one comes from the centre of a surface voxel before the next solid voxel behind air, `most`
/// at most.
fn free_way(surface: &Surface, p: Vec3, out: Vec3, most: f64) -> f64 {
    let frame = surface.frame();
    let mm = frame.pitch().mm();
    let step = 0.25 * mm[0].min(mm[1]).min(mm[2]);
    let mut in_air = false;
    let mut way = step;
    while way < most {
        let at = std::array::from_fn(|k| p[k] + way * out[k]);
        let solid = frame.checked(frame.voxel_at(at)).is_some_and(|v| surface.index_of(v).is_some());
        if solid && in_air {
            return way;
        }
        in_air |= !solid;
        way += step;
    }
    most
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
            let nearest = NearestTriangle::build(&PlacedMesh::at(&model, placement));
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
