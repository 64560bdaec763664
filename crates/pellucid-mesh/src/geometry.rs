//! Small vector and box arithmetic in f64.

/// A point or vector `[x, y, z]`.
pub(crate) type Vec3 = [f64; 3];

pub(crate) fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: Vec3, s: f64) -> Vec3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

pub(crate) fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn length(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// Normal of a triangle with length equal to its area, by the right-hand rule.
pub(crate) fn area_vector([a, b, c]: [Vec3; 3]) -> Vec3 {
    scale(cross(sub(b, a), sub(c, a)), 0.5)
}

/// Whether a triangle has an area beyond the rounding of its corners: not collapsed to a line.
pub(crate) fn has_area([a, b, c]: [Vec3; 3]) -> bool {
    let edges = [sub(b, a), sub(c, b), sub(a, c)];
    let longest2 = edges.map(|e| dot(e, e)).into_iter().fold(0.0, f64::max);
    length(cross(edges[0], edges[1])) > 1e-12 * longest2
}

/// The mean of a triangle's corners.
pub(crate) fn centroid([a, b, c]: [Vec3; 3]) -> Vec3 {
    scale(add(add(a, b), c), 1.0 / 3.0)
}

/// Barycentric weights of the point of a triangle nearest to `p` (Ericson, Real-Time Collision
/// Detection, 5.1.5, by Voronoi regions), and its squared distance.
pub(crate) fn nearest_on_triangle(p: Vec3, [a, b, c]: [Vec3; 3]) -> ([f64; 3], f64) {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    let (va, vb, vc) = (d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2);
    let weights = if d1 <= 0.0 && d2 <= 0.0 {
        [1.0, 0.0, 0.0]
    } else if d3 >= 0.0 && d4 <= d3 {
        [0.0, 1.0, 0.0]
    } else if d6 >= 0.0 && d5 <= d6 {
        [0.0, 0.0, 1.0]
    } else if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let v = ratio(d1, d1 - d3);
        [1.0 - v, v, 0.0]
    } else if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let w = ratio(d2, d2 - d6);
        [1.0 - w, 0.0, w]
    } else if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let w = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        [0.0, 1.0 - w, w]
    } else {
        let sum = va + vb + vc;
        let (v, w) = (ratio(vb, sum), ratio(vc, sum));
        [1.0 - v - w, v, w]
    };
    let q = std::array::from_fn(|k| weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]);
    let d = sub(p, q);
    (weights, dot(d, d))
}

/// Where the line `from + t way` meets a triangle: t and barycentric weights. Points up to a
/// rounding error outside count, so that no line slips between two triangles. (Möller and Trumbore
/// 1997.)
pub(crate) fn line_meets_triangle(from: Vec3, way: Vec3, [a, b, c]: [Vec3; 3]) -> Option<(f64, [f64; 3])> {
    const SLACK: f64 = 1e-9;
    let (e1, e2, offset) = (sub(b, a), sub(c, a), sub(from, a));
    let p = cross(way, e2);
    let determinant = dot(e1, p);
    if determinant == 0.0 {
        return None;
    }
    let q = cross(offset, e1);
    let (u, v) = (dot(offset, p) / determinant, dot(way, q) / determinant);
    let inside = u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK;
    inside.then(|| (dot(e2, q) / determinant, [1.0 - u - v, u, v]))
}

/// `a / b`, and 0 where a degenerate triangle makes `b` zero.
fn ratio(a: f64, b: f64) -> f64 {
    if b == 0.0 { 0.0 } else { a / b }
}

/// An axis-aligned box, empty when `min > max`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub min: Vec3,
    pub max: Vec3,
}

impl Bounds {
    pub const EMPTY: Self = Self { min: [f64::INFINITY; 3], max: [f64::NEG_INFINITY; 3] };

