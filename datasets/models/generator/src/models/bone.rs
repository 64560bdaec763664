//! A bent bone with two knobs at each end and a fine cork-like texture.

use std::f64::consts::PI;

use crate::Model;
use crate::image::{Image, Rect, Rgb};
use crate::noise::{cellular, value};
use crate::sheet::{Ends, sheet};
use crate::vec3::{V3, scale};

/// Length from pole to pole, with the hollows between the knobs still filled.
const LENGTH: f64 = 41.8;

/// The surface point at the fraction u around and v along; the ends are poles.
fn point(u: f64, v: f64) -> V3 {
    // Rows crowd towards the rounded ends.
    let along = -libm::cos(PI * v);
    let x = along * LENGTH / 2.0;
    let angle = 2.0 * PI * u;
    let end = |at: f64, width: f64| {
        let d = (x.abs() - at) / width;
        libm::exp(-d * d)
    };
    let cap = libm::pow((1.0 - along * along).max(0.0), 0.5) * 3.2;
    let cap = 1.0 - libm::exp(-cap * 1.6);
    // The shaft is oval and thins to one side; each end swells and splits into two knobs.
    let shaft = 3.0 + 0.5 * libm::cos(2.0 * angle) + 0.02 * x;
    let swell = end(16.2, 4.8);
    let fork = 0.5 * (1.0 + libm::cos(2.0 * angle));
    let r = (shaft + swell * (1.4 + 3.6 * fork * fork)) * cap;
    // A hollow between the knobs of each end.
    let dent = 2.2 * end(20.9, 2.0) * libm::exp(-(r / 3.0) * (r / 3.0));
    let bend = 0.006 * x * x;
    [x - dent * x.signum(), bend + r * libm::cos(angle), 0.9 * r * libm::sin(angle)]
}

fn color(p: V3) -> Rgb {
    let palette: [Rgb; 7] = [
        [224, 184, 134],
        [210, 162, 110],
        [190, 138, 88],
        [162, 110, 70],
        [122, 82, 62],
        [236, 208, 166],
        [92, 76, 70],
    ];
    let (near, second, id) = cellular(scale(p, 1.15), 3);
    if second - near < 0.07 {
        return palette[4];
    }
    if value(scale(p, 2.6), 11) > 0.79 {
        return palette[6];
    }
    if value(scale(p, 3.4), 12) > 0.8 {
        return palette[5];
    }
    palette[((id * 2.2 + value(scale(p, 1.7), 13) * 1.8) as usize).min(3)]
}

pub fn model() -> Model {
    let (width, height) = (560, 560);
    let mut image = Image::new(width, height, [0; 3]);
    let rect = Rect { x: 0, y: 0, width, height };
    image.paint(rect, |u, v| color(point(u, v)));
    let part = sheet(56, 64, Ends::Poles, &image, rect, point);
    Model { name: "bone", part, texture: image, view: -25.0 }
}
