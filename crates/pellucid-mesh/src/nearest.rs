//! The triangle that a voxel of the surface shows.

use pellucid_voxel::Surface;

use crate::PlacedMesh;
use crate::bvh::Bvh;
use crate::geometry::{
    Bounds, Vec3, area_vector, dot, length, line_meets_triangle, nearest_on_triangle, scale, sub,
};
use crate::shell::Role;

/// Cosine between voxel and triangle normal from which a triangle is on the voxel's side.
const SAME_SIDE: f64 = 0.1;

/// Nearest-point queries on a model's triangles in print space.
pub(crate) struct NearestTriangle {
    bvh: Bvh,
    corners: Vec<[Vec3; 3]>,
    /// Unit normals with orientation put right; zero for triangles without area.
    normals: Vec<Vec3>,
    sides: Vec<Sides>,
    /// Of open sheets without volume, such as decals.
    flat: Vec<bool>,
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
    pub fn build(mesh: &PlacedMesh) -> Self {
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
        let mut flat = vec![false; corners.len()];
        for shell in topology.walls().filter(|s| !s.caps.is_empty()) {
            let is_sheet = shell.is_sheet(&topology.vertices, &topology.triangles);
            for source in shell.triangles.iter().map(|&t| topology.source[t as usize]) {
                let material = model.triangles()[source as usize].material;
                let double = model.materials()[material as usize].double_sided;
                sides[source as usize] = if double { Sides::DoubleSheet } else { Sides::Sheet };
                flat[source as usize] = is_sheet;
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
        Self { bvh: Bvh::build(&boxes), corners, normals, sides, flat }
    }

    /// The outermost triangle in front of a point `below` of the mesh that shows there, seen
    /// against the point's normal, for a voxel of the surface with its centre at `p`. Places that are `clear` cover
    /// nothing.
    pub fn cover(
        &self,
        below: (u32, [f64; 3]),
        p: Vec3,
        normal: Vec3,
        surface: &Surface,
        clear: impl Fn(u32, [f64; 3]) -> bool,
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
            if above && d <= reach && !clear(t, weights) {
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
    /// `slack` farther than the nearest of all. A back copy is taken only if it does; a sheet that is `clear` there only
    /// if nothing else is as near.
    pub fn find(
        &self,
        p: Vec3,
        normal: Vec3,
        slack: f64,
        clear: impl Fn(u32, [f64; 3]) -> bool,
    ) -> (u32, [f64; 3]) {
        let found = self.find_any(p, normal, slack, |_, _| true);
        let passes = |t: u32, weights| !(self.flat[t as usize] && clear(t, weights));
        if passes(found.1, found.2) {
            return (found.1, found.2);
        }
        let below = self.find_any(p, normal, slack, passes);
        let (_, triangle, weights) = if below.0.sqrt() <= found.0.sqrt() + slack { below } else { found };
        (triangle, weights)
    }

    /// [`Self::find`] among the places that `accept` takes, with the squared distance.
    fn find_any(&self, p: Vec3, normal: Vec3, slack: f64, accept: impl Fn(u32, [f64; 3]) -> bool) -> Hit {
        let side = |t: u32| self.sides[t as usize];
        let visible = |t: u32| !matches!(side(t), Sides::Back | Sides::Hidden);
        let any = self.nearest(p, f64::INFINITY, visible, &accept);
        let faces = |t: u32| side(t) != Sides::Hidden && dot(self.normals[t as usize], normal) > SAME_SIDE;
        let (d2, triangle, _) = any;
        if faces(triangle) {
            return any;
        }
        let facing = self.nearest(p, (d2.sqrt() + slack).powi(2), faces, &accept);
        if facing.0.is_finite() { facing } else { any }
    }

    /// The nearest place within `radius2` that `accept` takes, on a triangle that `filter` does; an infinite distance when
    /// there is none.
    fn nearest(
        &self,
        p: Vec3,
        radius2: f64,
        filter: impl Fn(u32) -> bool,
        accept: impl Fn(u32, [f64; 3]) -> bool,
    ) -> Hit {
        let mut hit = (f64::INFINITY, 0, [1.0, 0.0, 0.0]);
        self.bvh.nearest(p, radius2, |t, best| {
            if filter(t) {
                let (weights, d2) = nearest_on_triangle(p, self.corners[t as usize]);
                if d2 <= best && (d2, t) < (hit.0, hit.1) && accept(t, weights) {
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
    use crate::Placement;
    use crate::shapes::Shape;
    use proptest::prelude::*;

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
            let (found, weights) = nearest.find(p, normal, slack, |_, _| false);

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
