//! Polygons into triangles: a fan where the polygon is convex, else by cutting off ears.

use crate::geometry::{Vec3, cross, dot, sub};

/// Most corners of a polygon.
pub(super) const MAX_CORNERS: usize = 1 << 16;

/// Tests of a corner against a triangle that all polygons of a model may take together.
const MAX_TESTS: u64 = 1 << 28;

/// Cuts polygons; counts how much work the odd ones have taken.
pub(super) struct Cutter {
    tests: u64,
}

/// The polygons of a model are so large and concave that cutting them would take hours.
#[derive(Debug)]
pub(super) struct TooIntricate;

impl Cutter {
    pub fn new() -> Self {
        Self { tests: 0 }
    }

    /// Triangles of a polygon of three corners or more, as indices into `points`, in its sense of
    /// rotation.
    pub fn cut(&mut self, points: &[Vec3]) -> Result<Vec<[u32; 3]>, TooIntricate> {
        let count = points.len() as u32;
        if count > 3 && !is_convex(points) {
            return self.cut_ears(&flattened(points));
        }
        Ok((1..count.saturating_sub(1)).map(|i| [0, i, i + 1]).collect())
    }

    /// Ear clipping (Meisters 1975): a corner is cut off if its triangle holds no other corner.
    fn cut_ears(&mut self, points: &[[f64; 2]]) -> Result<Vec<[u32; 3]>, TooIntricate> {
        let mut left: Vec<u32> = (0..points.len() as u32).collect();
        let mut triangles = Vec::with_capacity(points.len());
        let (mut at, mut failed) = (0, 0);
        while left.len() > 3 {
            let n = left.len();
            let ear = [left[(at + n - 1) % n], left[at % n], left[(at + 1) % n]];
            // A polygon that crosses itself may have no ear: any corner will do then.
            if failed == n || self.is_ear(points, &left, ear)? {
                triangles.push(ear);
                left.remove(at % n);
                failed = 0;
                // The corner before may have become an ear; going back also avoids slivers.
                at = (at % n).saturating_sub(1);
            } else {
                at = (at + 1) % n;
                failed += 1;
            }
        }
        triangles.push([left[0], left[1], left[2]]);
        Ok(triangles)
    }

    fn is_ear(&mut self, points: &[[f64; 2]], left: &[u32], ear: [u32; 3]) -> Result<bool, TooIntricate> {
        let [a, b, c] = ear.map(|i| points[i as usize]);
        if side(a, b, c) <= 0.0 {
            return Ok(false);
        }
        self.tests += left.len() as u64;
        if self.tests > MAX_TESTS {
            return Err(TooIntricate);
        }
        Ok(!left.iter().any(|&i| {
            let p = points[i as usize];
            let corner = p == a || p == b || p == c;
            !corner && side(a, b, p) >= 0.0 && side(b, c, p) >= 0.0 && side(c, a, p) >= 0.0
        }))
    }
}

/// Twice the signed area of a triangle.
fn side(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Normal of a polygon by Newell's method.
fn normal(points: &[Vec3]) -> Vec3 {
    let origin = points[0];
    let mut sum = [0.0; 3];
    for pair in points.windows(2) {
        let area = cross(sub(pair[0], origin), sub(pair[1], origin));
        (0..3).for_each(|k| sum[k] += area[k]);
    }
    sum
}

/// Whether a polygon turns the same way at every corner.
fn is_convex(points: &[Vec3]) -> bool {
    let (n, up) = (points.len(), normal(points));
    (0..n).all(|i| {
        let (a, b, c) = (points[i], points[(i + 1) % n], points[(i + 2) % n]);
        dot(cross(sub(b, a), sub(c, b)), up) >= 0.0
    })
}

/// The polygon along the axis it faces most, so that it runs counter-clockwise.
fn flattened(points: &[Vec3]) -> Vec<[f64; 2]> {
    let up = normal(points);
    let axis = (0..3).max_by(|&a, &b| up[a].abs().total_cmp(&up[b].abs())).unwrap_or(2);
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let (u, v) = if up[axis] < 0.0 { (v, u) } else { (u, v) };
    points.iter().map(|p| [p[u], p[v]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{area_vector, length};
    use proptest::prelude::*;

    /// Area of the triangles, all of which must face the polygon's way.
    fn area(points: &[Vec3], triangles: &[[u32; 3]]) -> f64 {
        let up = normal(points);
        triangles
            .iter()
            .map(|t| {
                let area = area_vector(t.map(|i| points[i as usize]));
                assert!(dot(area, up) >= -1e-9, "{t:?} faces the other way");
                length(area)
            })
            .sum()
    }

    #[test]
    fn concave_polygons_keep_their_area() {
        // An L, in each plane and both ways round.
        let l = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        for axis in 0..3 {
            for reversed in [false, true] {
                // From each corner, so that the concave one is first too.
                for start in 0..6 {
                    let mut points: Vec<Vec3> = (0..6)
                        .map(|i| {
                            let [u, v] = l[(i + start) % 6];
                            let mut p = [7.0; 3];
                            p[(axis + 1) % 3] = u;
                            p[(axis + 2) % 3] = v;
                            p
                        })
                        .collect();
                    if reversed {
                        points.reverse();
                    }
                    let triangles = Cutter::new().cut(&points).unwrap();
                    assert_eq!(triangles.len(), 4);
                    assert!((area(&points, &triangles) - 4.0).abs() < 1e-9, "{triangles:?}");
                }
            }
        }
    }

    #[test]
    fn work_is_bounded() {
        // A comb, of which few corners are ears.
        let comb = (0..20_000).map(|i| [f64::from(i / 2), f64::from(i % 2) * 50.0, 0.0]);
        let mut points: Vec<Vec3> = comb.collect();
        points.push([10_000.0, 1e4, 0.0]);
        points.push([0.0, 1e4, 0.0]);
        let mut cutter = Cutter::new();
        while let Ok(triangles) = cutter.cut(&points) {
            assert_eq!(triangles.len(), points.len() - 2);
        }
        assert!(cutter.tests < MAX_TESTS + points.len() as u64 + 1);
    }

    proptest! {
        #[test]
        fn star_shaped_polygons_keep_their_area(radii in prop::collection::vec(0.2..3.0f64, 4..40)) {
            let n = radii.len();
            let points: Vec<Vec3> = radii.iter().enumerate().map(|(i, r)| {
                let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
                [r * cos, r * sin, 0.3 * r * cos - 0.2 * r * sin]
            }).collect();
            let triangles = Cutter::new().cut(&points).unwrap();
            prop_assert_eq!(triangles.len(), n - 2);
            let whole = 0.5 * length(normal(&points));
            prop_assert!((area(&points, &triangles) - whole).abs() < 1e-9 * whole.max(1.0));
        }

        #[test]
        fn any_points_at_all_are_cut(points in prop::collection::vec(
            prop::array::uniform3(prop_oneof![-2.0..2.0f64, Just(0.0), Just(1.0), Just(1e300)]), 3..30)) {
            let triangles = Cutter::new().cut(&points).unwrap();
            prop_assert_eq!(triangles.len(), points.len() - 2);
            prop_assert!(triangles.as_flattened().iter().all(|&i| (i as usize) < points.len()));
        }
    }
}
