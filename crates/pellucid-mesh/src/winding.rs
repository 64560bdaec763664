//! Generalised winding numbers of triangle sets, hierarchically.
//!
//! The winding number of a closed surface around a point is 1 inside, 0 outside; of a surface with
//! holes it varies smoothly and stays a usable vote (Jacobson et al. 2013). Far clusters of
//! triangles are replaced by a Taylor expansion of their dipole field (Barill et al. 2018,
//! section 3), near ones are summed exactly as solid angles (Van Oosterom and Strackee 1983).

use crate::bvh::Bvh;
use crate::geometry::{Bounds, Vec3, add, area_vector, centroid, cross, dot, length, scale, sub};

/// A cluster is expanded beyond this many times its radius; the tests hold the error against exact
/// sums to 0.002.
const FAR: f64 = 3.0;

/// Winding number of one triangle around `q`: its signed solid angle over 4 pi, positive where `q`
/// lies behind it (against its normal). 0 in its own plane.
pub(crate) fn triangle_winding(q: Vec3, corners: [Vec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|v| sub(v, q));
    let [la, lb, lc] = [a, b, c].map(length);
    let volume = dot(a, cross(b, c));
    if volume == 0.0 {
        return 0.0;
    }
    let denominator = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb;
    volume.atan2(denominator) / (2.0 * std::f64::consts::PI)
}

/// Moments of a cluster about its area-weighted centre: the integrals of n, d n and d d n over the
/// surface, d the offset from the centre.
#[derive(Clone, Copy, Debug)]
struct Moments {
    centre: Vec3,
    radius: f64,
    dipole: Vec3,
    first: [Vec3; 3],
    second: [[Vec3; 3]; 3],
}

/// Triangles prepared for winding-number queries.
#[derive(Clone, Debug)]
pub(crate) struct WindingTree {
    bvh: Bvh,
    /// In leaf order.
    triangles: Vec<[Vec3; 3]>,
    moments: Vec<Moments>,
}

impl WindingTree {
    /// Builds the hierarchy over triangles given by their corners.
    pub fn build(triangles: &[[Vec3; 3]]) -> Self {
        let boxes: Vec<Bounds> = triangles.iter().map(|t| Bounds::of(*t)).collect();
        let bvh = Bvh::build(&boxes);
        let ordered: Vec<[Vec3; 3]> = bvh.order().iter().map(|&i| triangles[i as usize]).collect();
        let moments = bvh.nodes().iter().map(|n| Moments::of(&ordered[n.range()])).collect();
        Self { bvh, triangles: ordered, moments }
    }

    /// The hierarchy of boxes; items are indices into the slice given to [`WindingTree::build`].
    pub fn bvh(&self) -> &Bvh {
        &self.bvh
    }

    /// Winding number around `q`.
    pub fn at(&self, q: Vec3) -> f64 {
        let nodes = self.bvh.nodes();
        let mut sum = 0.0;
        let mut stack = [0u32; 128];
        let mut top = usize::from(!nodes.is_empty());
        while top > 0 {
            top -= 1;
            let index = stack[top];
            let (node, moments) = (&nodes[index as usize], &self.moments[index as usize]);
            let r = sub(moments.centre, q);
            if dot(r, r) > (FAR * moments.radius).powi(2) && node.count > 1 {
                sum += moments.winding(r);
            } else if node.is_leaf() {
                sum += self.triangles[node.range()].iter().map(|t| triangle_winding(q, *t)).sum::<f64>();
            } else {
                stack[top] = node.right;
                stack[top + 1] = index + 1;
                top += 2;
            }
        }
        sum
    }
}

impl Moments {
    fn of(triangles: &[[Vec3; 3]]) -> Self {
        let mut area = 0.0;
        let mut weighted = [0.0; 3];
        for t in triangles {
            let a = length(area_vector(*t));
            area += a;
            weighted = add(weighted, scale(centroid(*t), a));
        }
        let centre = if area > 0.0 {
            scale(weighted, 1.0 / area)
        } else {
            Bounds::of(triangles.iter().flatten().copied()).centre()
        };
        let mut m =
            Self { centre, radius: 0.0, dipole: [0.0; 3], first: [[0.0; 3]; 3], second: [[[0.0; 3]; 3]; 3] };
        for t in triangles {
            let n = area_vector(*t);
            let corners = t.map(|v| sub(v, centre));
            let middle = centroid(corners);
            m.radius = corners.iter().map(|&v| length(v)).fold(m.radius, f64::max);
            m.dipole = add(m.dipole, n);
            for i in 0..3 {
                m.first[i] = add(m.first[i], scale(n, middle[i]));
                for k in 0..3 {
                    // The exact mean of d_i d_k over a triangle.
                    let outer =
                        corners.iter().map(|v| v[i] * v[k]).sum::<f64>() + 9.0 * middle[i] * middle[k];
                    m.second[i][k] = add(m.second[i][k], scale(n, outer / 12.0));
                }
            }
        }
        m
    }

