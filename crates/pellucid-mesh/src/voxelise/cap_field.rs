//! The generalised winding number of the caps that close a mesh's holes.
//!
//! A mesh and its caps together are closed, so their winding number W is an integer that crossings
//! count exactly. The mesh's own generalised winding number is W - c, c the caps' (winding numbers
//! add up), so that only c has to be evaluated as a field, and only where it can matter: next to
//! holes. On a closed mesh there is nothing to evaluate.

use crate::bvh::{Bvh, Node};
use crate::geometry::{Bounds, Vec3, area_vector, cross, dot, length, scale, sub};
use crate::winding::{WindingTree, triangle_winding};

/// Up to this many caps are summed one by one.
const EXACT: usize = 256;
/// Bound of the hierarchy's error, with a margin for rounding.
const ERROR: f64 = 4e-3;

/// The field c and a bound on how much it varies.
pub(crate) struct CapField {
    caps: Vec<[Vec3; 3]>,
    tree: WindingTree,
    holes: Vec<Hole>,
    hole_tree: Bvh,
    /// What lies below each node of `hole_tree`.
    sums: Vec<Extent>,
}

/// The caps over one hole.
struct Hole {
    bounds: Bounds,
    extent: Extent,
    /// Boundary edges, the sides of caps opposite to the apex.
    edges: Vec<[Vec3; 2]>,
    edge_tree: Bvh,
    /// Total length below each node of `edge_tree`.
    lengths: Vec<f64>,
}

/// How much of holes there is.
#[derive(Clone, Copy, Default)]
struct Extent {
    /// Length of the boundary.
    length: f64,
    /// Area of the caps.
    area: f64,
}

impl Extent {
    fn joined(self, other: Self) -> Self {
        Self { length: self.length + other.length, area: self.area + other.area }
    }

    /// Most that the solid angle of whole holes changes per length at this squared distance from
    /// their caps: by the Biot-Savart field of the boundary, or by the caps as sheets of dipoles,
    /// each with a gradient of at most 2 area / distance^3.
    fn gradient(self, distance2: f64) -> f64 {
        (self.length / distance2).min(2.0 * self.area / (distance2 * distance2.sqrt()))
    }
}

impl Hole {
    fn new(caps: &[[Vec3; 3]]) -> Self {
        let edges: Vec<[Vec3; 2]> = caps.iter().map(|c| [c[0], c[1]]).collect();
        let edge_tree = Bvh::build(&edges.iter().map(|e| Bounds::of(*e)).collect::<Vec<_>>());
        let span = |e: &[Vec3; 2]| length(sub(e[1], e[0]));
        let below = |n: &Node| edge_tree.order()[n.range()].iter().map(|&e| span(&edges[e as usize])).sum();
        let lengths: Vec<f64> = edge_tree.nodes().iter().map(below).collect();
        let area = caps.iter().map(|c| length(area_vector(*c))).sum();
        let extent = Extent { length: edges.iter().map(span).sum(), area };
        let bounds = Bounds::of(caps.iter().flatten().copied());
        Self { bounds, extent, edges, edge_tree, lengths }
    }

    /// Adds the bound on the gradient over a box to `sum`, until that passes `budget`.
    fn add_gradient(&self, area: &Bounds, sum: &mut f64, budget: f64) {
        let nodes = self.edge_tree.nodes();
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop()
            && *sum < budget
        {
            let node = &nodes[index as usize];
            let d2 = node.bounds.distance2(area);
            if d2 > length2(node.bounds.extent()) {
                *sum += self.lengths[index as usize] / d2;
            } else if node.is_leaf() {
                let order = &self.edge_tree.order()[node.range()];
                *sum += order.iter().map(|&e| edge_gradient(self.edges[e as usize], area)).sum::<f64>();
            } else {
                stack.extend([node.right, index + 1]);
            }
        }
    }
}

