//! Edges of a triangle set, and which triangles go on in which across them.

use std::f64::consts::TAU;

use crate::geometry::{Vec3, cross, dot, length, scale, sub};
use crate::weld::directed_edges;

/// Triangles around one edge: `(low vertex, high vertex, triangle, runs low to high)`.
pub(crate) type EdgeUse = (u32, u32, u32, bool);

pub(crate) fn same_edge(a: &EdgeUse, b: &EdgeUse) -> bool {
    (a.0, a.1) == (b.0, b.1)
}

/// Every use of every edge, those of one edge together.
pub(crate) fn edge_uses(triangles: &[[u32; 3]]) -> Vec<EdgeUse> {
    let mut uses: Vec<EdgeUse> = triangles
        .iter()
        .enumerate()
        .flat_map(|(i, t)| directed_edges(*t).map(|(a, b)| (a.min(b), a.max(b), i as u32, a < b)))
        .collect();
    uses.sort_unstable();
    uses
}

/// Triangles that are this many radians apart are never one on the other, however small.
const WEDGE: f64 = 0.1;

/// Wedges below this many radians may be the gap between a surface and its back copy.
const NARROW: f64 = 0.35;

/// The triangles around edges of a mesh, by angle.
pub(crate) struct Fans<'m> {
    pub vertices: &'m [Vec3],
    pub triangles: &'m [[u32; 3]],
    /// Triangles that part by less than this at their nearer apex count as one on the other.
    pub tolerance: f64,
    /// For each triangle the apexes of its neighbours over edges of two; [`NONE`] where there is
    /// none. May be empty.
    pub beyond: Vec<[u32; 3]>,
}

/// No vertex.
const NONE: u32 = u32::MAX;

/// The apexes beyond each triangle's edges, for [`Fans::beyond`].
pub(crate) fn apexes_beyond(triangles: &[[u32; 3]], uses: &[EdgeUse]) -> Vec<[u32; 3]> {
    let mut beyond = vec![[NONE; 3]; triangles.len()];
    for group in uses.chunk_by(same_edge) {
        let [a, b] = group else { continue };
        for (of, other) in [(a, b), (b, a)] {
            let free = beyond[of.2 as usize].iter_mut().find(|v| **v == NONE);
            if let (Some(free), Some(apex)) = (free, apex(triangles, other)) {
                *free = apex;
            }
        }
    }
    beyond
}

/// The corner of a triangle that is not on an edge of it.
fn apex(triangles: &[[u32; 3]], u: &EdgeUse) -> Option<u32> {
    triangles[u.2 as usize].into_iter().find(|&v| v != u.0 && v != u.1)
}

/// A triangle in the fan around an edge.
#[derive(Clone, Copy)]
struct Leaf {
    triangle: u32,
    /// Radians counter-clockwise.
    angle: f64,
    /// Equal for triangles that lie on each other; ascending counter-clockwise.
    place: usize,
    /// Counter-clockwise past it lies what it encloses.
    opens: bool,
}

