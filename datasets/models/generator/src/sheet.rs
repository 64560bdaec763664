//! Patches parametrised by (u, v): lathes, tubes, boxes.

use std::f64::consts::PI;

use crate::image::{Image, Rect};
use crate::part::Part;
use crate::vec3::{V3, add, cross, dot, scale, sub, unit};

/// How a sheet closes along v; along u it always wraps.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Ends {
    /// v = 0 and v = 1 are single points.
    Poles,
    /// v wraps too: a ring.
    Ring,
}

/// Meshes the surface `point(u, v)` with `cols` x `rows` quads, mapped to `rect` of `image`.
pub fn sheet(
    cols: u32,
    rows: u32,
    ends: Ends,
    image: &Image,
    rect: Rect,
    point: impl Fn(f64, f64) -> V3,
) -> Part {
    let mut part = Part::default();
    let mut ring = |j: u32| {
        let start = part.positions.len() as u32;
        let v = f64::from(j) / f64::from(rows);
        let pole = ends == Ends::Poles && (j == 0 || j == rows);
        // The seam and the wrapped end repeat the very same positions, so they weld.
        let turn = if ends == Ends::Ring { f64::from(j % rows) / f64::from(rows) } else { v };
        for i in 0..=cols - u32::from(pole) {
            let around = if pole { 0.0 } else { f64::from(i % cols) / f64::from(cols) };
            let u = (f64::from(i) + if pole { 0.5 } else { 0.0 }) / f64::from(cols);
            part.positions.push(point(around, turn));
            part.uv.push(image.uv(rect, u, v));
        }
        (start, pole)
    };
    let rings: Vec<_> = (0..=rows).map(&mut ring).collect();
    for pair in rings.windows(2) {
        let ((a, lower_pole), (b, upper_pole)) = (pair[0], pair[1]);
        for i in 0..cols {
            match (lower_pole, upper_pole) {
                (true, _) => part.triangles.push([a + i, b + i + 1, b + i]),
                (_, true) => part.triangles.push([a + i, a + i + 1, b + i]),
                _ => {
                    part.triangles.push([a + i, a + i + 1, b + i + 1]);
                    part.triangles.push([a + i, b + i + 1, b + i]);
                }
            }
        }
    }
    part.outward()
}

/// A smooth curve through points (Catmull-Rom), sampled by arc length.
pub struct Curve {
    points: Vec<V3>,
    lengths: Vec<f64>,
}

impl Curve {
    /// Through `knots`; `closed` joins the last to the first.
    pub fn new(knots: &[V3], closed: bool) -> Self {
        const STEPS: usize = 24;
        let n = knots.len();
        let at = |i: isize| {
            let i = if closed { i.rem_euclid(n as isize) } else { i.clamp(0, n as isize - 1) };
            knots[i as usize]
        };
        let spans = if closed { n } else { n - 1 };
        let mut points = vec![knots[0]];
        for s in 0..spans as isize {
            let [p0, p1, p2, p3] = [at(s - 1), at(s), at(s + 1), at(s + 2)];
            for k in 1..=STEPS {
                let t = k as f64 / STEPS as f64;
                points.push(std::array::from_fn(|a| {
                    let (m1, m2) = ((p2[a] - p0[a]) / 2.0, (p3[a] - p1[a]) / 2.0);
                    let (t2, t3) = (t * t, t * t * t);
                    (2.0 * t3 - 3.0 * t2 + 1.0) * p1[a]
                        + (t3 - 2.0 * t2 + t) * m1
                        + (3.0 * t2 - 2.0 * t3) * p2[a]
                        + (t3 - t2) * m2
                }));
            }
        }
        let mut lengths = vec![0.0];
        for pair in points.windows(2) {
            lengths.push(lengths[lengths.len() - 1] + crate::vec3::length(sub(pair[1], pair[0])));
        }
        Self { points, lengths }
    }

