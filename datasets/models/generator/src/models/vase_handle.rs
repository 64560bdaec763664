//! A painted jug, solid, with a thin handle.

use std::f64::consts::PI;

use crate::Model;
use crate::image::{Image, Rect, Rgb, paint};
use crate::sheet::{Curve, Ends, quarter_turn, sheet, tube_point};
use crate::vec3::{V3, smoothstep};

/// The outline as radius and height, from the middle of the foot to the middle of the top.
const OUTLINE: [[f64; 2]; 17] = [
    [0.0, 0.0],
    [6.2, 0.0],
    [7.4, 0.5],
    [7.6, 1.6],
    [9.6, 5.0],
    [11.9, 9.5],
    [12.6, 14.0],
    [11.6, 18.6],
    [9.0, 22.8],
    [7.1, 26.2],
    [6.6, 29.0],
    [7.3, 32.6],
    [8.8, 36.4],
    [9.1, 37.6],
    [8.5, 38.2],
    [5.0, 37.2],
    [0.0, 36.9],
];
/// Height of the rim.
const RIM: f64 = 36.4;

/// The outline at a fraction of its length: radius, height and whether it is past the rim.
struct Lathe(Curve);

impl Lathe {
    fn new() -> Self {
        Self(Curve::new(&OUTLINE.map(|[r, z]| [r, 0.0, z]), false))
    }

    fn outline(&self, v: f64) -> (f64, f64, bool) {
        let p = self.0.at(v);
        (p[0].max(0.0), p[2], v > 0.5 && p[2] > RIM)
    }

    /// The spout draws the rim out towards -x.
    fn point(&self, u: f64, v: f64) -> V3 {
        let (r, z, _) = self.outline(v);
        let angle = 2.0 * PI * u;
        let towards = libm::pow((1.0 - libm::cos(angle)) / 2.0, 6.0);
        let lip = smoothstep(28.0, 38.0, z) * towards * (r / 9.0);
        let r = r + 4.0 * lip;
        [r * libm::cos(angle), r * libm::sin(angle), z + 2.0 * lip]
    }
}

/// A flower around the origin of (x, y) millimetres, or `None` outside it.
fn flower(x: f64, y: f64) -> Option<Rgb> {
    let r = (x * x + y * y).sqrt();
    let lobe = |n: f64, phase: f64| libm::cos(n / 2.0 * (libm::atan2(y, x) - phase)).abs();
    if r < 1.2 {
        Some(paint::OCHRE)
    } else if r < 1.75 {
        Some(paint::CHARCOAL)
    } else if r < 3.3 * (0.45 + 0.55 * lobe(6.0, PI / 6.0)) {
        Some(paint::ROSE)
    } else if r < 5.2 * (0.40 + 0.60 * lobe(6.0, 0.0)) {
        Some(paint::BRICK)
    } else {
        None
    }
}

/// Leaves and berries between two flowers, around the origin of (x, y) millimetres.
fn sprig(x: f64, y: f64) -> Option<Rgb> {
    let leaf = |cx: f64, cy: f64, slope: f64| {
        let (dx, dy) = (x.abs() - cx, y - cy);
        let (along, across) = (dx * 0.6 + dy * slope, -dx * slope + dy * 0.6);
        (along / 2.4) * (along / 2.4) + (across / 1.0) * (across / 1.0) < 1.0
    };
    let berry = |cx: f64, cy: f64, r: f64| (x.abs() - cx) * (x.abs() - cx) + (y - cy) * (y - cy) < r * r;
    if berry(0.0, 5.6, 0.9) || berry(0.0, -5.6, 0.9) || berry(2.3, -5.2, 0.7) || berry(2.3, 5.2, 0.7) {
        Some(paint::INDIGO)
    } else if (x.abs() < 0.3 && y.abs() < 4.6) || leaf(1.3, 2.6, 0.8) || leaf(1.3, -1.8, 0.8) {
        Some(paint::LEAF)
    } else {
        None
    }
}