    pub fn of(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| b.joined(&Self { min: p, max: p }))
    }

    pub fn joined(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|k| self.min[k].min(other.min[k])),
            max: std::array::from_fn(|k| self.max[k].max(other.max[k])),
        }
    }

    pub fn extent(&self) -> Vec3 {
        sub(self.max, self.min)
    }

    pub fn centre(&self) -> Vec3 {
        scale(add(self.min, self.max), 0.5)
    }

    /// Half of the surface area; 0 when empty.
    pub fn half_area(&self) -> f64 {
        let [x, y, z] = self.extent().map(|e| e.max(0.0));
        x * y + y * z + z * x
    }

    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|k| self.min[k] <= other.max[k] && other.min[k] <= self.max[k])
    }

    /// Squared distance between two boxes, 0 where they overlap.
    pub fn distance2(&self, other: &Self) -> f64 {
        let gaps: Vec3 =
            std::array::from_fn(|k| (self.min[k] - other.max[k]).max(other.min[k] - self.max[k]).max(0.0));
        dot(gaps, gaps)
    }

    /// Squared distance to a point, 0 inside.
    pub fn distance2_to(&self, p: Vec3) -> f64 {
        self.distance2(&Self { min: p, max: p })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nearest_point_beats_every_sampled_point(
            corners in prop::array::uniform3(prop::array::uniform3(-2.0..2.0f64)),
            p in prop::array::uniform3(-4.0..4.0f64),
        ) {
            let (weights, d2) = nearest_on_triangle(p, corners);
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            prop_assert!(weights.iter().all(|&w| (-1e-12..=1.0 + 1e-12).contains(&w)));
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let (u, v) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                    let q: Vec3 = std::array::from_fn(|k| {
                        u * corners[0][k] + v * corners[1][k] + (1.0 - u - v) * corners[2][k]
                    });
                    let d = sub(p, q);
                    prop_assert!(d2 <= dot(d, d) + 1e-9);
                }
            }
        }
    }

    proptest! {
        #[test]
        fn a_line_through_a_point_of_a_triangle_meets_it_there(
            corners in prop::array::uniform3(prop::array::uniform3(-2.0..2.0f64)),
            from in prop::array::uniform3(-4.0..4.0f64),
            weights in prop::array::uniform2(0.0..1.0f64),
            beyond in -0.5..-0.01f64,
        ) {
            let (u, v) = (weights[0], weights[1] * (1.0 - weights[0]));
            let at = |u: f64, v: f64| -> Vec3 {
                std::array::from_fn(|k| u * corners[1][k] + v * corners[2][k] + (1.0 - u - v) * corners[0][k])
            };
            let way = sub(at(u, v), from);
            let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
            prop_assume!(dot(normal, way).abs() > 1e-3);
            let (t, found) = line_meets_triangle(from, way, corners).unwrap();
            prop_assert!((t - 1.0).abs() < 1e-6 && (found[1] - u).abs() < 1e-6 && (found[2] - v).abs() < 1e-6);
            prop_assert!(line_meets_triangle(from, sub(at(beyond, v), from), corners).is_none());
        }
    }

    #[test]
    fn collapsed_triangles_have_no_area() {
        let turned = |t: f64| [0.3 + 0.1 * t, 0.7 * t - 5.0, 0.9 - t / 3.0];
        assert!(!has_area([turned(0.0), turned(0.1), turned(0.7)]));
        assert!(!has_area([[1.0, 2.0, 3.0]; 3]));
        assert!(!has_area([[1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [4.0, 2.0, 3.0]]));
        assert!(has_area([[0.0; 3], [1.0, 0.0, 0.0], [0.5, 1e-9, 0.0]]));
        assert!(has_area([[0.0; 3], [1e-9, 0.0, 0.0], [0.0, 1e-9, 0.0]]));
    }

    #[test]
    fn a_degenerate_triangle_is_a_segment_or_a_point() {
        let p = [1.0, 2.0, 0.0];
        let (_, d2) = nearest_on_triangle(p, [[0.0; 3], [4.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        assert!((d2 - 4.0).abs() < 1e-12, "{d2}");
        let (_, d2) = nearest_on_triangle(p, [[1.0, 0.0, 0.0]; 3]);
        assert!((d2 - 4.0).abs() < 1e-12, "{d2}");
    }
}