    /// Arc length.
    pub fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// The point at a fraction of the arc length.
    pub fn at(&self, t: f64) -> V3 {
        let s = t.clamp(0.0, 1.0) * self.length();
        let i = self.lengths.partition_point(|&l| l <= s).clamp(1, self.points.len() - 1);
        let span = self.lengths[i] - self.lengths[i - 1];
        let f = if span > 0.0 { (s - self.lengths[i - 1]) / span } else { 0.0 };
        add(self.points[i - 1], scale(sub(self.points[i], self.points[i - 1]), f))
    }

    /// Unit tangent at a fraction of the arc length.
    pub fn tangent(&self, t: f64) -> V3 {
        let h = 1e-3;
        unit(sub(self.at(t + h), self.at(t - h)))
    }
}

/// The surface of a tube around a curve in a frame that keeps `side` (never along the curve) as its
/// reference: `point(u, v)` with round caps for an open curve.
pub fn tube_point(curve: &Curve, ends: Ends, side: V3, radius: impl Fn(f64) -> f64, u: f64, v: f64) -> V3 {
    let angle = 2.0 * PI * u;
    // The caps take the share of v that their arc has of the whole length.
    let length = curve.length();
    let cap = match ends {
        Ends::Ring => 0.0,
        Ends::Poles => PI / 2.0 * radius(0.0) / (length + PI * radius(0.0)),
    };
    let (t, lift, shrink) = if v < cap {
        let phi = PI / 2.0 * (1.0 - v / cap);
        (0.0, -libm::sin(phi), libm::cos(phi))
    } else if v > 1.0 - cap {
        let phi = PI / 2.0 * (1.0 - (1.0 - v) / cap);
        (1.0, libm::sin(phi), libm::cos(phi))
    } else {
        ((v - cap) / (1.0 - 2.0 * cap), 0.0, 1.0)
    };
    let axis = match ends {
        Ends::Ring if !(1e-3..=1.0 - 1e-3).contains(&t) => unit(sub(curve.at(1e-3), curve.at(1.0 - 1e-3))),
        _ => curve.tangent(t),
    };
    let a = unit(sub(side, scale(axis, dot(side, axis))));
    let b = cross(axis, a);
    let r = radius(t);
    let around = add(scale(a, r * shrink * libm::cos(angle)), scale(b, r * shrink * libm::sin(angle)));
    add(add(curve.at(t), scale(axis, r * lift)), around)
}

/// A solid with eight corners: `corners[k]` at bit 0 = +x, bit 1 = +y, bit 2 = +z. The faces -y and
/// +y are mapped to `front` and `back`, upright as seen from outside; the others to the middle of
/// `edge`.
pub fn box_part(corners: [V3; 8], image: &Image, front: Rect, back: Rect, edge: Rect) -> Part {
    let mut part = Part::default();
    // Counter-clockwise from the lower left, seen from outside.
    let faces = [
        ([0, 1, 5, 4], Some(front)),
        ([3, 2, 6, 7], Some(back)),
        ([1, 3, 7, 5], None),
        ([2, 0, 4, 6], None),
        ([4, 5, 7, 6], None),
        ([2, 3, 1, 0], None),
    ];
    for (face, rect) in faces {
        let base = part.positions.len() as u32;
        for (k, corner) in face.into_iter().enumerate() {
            let (u, v) = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)][k];
            part.positions.push(corners[corner]);
            part.uv.push(match rect {
                Some(rect) => image.uv(rect, u, v),
                None => image.uv(edge, 0.5, 0.5),
            });
        }
        part.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    }
    part
}

/// Turns a sheet's texture by a quarter within its rectangle: v then runs along the image's rows,
/// for long tubes in wide strips.
pub fn quarter_turn(part: &mut Part, image: &Image, rect: Rect) {
    let (lo, hi) = (image.uv(rect, 0.0, 0.0), image.uv(rect, 1.0, 1.0));
    for uv in &mut part.uv {
        let u = (uv[0] - lo[0]) / (hi[0] - lo[0]);
        let v = (uv[1] - lo[1]) / (hi[1] - lo[1]);
        *uv = image.uv(rect, v, u);
    }
}
