//! Three thin eight-pointed star bands across each other: constant thickness in every direction,
//! and closed loops.

use std::f64::consts::PI;

use crate::Model;
use crate::image::{Image, Rect, Rgb, paint};
use crate::part::Part;
use crate::sheet::{Ends, quarter_turn, sheet};
use crate::vec3::{V3, unit};

/// Thickness and width of the bands in millimetres.
const THICKNESS: f64 = 1.2;
const WIDTH: f64 = 5.0;
/// Mean radius of the stars and the height of their points over it.
const MEAN: f64 = 13.56;
const POINT: f64 = 2.0;

/// The middle of a band at `v` of a turn, in the star's own plane, and its outward normal there.
fn star(v: f64) -> ([f64; 2], [f64; 2]) {
    let angle = 2.0 * PI * v;
    // The bands cross where they come nearest to the middle.
    let r = MEAN - POINT * libm::cos(8.0 * angle);
    let slope = 8.0 * POINT * libm::sin(8.0 * angle);
    let (c, s) = (libm::cos(angle), libm::sin(angle));
    let tangent = [slope * c - r * s, slope * s + r * c];
    let n = unit([tangent[1], -tangent[0], 0.0]);
    ([r * c, r * s], [n[0], n[1]])
}

/// A band's surface in its own plane: x and y in the plane, z across.
fn band(u: f64, v: f64) -> V3 {
    let (middle, normal) = star(v);
    // Around the section: a stadium of the given thickness and width.
    let straight = WIDTH - THICKNESS;
    let round = PI * THICKNESS / 2.0;
    let s = u * 2.0 * (straight + round);
    let cap = |s: f64, side: f64| {
        let phi = s / round * PI;
        (side * libm::cos(phi) * THICKNESS / 2.0, side * (straight / 2.0 + libm::sin(phi) * THICKNESS / 2.0))
    };
    let (out, across) = if s < straight {
        (THICKNESS / 2.0, s - straight / 2.0)
    } else if s < straight + round {
        cap(s - straight, 1.0)
    } else if s < 2.0 * straight + round {
        (-THICKNESS / 2.0, straight / 2.0 - (s - straight - round))
    } else {
        cap(s - 2.0 * straight - round, -1.0)
    };
    [middle[0] + out * normal[0], middle[1] + out * normal[1], across]
}

fn color(u: f64, v: f64, hues: [Rgb; 4]) -> Rgb {
    // 0 at a crossing, 1 at a point of the star.
    let point = (1.0 - libm::cos(16.0 * PI * v)) / 2.0;
    let hue = hues[(8.0 * v) as usize % 4];
    let across = band(u, v)[2] / WIDTH * 2.0;
    if point > 0.55 {
        // A white diamond on every point.
        if (1.0 - point) / 0.12 + across.abs() / 0.5 < 1.0 { paint::WHITE } else { hue }
    } else if point > 0.40 {
        paint::WHITE
    } else if point > 0.30 {
        hue
    } else {
        paint::WHITE
    }
}

pub fn model() -> Model {
    use paint::{BRICK, INDIGO, LEAF, MINT, OCHRE, ORANGE, PLUM, ROSE, SKY};
    let hues = [[BRICK, OCHRE, LEAF, INDIGO], [ORANGE, SKY, PLUM, MINT], [ROSE, INDIGO, OCHRE, LEAF]];
    let (width, height) = (1280, 80);
    let mut image = Image::new(width, 3 * height, paint::WHITE);
    let mut part = Part::default();
    for (k, hues) in hues.into_iter().enumerate() {
        let rect = Rect { x: 0, y: k * height, width, height };
        image.paint(rect, |v, u| color(u, v, hues));
        let mut mesh = sheet(16, 192, Ends::Ring, &image, rect, |u, v| {
            let p = band(u, v);
            // A cyclic change of axes keeps the band right-handed.
            std::array::from_fn(|a| p[(a + k) % 3])
        });
        quarter_turn(&mut mesh, &image, rect);
        part.append(mesh);
    }
    Model { name: "octostar", part, texture: image, view: -28.0 }
}