/// Most that the Biot-Savart field of an edge is over a box: that of the whole line it lies on, 2 over
/// the distance, or length over the distance squared.
fn edge_gradient([a, b]: [Vec3; 2], area: &Bounds) -> f64 {
    let span = length(sub(b, a));
    if span == 0.0 {
        return 0.0;
    }
    let (way, offset) = (sub(b, a), sub(area.centre(), a));
    let nearest = scale(way, (dot(offset, way) / (span * span)).clamp(0.0, 1.0));
    let from_centre = length(sub(offset, nearest)) - 0.5 * length(area.extent());
    let distance = from_centre.max(Bounds::of([a, b]).distance2(area).sqrt());
    if distance > 0.0 { (span / distance).min(2.0) / distance } else { f64::INFINITY }
}

fn length2(v: Vec3) -> f64 {
    dot(v, v)
}

impl CapField {
    /// Prepares caps whose third corner is the apex of their hole, in millimetres.
    pub fn build(mut caps: Vec<[Vec3; 3]>) -> Self {
        caps.sort_by_key(|c| c[2].map(f64::to_bits));
        let holes: Vec<Hole> = caps.chunk_by(|a, b| a[2] == b[2]).map(Hole::new).collect();
        let hole_tree = Bvh::build(&holes.iter().map(|h| h.bounds).collect::<Vec<_>>());
        let below = |n: &Node| {
            let all = hole_tree.order()[n.range()].iter();
            all.fold(Extent::default(), |sum, &h| sum.joined(holes[h as usize].extent))
        };
        let sums = hole_tree.nodes().iter().map(below).collect();
        Self { tree: WindingTree::build(&caps), caps, holes, hole_tree, sums }
    }

    /// No caps: the field is zero.
    pub fn is_empty(&self) -> bool {
        self.caps.is_empty()
    }

    /// The field at a point.
    pub fn at(&self, q: Vec3) -> f64 {
        if self.caps.len() <= EXACT {
            self.caps.iter().map(|c| triangle_winding(q, *c)).sum()
        } else {
            self.tree.at(q)
        }
    }

    /// Whether a point with integer winding number `closed` of mesh and caps is solid by the mesh's
    /// own winding number w = closed - c: |w| >= 1/2, where a tie within the field's error goes to
    /// what the caps say.
    pub fn solid(&self, q: Vec3, closed: i32) -> bool {
        let w = (f64::from(closed) - self.at(q)).abs();
        if closed == 0 { w > 0.5 + ERROR } else { w > 0.5 - ERROR }
    }

    /// True when |c| < 1/2 all over a box, so that a point in it is solid exactly where the integer
    /// winding number of mesh and caps is not 0.
    ///
    /// Away from the caps c is smooth, and its gradient bounded by how much of holes there is at
    /// which distance.
    pub fn negligible(&self, area: &Bounds) -> bool {
        if self.caps.is_empty() {
            return true;
        }
        let reach = 0.5 * length(area.extent());
        let slack = 0.5 - ERROR - self.at(area.centre()).abs();
        if slack <= 0.0 || !self.gradient_below(area, slack / reach.max(f64::MIN_POSITIVE)) {
            return false;
        }
        !self.tree.bvh().any_overlapping(area, |i| triangle_meets_box(&self.caps[i as usize], area))
    }

    /// Whether the bound on the gradient over a box stays below `limit`.
    fn gradient_below(&self, area: &Bounds, limit: f64) -> bool {
        let budget = limit * 4.0 * std::f64::consts::PI;
        let nodes = self.hole_tree.nodes();
        let mut sum = 0.0;
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let node = &nodes[index as usize];
            let d2 = node.bounds.distance2(area);
            if d2 > length2(node.bounds.extent()) {
                sum += self.sums[index as usize].gradient(d2);
            } else if node.is_leaf() {
                for hole in self.hole_tree.order()[node.range()].iter().map(|&h| &self.holes[h as usize]) {
                    let d2 = hole.bounds.distance2(area);
                    if d2 > length2(hole.bounds.extent()) {
                        sum += hole.extent.gradient(d2);
                    } else {
                        hole.add_gradient(area, &mut sum, budget);
                    }
                }
            } else {
                stack.extend([node.right, index + 1]);
            }
            if sum >= budget {
                return false;
            }
        }
        true
    }
}

