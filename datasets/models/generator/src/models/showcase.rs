//! A rounded block with cones, dimples and ripples in colour, and one white side.

use std::f64::consts::PI;

use crate::Model;
use crate::cube_sphere::star;
use crate::image::{Rgb, paint};
use crate::vec3::{V3, length, sub};

/// Half the edge of the block and the radius of its edges.
const HALF: f64 = 12.0;
const ROUND: f64 = 3.5;

/// Cones on the top: centre x and y, base radius, height, colour.
const CONES: [(f64, f64, f64, f64, Rgb); 5] = [
    (0.0, 0.0, 4.6, 6.0, paint::INDIGO),
    (6.2, 6.2, 2.8, 2.6, paint::BRICK),
    (-6.2, 6.2, 2.8, 2.6, paint::LEAF),
    (-6.2, -6.2, 2.8, 2.6, paint::OCHRE),
    (6.2, -6.2, 2.8, 2.6, paint::PLUM),
];

/// Dimples in the front: centre x and z, radius, depth, colour.
const DIMPLES: [(f64, f64, f64, f64, Rgb); 5] = [
    (0.0, 0.0, 4.6, 2.4, paint::BRICK),
    (6.6, 6.2, 2.8, 0.8, paint::OCHRE),
    (-6.6, 6.2, 2.4, 0.8, paint::SKY),
    (-6.6, -6.2, 2.8, 0.8, paint::LEAF),
    (6.6, -6.2, 2.4, 0.8, paint::PLUM),
];

fn block(p: V3) -> f64 {
    let q: V3 = std::array::from_fn(|a| (p[a].abs() - (HALF - ROUND)).max(0.0));
    length(q) - ROUND
}

fn distance(p: V3) -> f64 {
    let mut d = block(p);
    if p[2] > 0.0 {
        for (x, y, radius, height, _) in CONES {
            let r = ((p[0] - x) * (p[0] - x) + (p[1] - y) * (p[1] - y)).sqrt();
            // A cone of slope height / radius, its tip rounded by the mesh.
            d = d.min((p[2] - HALF - height * (1.0 - r / radius)).max(HALF - 2.0 - p[2]));
        }
    }
    if p[1] < 0.0 {
        for (x, z, radius, depth, _) in DIMPLES {
            // The ball that cuts a dimple of this radius and depth out of the plane y = -HALF.
            let ball = (radius * radius + depth * depth) / (2.0 * depth);
            let centre = [x, -HALF - (ball - depth), z];
            d = d.max(ball - length(sub(p, centre)));
        }
    }
    if p[0] < 0.0 {
        // Ripples on the left, fading towards the edges.
        let fade = |v: f64| (1.0 - (v / (HALF - ROUND)) * (v / (HALF - ROUND))).max(0.0);
        d += 0.7 * fade(p[1]) * fade(p[2]) * (1.0 - libm::cos(2.0 * PI * p[2] / 4.25)) / 2.0;
    }
    if p[1] > 0.0 {
        // One wide bump at the back.
        let r2 = p[0] * p[0] + p[2] * p[2];
        d -= 2.4 * libm::exp(-r2 / 30.0);
    }
    d
}

fn color(p: V3) -> Rgb {
    let side = (0..3).max_by(|&a, &b| p[a].abs().total_cmp(&p[b].abs())).unwrap_or(0);
    match (side, p[side] > 0.0) {
        (0, true) => paint::WHITE,
        (2, true) => {
            for (x, y, radius, _, color) in CONES {
                let r = ((p[0] - x) * (p[0] - x) + (p[1] - y) * (p[1] - y)).sqrt();
                if r < radius {
                    let ring = (r / radius * 5.0) as u32;
                    return if radius > 4.0 && ring % 2 == 1 { paint::MINT } else { color };
                }
                if r < radius + 0.5 {
                    return paint::CHARCOAL;
                }
            }
            paint::CREAM
        }
        (1, false) => {
            for (x, z, radius, _, color) in DIMPLES {
                let r = ((p[0] - x) * (p[0] - x) + (p[2] - z) * (p[2] - z)).sqrt();
                if r < radius {
                    let turn = libm::atan2(p[2] - z, p[0] - x) / (2.0 * PI) * 8.0;
                    let wedge = turn.rem_euclid(1.0) < 0.5 && r > radius * 0.35;
                    return if wedge { paint::CREAM } else { color };
                }
                if r < radius + 0.5 {
                    return paint::CHARCOAL;
                }
            }
            paint::CREAM
        }
        (0, false) => {
            let band = ((p[2] + HALF) / 2.125).floor() as usize;
            [paint::BRICK, paint::ORANGE, paint::OCHRE, paint::LEAF, paint::SKY, paint::INDIGO, paint::PLUM]
                [band % 7]
        }
        (1, true) => {
            let r = (p[0] * p[0] + p[2] * p[2]).sqrt();
            [paint::CREAM, paint::BRICK][(r / 1.5) as usize % 2]
        }
        _ => {
            let square = |v: f64| (v / 3.0).floor() as i64;
            if (square(p[0]) + square(p[1])).rem_euclid(2) == 0 { paint::CHARCOAL } else { paint::CREAM }
        }
    }
}

pub fn model() -> Model {
    let (part, image) = star(32, 400, 40.0, distance, color);
    Model { name: "showcase", part, texture: image, view: -35.0 }
}
