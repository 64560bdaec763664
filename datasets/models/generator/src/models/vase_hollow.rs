//! A hollow red vase: a wall of 1.8 mm, waves outside, bands inside.

use std::f64::consts::PI;

use crate::Model;
use crate::image::{Image, Rect, Rgb, paint};
use crate::sheet::{Curve, Ends, sheet};
use crate::vec3::V3;

/// The outside as radius and height, from the middle of the foot to the rim.
const OUTSIDE: [[f64; 2]; 12] = [
    [0.0, 0.0],
    [8.0, 0.0],
    [9.4, 0.9],
    [10.6, 3.6],
    [13.6, 9.0],
    [15.6, 16.0],
    [15.0, 23.0],
    [11.6, 30.0],
    [8.2, 36.0],
    [7.6, 41.0],
    [9.4, 46.4],
    [11.6, 49.4],
];
/// The inside, from the rim to the middle of the floor: 1.8 mm within the outside.
const INSIDE: [[f64; 2]; 10] = [
    [11.4, 50.0],
    [10.3, 49.4],
    [7.8, 46.2],
    [5.8, 41.0],
    [6.4, 35.2],
    [9.9, 29.2],
    [13.2, 22.6],
    [13.8, 16.2],
    [11.6, 9.6],
    [0.0, 3.0],
];

/// Overlapping scales of five rings, as (x, y) in scale widths.
fn scales(x: f64, y: f64) -> Rgb {
    // The topmost scale over a point is the lowest row whose disc covers it.
    let base = (2.0 * y).floor();
    for step in [-1.0, 0.0, 1.0] {
        let row = base + step - 1.0;
        let shift = if row.rem_euclid(2.0) == 0.0 { 0.0 } else { 0.5 };
        let cx = (x - shift).round() + shift;
        let (dx, dy) = (x - cx, y - row / 2.0);
        let r = (dx * dx + dy * dy).sqrt();
        if r < 0.5 * 1.16 && dy >= -0.6 {
            return match (r * 10.0) as u32 {
                0 | 1 => paint::OCHRE,
                2 => paint::CREAM,
                3 => paint::BRICK,
                4 => paint::CREAM,
                _ => paint::BRICK,
            };
        }
    }
    paint::BRICK
}

fn color(u: f64, z: f64, inside: bool) -> Rgb {
    if inside {
        let band = z > 46.5 || (43.0..44.0).contains(&z);
        return if band { paint::INDIGO } else { paint::CREAM };
    }
    match z {
        _ if z < 2.2 => paint::CHARCOAL,
        _ if z < 3.4 => paint::OCHRE,
        _ if z < 31.0 => scales(u * 16.0, (z - 3.4) / 5.2),
        _ if z < 32.0 => paint::OCHRE,
        _ if z < 33.0 => paint::CHARCOAL,
        _ if z < 44.0 => {
            let diagonal = (u * 14.0 + (z - 33.0) / 6.0).rem_euclid(1.0);
            let other = (u * 14.0 - (z - 33.0) / 6.0).rem_euclid(1.0);
            if diagonal < 0.14 || other < 0.14 { paint::OCHRE } else { [168, 52, 58] }
        }
        _ if z < 45.0 => paint::CHARCOAL,
        _ if z < 46.0 => paint::OCHRE,
        _ => paint::BRICK,
    }
}

pub fn model() -> Model {
    let knots: Vec<V3> = OUTSIDE.iter().chain(&INSIDE).map(|&[r, z]| [r, 0.0, z]).collect();
    let outline = Curve::new(&knots, false);
    let rim = (0..=2000)
        .map(|k| f64::from(k) / 2000.0)
        .max_by(|&a, &b| outline.at(a)[2].total_cmp(&outline.at(b)[2]));
    let rim = rim.unwrap_or(0.5);
    let (width, height) = (1024, 1024);
    let mut image = Image::new(width, height, paint::CREAM);
    let rect = Rect { x: 0, y: 0, width, height };
    image.paint(rect, |u, v| color(u, outline.at(v)[2], v > rim));
    let part = sheet(56, 76, Ends::Poles, &image, rect, |u, v| {
        let p = outline.at(v);
        let (r, angle) = (p[0].max(0.0), 2.0 * PI * u);
        [r * libm::cos(angle), r * libm::sin(angle), p[2]]
    });
    Model { name: "vase-hollow", part, texture: image, view: 0.0 }
}