/// The painted body at the fraction `u` around, radius `r` and height `z`.
fn body(u: f64, r: f64, z: f64, top: bool) -> Rgb {
    /// A repeating pattern's place in 0..1 within one of `n` repeats.
    fn repeat(u: f64, n: f64) -> f64 {
        (u * n).rem_euclid(1.0)
    }
    if top {
        return if r < 5.6 { paint::BRICK } else { paint::INDIGO };
    }
    match z {
        _ if z < 1.6 => paint::INDIGO,
        _ if z < 2.3 => paint::CREAM,
        _ if z < 5.0 => {
            // Triangles standing on the foot.
            let t = repeat(u, 20.0);
            let tooth = 1.0 - (2.0 * t - 1.0).abs();
            if (z - 2.3) / 2.7 < tooth { paint::BRICK } else { paint::CREAM }
        }
        _ if z < 5.8 => paint::INDIGO,
        _ if z < 21.6 => {
            let t = repeat(u, 5.0);
            let width = 2.0 * PI * r / 5.0;
            // The slope of the belly stretches a step in height along the surface.
            let y = (z - 13.6) * 1.08;
            let between = repeat(t + 0.5, 1.0) - 0.5;
            flower((t - 0.5) * width, y).or_else(|| sprig(between * width, y)).unwrap_or(paint::CREAM)
        }
        _ if z < 22.4 => paint::INDIGO,
        _ if z < 23.0 => paint::CREAM,
        _ if z < 26.4 => {
            // A stepped key.
            let t = repeat(u, 12.0);
            let y = (z - 23.0) / 3.4;
            let on =
                y > 0.82 || (t < 0.22) || (y < 0.22 && t < 0.75) || ((0.55..0.75).contains(&t) && y < 0.6);
            if on { paint::INDIGO } else { paint::OCHRE }
        }
        _ if z < 27.0 => paint::CREAM,
        _ if z < 27.8 => paint::INDIGO,
        _ if z < 34.6 => {
            // Upright leaves.
            let t = repeat(u, 12.0);
            let y = (z - 27.8) / 6.8;
            let half = 0.40 * libm::sin(PI * y.clamp(0.0, 1.0));
            let from_middle = (t - 0.5).abs();
            if from_middle < 0.045 {
                paint::CREAM
            } else if from_middle < half {
                paint::LEAF
            } else {
                paint::CREAM
            }
        }
        _ => paint::INDIGO,
    }
}

pub fn model() -> Model {
    let lathe = Lathe::new();
    let mut image = Image::new(1024, 832, paint::CREAM);
    let wall = Rect { x: 0, y: 0, width: 1024, height: 792 };
    let strip = Rect { x: 0, y: 792, width: 1024, height: 40 };
    image.paint(wall, |u, v| {
        let (r, z, top) = lathe.outline(v);
        body(u, r, z, top)
    });
    image.paint(strip, |u, _| {
        let t = (u * 18.0).rem_euclid(1.0);
        if t < 0.3 { paint::CREAM } else { paint::INDIGO }
    });
    let mut part = sheet(64, 52, Ends::Poles, &image, wall, |u, v| lathe.point(u, v));
    let knots = [
        [7.6, 0.0, 34.6],
        [11.5, 0.0, 36.6],
        [16.0, 0.0, 33.0],
        [17.2, 0.0, 26.5],
        [14.6, 0.0, 19.6],
        [10.8, 0.0, 16.6],
    ];
    let curve = Curve::new(&knots, false);
    let radius = |t: f64| 1.25 + 0.15 * (2.0 * t - 1.0) * (2.0 * t - 1.0);
    let mut handle = sheet(14, 44, Ends::Poles, &image, strip, |u, v| {
        tube_point(&curve, Ends::Poles, [0.0, 1.0, 0.0], radius, u, v)
    });
    quarter_turn(&mut handle, &image, strip);
    part.append(handle);
    Model { name: "vase-handle", part, texture: image, view: -20.0 }
}
