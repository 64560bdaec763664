//! A 0.5 mm slab with a picture on each side.

use std::f64::consts::PI;

use crate::Model;
use crate::image::{Image, Rect, Rgb, paint};
use crate::sheet::box_part;

const EDGE: f64 = 30.0;
const THICKNESS: f64 = 0.5;
const PIXELS: usize = 600;

/// A sailing boat: x and y from -1 to 1, y up.
fn boat(x: f64, y: f64) -> Rgb {
    if x.abs() > 0.94 || y.abs() > 0.94 {
        return paint::INDIGO;
    }
    if x.abs() > 0.9 || y.abs() > 0.9 {
        return paint::CREAM;
    }
    let wave = |phase: f64| 0.05 * libm::sin(9.0 * x + phase);
    let hull = y > -0.46 && y < -0.22 && x > -0.5 + 0.5 * (y + 0.22) && x < 0.55 + 0.9 * (y + 0.22);
    let main_sail = x > 0.04 && y > -0.14 && x < 0.04 + 0.46 * (1.0 - (y + 0.14) / 0.86);
    let fore_sail = x < -0.03 && y > -0.14 && x > -0.03 - 0.34 * (1.0 - (y + 0.14) / 0.66);
    let mast = (-0.03..=0.04).contains(&x) && y > -0.25 && y < 0.78;
    if y < -0.7 + wave(2.0) {
        return paint::INDIGO;
    }
    if y < -0.42 + wave(0.0) && !(hull && y > -0.40 + wave(0.0)) {
        return if (y - wave(0.0)).rem_euclid(0.12) < 0.04 { paint::WHITE } else { [58, 128, 176] };
    }
    if hull {
        return if y > -0.29 { paint::WHITE } else { paint::BRICK };
    }
    if mast {
        return paint::BROWN;
    }
    if main_sail {
        return if (y + 0.14).rem_euclid(0.2) < 0.05 { paint::ORANGE } else { paint::CREAM };
    }
    if fore_sail {
        return paint::ROSE;
    }
    let (sx, sy) = (x + 0.55, y - 0.5);
    let r = (sx * sx + sy * sy).sqrt();
    if r < 0.2 {
        return paint::OCHRE;
    }
    let ray = (libm::atan2(sy, sx) / (2.0 * PI) * 14.0).rem_euclid(1.0) < 0.4;
    if r > 0.24 && r < 0.36 && ray {
        return paint::OCHRE;
    }
    [176, 214, 230]
}

/// A rosette: x and y from -1 to 1.
fn rosette(x: f64, y: f64) -> Rgb {
    let r = (x * x + y * y).sqrt();
    let turn = |n: f64, phase: f64| libm::cos(n * libm::atan2(y, x) + phase).abs();
    if x.abs().max(y.abs()) > 0.94 {
        return paint::BRICK;
    }
    let rings: [(f64, Rgb); 6] = [
        (0.12, paint::OCHRE),
        (0.16, paint::CHARCOAL),
        (0.22 + 0.16 * turn(4.0, 0.0), paint::PLUM),
        (0.36 + 0.20 * turn(4.0, PI / 2.0), paint::ROSE),
        (0.56 + 0.16 * turn(6.0, 0.0), paint::LEAF),
        (0.66 + 0.20 * turn(12.0, 0.0), paint::OCHRE),
    ];
    if let Some((_, color)) = rings.iter().find(|(edge, _)| r < *edge) {
        return *color;
    }
    let dots = [x.abs() - 0.78, y.abs() - 0.78];
    if dots[0] * dots[0] + dots[1] * dots[1] < 0.01 { paint::INDIGO } else { paint::CREAM }
}

pub fn model() -> Model {
    let mut image = Image::new(2 * PIXELS, PIXELS + 4, paint::CREAM);
    let front = Rect { x: 0, y: 0, width: PIXELS, height: PIXELS };
    let back = Rect { x: PIXELS, ..front };
    let edge = Rect { x: 0, y: PIXELS, width: 2 * PIXELS, height: 4 };
    image.paint(front, |u, v| boat(2.0 * u - 1.0, 2.0 * v - 1.0));
    image.paint(back, |u, v| rosette(2.0 * u - 1.0, 2.0 * v - 1.0));
    let corners = std::array::from_fn(|k| {
        [
            if k & 1 == 1 { EDGE } else { 0.0 },
            if k & 2 == 2 { THICKNESS } else { 0.0 },
            if k & 4 == 4 { EDGE } else { 0.0 },
        ]
    });
    Model { name: "plane", part: box_part(corners, &image, front, back, edge), texture: image, view: -20.0 }
}