    /// The field at offset `r` = centre - q: the expansion of (1/4 pi) integral n . r / |r|^3.
    fn winding(&self, r: Vec3) -> f64 {
        let r2 = dot(r, r);
        let inverse3 = 1.0 / (r2 * r2.sqrt());
        let inverse5 = inverse3 / r2;
        let inverse7 = inverse5 / r2;
        let mut w = dot(self.dipole, r) * inverse3;
        let trace = (0..3).map(|i| self.first[i][i]).sum::<f64>();
        let along = (0..3).map(|i| r[i] * dot(self.first[i], r)).sum::<f64>();
        w += trace * inverse3 - 3.0 * along * inverse5;
        let (mut single, mut triple) = (0.0, 0.0);
        for i in 0..3 {
            for k in 0..3 {
                let t = self.second[i][k];
                // delta_ij r_k + delta_jk r_i + delta_ik r_j, contracted with t over j.
                single += t[i] * r[k] + t[k] * r[i];
                if i == k {
                    single += dot(t, r);
                }
                triple += r[i] * r[k] * dot(t, r);
            }
        }
        w += 0.5 * (15.0 * triple * inverse7 - 3.0 * single * inverse5);
        w / (4.0 * std::f64::consts::PI)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute(q: Vec3, triangles: &[[Vec3; 3]]) -> f64 {
        triangles.iter().map(|t| triangle_winding(q, *t)).sum()
    }

    /// Triangles of a bumpy torus, so that clusters carry every moment.
    fn torus(n: usize, m: usize) -> Vec<[Vec3; 3]> {
        let point = |i: usize, j: usize| {
            let (u, v) = (
                (i % n) as f64 / n as f64 * std::f64::consts::TAU,
                (j % m) as f64 / m as f64 * std::f64::consts::TAU,
            );
            let r = 0.4 + 0.05 * (3.0 * u + v).sin();
            [(1.0 + r * v.cos()) * u.cos(), (1.0 + r * v.cos()) * u.sin(), r * v.sin()]
        };
        (0..n)
            .flat_map(|i| (0..m).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect()
    }

    #[test]
    fn sign_and_size_of_an_octant() {
        // One face of a regular octahedron subtends an eighth of the sphere.
        let face = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert!((triangle_winding([0.0; 3], face) - 0.125).abs() < 1e-15);
        assert!(triangle_winding([2.0; 3], face) < 0.0);
        assert_eq!(triangle_winding([0.5, 0.5, 0.0], face), 0.0);
    }

    #[test]
    fn closed_surface_is_one_inside_and_zero_outside() {
        let tree = WindingTree::build(&torus(60, 30));
        for (q, expected) in
            [([1.0, 0.0, 0.0], 1.0), ([0.0, 0.0, 0.0], 0.0), ([0.0, 1.2, 0.1], 1.0), ([5.0, 5.0, 5.0], 0.0)]
        {
            assert!((tree.at(q) - expected).abs() < 2e-3, "{q:?}: {}", tree.at(q));
        }
    }

    #[test]
    fn no_triangles_wind_around_nothing() {
        assert_eq!(WindingTree::build(&[]).at([1.0, 2.0, 3.0]), 0.0);
    }

    proptest! {
        // Stated tolerance: 0.002 in winding number with whatever triangles are missing.
        #[test]
        fn hierarchy_agrees_with_the_exact_sum(
            q in prop::array::uniform3(-2.5..2.5f64),
            missing in prop::collection::vec(any::<bool>(), 50),
        ) {
            let triangles: Vec<_> = torus(40, 20)
                .into_iter()
                .enumerate()
                .filter(|(i, _)| !missing[i / 5 % missing.len()])
                .map(|(_, t)| t)
                .collect();
            let (fast, exact) = (WindingTree::build(&triangles).at(q), brute(q, &triangles));
            prop_assert!((fast - exact).abs() < 2e-3, "{fast} against {exact}");
        }

        #[test]
        fn hierarchy_agrees_on_a_soup(
            soup in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-1.0..1.0f64)), 1..200),
            q in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let (fast, exact) = (WindingTree::build(&soup).at(q), brute(q, &soup));
            // Each expanded cluster errs by a share of its own solid angle, so the bound grows
            // with the soup's.
            let total: f64 = soup.iter().map(|t| triangle_winding(q, *t).abs()).sum();
            prop_assert!((fast - exact).abs() < 2e-3 + 2e-3 * total, "{fast} against {exact}");
        }
    }
}