/// Separating-axis test of a triangle against a box (Akenine-Möller 2001).
fn triangle_meets_box(corners: &[Vec3; 3], area: &Bounds) -> bool {
    let half = scale(area.extent(), 0.5);
    let centre = area.centre();
    let p = corners.map(|c| sub(c, centre));
    let separates = |axis: Vec3| {
        let r: f64 = (0..3).map(|k| half[k] * axis[k].abs()).sum();
        let d = p.map(|c| dot(c, axis));
        d[0].min(d[1]).min(d[2]) > r || d[0].max(d[1]).max(d[2]) < -r
    };
    let units = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let edges = [sub(p[1], p[0]), sub(p[2], p[1]), sub(p[0], p[2])];
    !(units.iter().any(|&u| separates(u))
        || separates(cross(edges[0], edges[1]))
        || edges.iter().any(|&e| units.iter().any(|&u| separates(cross(e, u)))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The cone over a wavy ring of radius 1 around z.
    fn cone(n: usize) -> Vec<[Vec3; 3]> {
        let ring = |i: usize| {
            let a = (i % n) as f64 / n as f64 * std::f64::consts::TAU;
            [a.cos(), a.sin(), 0.2 * (3.0 * a).sin()]
        };
        (0..n).map(|i| [ring(i), ring(i + 1), [0.1, 0.0, 0.3]]).collect()
    }

    /// Cones over rings, spread around.
    fn cones(n: usize, count: usize) -> Vec<[Vec3; 3]> {
        let place = |k: usize, p: Vec3| {
            let [dx, dy, dz] = [k % 4, k / 4 % 4, k / 16].map(|c| 0.7 * c as f64);
            let s = if count == 1 { 1.0 } else { 0.2 };
            [s * p[0] + dx, s * p[2] + dy, s * p[1] - dz]
        };
        (0..count).flat_map(|k| cone(n).into_iter().map(move |c| c.map(|p| place(k, p)))).collect()
    }

    proptest! {
        #[test]
        fn a_negligible_box_holds_no_half(
            n in prop_oneof![Just(3usize), Just(24), Just(400)],
            count in prop_oneof![Just(1usize), Just(40)],
            low in prop::array::uniform3(-1.5..1.5f64),
            edge in prop::array::uniform3(0.001..0.8f64),
            inside in prop::collection::vec(prop::array::uniform3(0.0..=1.0f64), 30),
        ) {
            let field = CapField::build(cones(n, count));
            let area = Bounds { min: low, max: std::array::from_fn(|k| low[k] + edge[k]) };
            if field.negligible(&area) {
                for s in inside {
                    let q = std::array::from_fn(|k| low[k] + s[k] * edge[k]);
                    prop_assert!(field.at(q).abs() < 0.5);
                }
            }
        }

        #[test]
        fn box_test_finds_every_triangle_with_a_point_inside(
            corners in prop::array::uniform3(prop::array::uniform3(-2.0..2.0f64)),
            weights in prop::array::uniform2(0.0..1.0f64),
        ) {
            let (u, v) = (weights[0], weights[1] * (1.0 - weights[0]));
            let p: Vec3 = std::array::from_fn(|k| {
                u * corners[0][k] + v * corners[1][k] + (1.0 - u - v) * corners[2][k]
            });
            let around = Bounds { min: p.map(|c| c - 1e-6), max: p.map(|c| c + 0.3) };
            prop_assert!(triangle_meets_box(&corners, &around));
        }
    }

    #[test]
    fn far_boxes_are_negligible_and_the_ring_is_not() {
        let field = CapField::build(cone(24));
        assert!(field.negligible(&Bounds { min: [3.0; 3], max: [4.0; 3] }));
        assert!(!field.negligible(&Bounds { min: [0.9, -0.1, -0.1], max: [1.1, 0.1, 0.1] }));
        let flat = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]];
        let corner = Bounds { min: [0.0, 0.6, 0.6], max: [0.2, 1.0, 1.0] };
        assert!(!triangle_meets_box(&flat, &corner));
    }
}