impl Fans<'_> {
    /// Whether both triangles of an edge lie on the same side of it, one on the other: a fold
    /// without a wedge, as where the rims of a surface and of its back copy meet.
    pub fn folded(&self, a: &EdgeUse, b: &EdgeUse) -> bool {
        let (a, b) = (self.arm(a), self.arm(b));
        let (la, lb) = (length(a), length(b));
        let sine = length(cross(a, b)) / (la * lb);
        la.min(lb) > self.tolerance && dot(a, b) > 0.0 && self.together(sine, la, lb)
    }

    /// Whether arms that are `gap` radians apart lie on each other.
    fn together(&self, gap: f64, a: f64, b: f64) -> bool {
        gap < WEDGE && gap * a.min(b) <= self.tolerance
    }

    /// Whether two triangles on an edge are halves of one quad, split along either diagonal.
    fn halves(&self, a: &EdgeUse, b: &EdgeUse) -> bool {
        let beyond = |u: &EdgeUse, other: &EdgeUse| {
            let apexes = self.beyond.get(u.2 as usize);
            apexes.zip(apex(self.triangles, other)).is_some_and(|(all, v)| all.contains(&v))
        };
        beyond(a, b) && beyond(b, a)
    }

    /// The way from the edge to the apex of a triangle on it, at right angles to the edge.
    fn arm(&self, u: &EdgeUse) -> Vec3 {
        let [low, high] = [u.0, u.1].map(|v| self.vertices[v as usize]);
        let d = sub(apex(self.triangles, u).map_or(low, |v| self.vertices[v as usize]), low);
        let along = unit(sub(high, low));
        sub(d, scale(along, dot(d, along)))
    }

    /// Pairs the triangles around an edge so that each pair bounds a wedge of solid, nested wedges
    /// inside each other. A triangle on which another lies face to face closes its wedge before the
    /// other opens one, so that bodies that touch keep their own walls, and a surface and its back
    /// copy do not pair. Unpaired triangles are left out.
    ///
    /// A surface and a back copy that is split otherwise part a little where they are not flat.
    /// Wedges as narrow as that are taken only if nothing else pairs all triangles.
    pub fn wedges(&self, uses: &[EdgeUse]) -> Vec<(u32, u32)> {
        let (pairs, narrowest) = pair_up(&self.fan(uses, |gap, a, b| self.together(gap, a, b)));
        if narrowest < NARROW {
            let (wide, _) = pair_up(&self.fan(uses, |gap, _, _| gap < NARROW));
            if 2 * wide.len() == uses.len() {
                return wide;
            }
        }
        pairs
    }

    /// Sorts triangles counter-clockwise around an edge, seen against its direction.
    /// `together` says whether a gap in radians is none between arms of two lengths.
    fn fan(&self, uses: &[EdgeUse], together: impl Fn(f64, f64, f64) -> bool) -> Vec<Leaf> {
        let [low, high] = [uses[0].0, uses[0].1].map(|v| self.vertices[v as usize]);
        let arms: Vec<Vec3> = uses.iter().map(|u| self.arm(u)).collect();
        let reference = (0..arms.len()).fold(0, |r, i| if length(arms[i]) > length(arms[r]) { i } else { r });
        let first = arms[reference];
        let across = cross(unit(sub(high, low)), first);
        let mut by_angle: Vec<(f64, f64, usize)> = arms
            .iter()
            .enumerate()
            .map(|(i, a)| (dot(*a, across).atan2(dot(*a, first)).rem_euclid(TAU), length(*a), i))
            .collect();
        // What lies on the first from below would else come last.
        for leaf in &mut by_angle {
            let one = together(TAU - leaf.0, leaf.1, length(first));
            if one || (leaf.0 > TAU - 1.0 && self.halves(&uses[leaf.2], &uses[reference])) {
                leaf.0 = 0.0;
            }
        }
        by_angle.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let mut place = 0;
        let mut fan: Vec<Leaf> = Vec::with_capacity(uses.len());
        for (k, leaf) in by_angle.iter().enumerate() {
            if k > 0 {
                let last = by_angle[k - 1];
                let one =
                    together(leaf.0 - last.0, leaf.1, last.1) || self.halves(&uses[leaf.2], &uses[last.2]);
                place += usize::from(!one);
            }
            let (_, _, triangle, forward) = uses[leaf.2];
            fan.push(Leaf { triangle, angle: leaf.0, place, opens: !forward });
        }
        // At one place wedges close, the last opened first, before others open.
        let order = |l: &Leaf| if l.opens { i64::from(l.triangle) } else { -i64::from(l.triangle) };
        fan.sort_by_key(|l| (l.place, l.opens, order(l)));
        fan
    }
}

/// Pairs of triangles that bound a wedge, and the angle of the narrowest wedge.
fn pair_up(fan: &[Leaf]) -> (Vec<(u32, u32)>, f64) {
    let mut taken = vec![false; fan.len()];
    let mut open: Vec<usize> = Vec::new();
    let mut pairs = Vec::new();
    let mut narrowest = TAU;
    // Twice round: a wedge may lie across the start.
    for i in (0..fan.len()).chain(0..fan.len()) {
        if taken[i] {
            continue;
        }
        if fan[i].opens {
            if !open.contains(&i) {
                open.push(i);
            }
        } else if let Some(&from) = open.last()
            && fan[from].place != fan[i].place
        {
            open.pop();
            (taken[from], taken[i]) = (true, true);
            narrowest = narrowest.min((fan[i].angle - fan[from].angle).rem_euclid(TAU));
            pairs.push((fan[from].triangle, fan[i].triangle));
        }
    }
    (pairs, narrowest)
}

