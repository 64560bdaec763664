//! The generalised winding number of the caps that close a mesh's holes.
//!
//! A mesh and its caps together are closed, so their winding number W is an integer that crossings
//! count exactly. The mesh's own generalised winding number is W - c, c the caps' (winding numbers
//! add up), so that only c has to be evaluated as a field, and only where it can matter: next to
//! holes. On a closed mesh there is nothing to evaluate.

use crate::bvh::Bvh;
use crate::geometry::{Bounds, Vec3, cross, dot, length, scale, sub};
use crate::winding::{WindingTree, triangle_winding};

/// Up to this many caps are summed one by one.
const EXACT: usize = 256;
/// Bound of the hierarchy's error, with a margin for rounding.
const ERROR: f64 = 4e-3;

/// The field c and a bound on how much it varies.
pub(crate) struct CapField {
    caps: Vec<[Vec3; 3]>,
    tree: WindingTree,
    /// Boundary edges: the sides of caps opposite to their apex.
    edges: Vec<(Bounds, f64)>,
    edge_tree: Bvh,
    /// Total edge length below each node of `edge_tree`.
    edge_lengths: Vec<f64>,
}

impl CapField {
    /// Prepares caps whose third corner is the apex, in millimetres.
    pub fn build(caps: Vec<[Vec3; 3]>) -> Self {
        let edges: Vec<(Bounds, f64)> =
            caps.iter().map(|c| (Bounds::of([c[0], c[1]]), length(sub(c[1], c[0])))).collect();
        let boxes: Vec<Bounds> = edges.iter().map(|e| e.0).collect();
        let edge_tree = Bvh::build(&boxes);
        let edge_lengths = edge_tree
            .nodes()
            .iter()
            .map(|n| edge_tree.order()[n.range()].iter().map(|&e| edges[e as usize].1).sum())
            .collect();
        Self { tree: WindingTree::build(&caps), caps, edges, edge_tree, edge_lengths }
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
    /// Away from the caps c is smooth, and its gradient is the Biot-Savart field of the boundary:
    /// at most the sum of edge length / (4 pi distance^2).
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
        let nodes = self.edge_tree.nodes();
        let mut sum = 0.0;
        let mut stack = vec![0u32];
        while let Some(index) = stack.pop() {
            let node = &nodes[index as usize];
            let d2 = node.bounds.distance2(area);
            let extent = node.bounds.extent();
            if d2 > dot(extent, extent) {
                sum += self.edge_lengths[index as usize] / d2;
            } else if node.is_leaf() {
                for &e in &self.edge_tree.order()[node.range()] {
                    let (bounds, l) = &self.edges[e as usize];
                    if *l > 0.0 {
                        sum += l / bounds.distance2(area);
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

    proptest! {
        #[test]
        fn a_negligible_box_holds_no_half(
            n in prop_oneof![Just(3usize), Just(24), Just(400)],
            low in prop::array::uniform3(-1.5..1.5f64),
            edge in prop::array::uniform3(0.001..0.8f64),
            inside in prop::collection::vec(prop::array::uniform3(0.0..=1.0f64), 30),
        ) {
            let field = CapField::build(cone(n));
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