fn unit(v: Vec3) -> Vec3 {
    scale(v, 1.0 / length(v).max(f64::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs of triangles around the z axis, given by angle in degrees and whether they open.
    fn paired(leaves: &[(f64, bool)]) -> Vec<(u32, u32)> {
        let mut vertices = vec![[0.0; 3], [0.0, 0.0, 1.0]];
        let mut triangles = Vec::new();
        for (degrees, opens) in leaves {
            let (sin, cos) = degrees.to_radians().sin_cos();
            vertices.push([cos, sin, 0.3]);
            let apex = vertices.len() as u32 - 1;
            triangles.push(if *opens { [1, 0, apex] } else { [0, 1, apex] });
        }
        let uses: Vec<EdgeUse> = edge_uses(&triangles).into_iter().filter(|u| (u.0, u.1) == (0, 1)).collect();
        let fans = Fans { vertices: &vertices, triangles: &triangles, tolerance: 1e-6, beyond: vec![] };
        let mut pairs = fans.wedges(&uses);
        pairs.sort_unstable();
        pairs
    }

    #[test]
    fn a_triangle_opens_what_lies_against_its_normal() {
        // The normal of (0, 1, apex) is z x apex: counter-clockwise of it lies the outside.
        assert_eq!(paired(&[(0.0, true), (90.0, false)]), [(0, 1)]);
        assert_eq!(paired(&[(0.0, false), (90.0, true)]), [(1, 0)]);
    }

    #[test]
    fn bodies_that_touch_keep_their_own_walls() {
        for turn in [0.0, 30.0, 123.0, 359.0] {
            let at =
                |list: &[(f64, bool)]| paired(&list.iter().map(|l| (l.0 + turn, l.1)).collect::<Vec<_>>());
            // Two in a row, with the walls between them in either order.
            assert_eq!(at(&[(0.0, true), (90.0, false), (90.0, true), (180.0, false)]), [(0, 1), (2, 3)]);
            assert_eq!(at(&[(0.0, true), (90.0, true), (90.0, false), (180.0, false)]), [(0, 2), (1, 3)]);
            // Two that touch in the edge only, and four around it.
            assert_eq!(at(&[(0.0, true), (90.0, false), (180.0, true), (270.0, false)]), [(0, 1), (2, 3)]);
            let four: Vec<(f64, bool)> = (0..4)
                .flat_map(|k| [(90.0 * f64::from(k), true), (90.0 * f64::from(k + 1), false)])
                .collect();
            assert_eq!(at(&four), [(0, 1), (2, 3), (4, 5), (6, 7)]);
        }
    }

    #[test]
    fn a_surface_and_its_back_copy_stay_apart() {
        for turn in [0.0, 200.0] {
            let at =
                |list: &[(f64, bool)]| paired(&list.iter().map(|l| (l.0 + turn, l.1)).collect::<Vec<_>>());
            // Front 0 and 1, back 2 and 3, around the edge of a cube and within a flat face.
            assert_eq!(at(&[(0.0, true), (90.0, false), (0.0, false), (90.0, true)]), [(0, 1), (3, 2)]);
            assert_eq!(at(&[(0.0, true), (180.0, false), (0.0, false), (180.0, true)]), [(0, 1), (3, 2)]);
            // At a rim they only meet each other.
            assert_eq!(at(&[(0.0, true), (0.0, false)]), []);
            // A back copy that ends here.
            assert_eq!(at(&[(0.0, true), (90.0, false), (90.0, true)]), [(0, 1)]);
        }
    }

    #[test]
    fn a_back_copy_that_bulges_otherwise_stays_apart() {
        // Front 0 and 1, back 2 and 3, on either side of it.
        for bulge in [-4.0, 4.0] {
            let at = [(0.0, true), (170.0, false), (bulge, false), (170.0 - bulge, true)];
            let pairs = paired(&at.map(|(degrees, opens)| ((degrees + 360.0) % 360.0, opens)));
            assert_eq!(pairs, [(0, 1), (3, 2)], "{bulge}");
        }
        // Slices of a pie as narrow are bodies that touch.
        let slices: Vec<(f64, bool)> = (0..36)
            .flat_map(|k| [(10.0 * f64::from(k), true), (10.0 * f64::from(k + 1) % 360.0, false)])
            .collect();
        let expected: Vec<(u32, u32)> = (0..36).map(|k| (2 * k, 2 * k + 1)).collect();
        assert_eq!(paired(&slices), expected);
    }

    #[test]
    fn two_equal_bodies_pair_each_with_itself() {
        assert_eq!(paired(&[(0.0, true), (90.0, false), (0.0, true), (90.0, false)]), [(0, 1), (2, 3)]);
        assert_eq!(paired(&[(90.0, false), (0.0, true), (0.0, true), (90.0, false)]), [(1, 0), (2, 3)]);
    }
}
