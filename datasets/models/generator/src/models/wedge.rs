//! A wedge from 0.5 to 6.5 mm: cross-talk against thickness and spatial frequency.

use crate::Model;
use crate::image::{Image, Rect, Rgb, paint};
use crate::sheet::box_part;

const LENGTH: f64 = 60.0;
const HEIGHT: f64 = 20.0;
const THIN: f64 = 0.5;
const THICK: f64 = 6.5;
/// Pixels per millimetre: every bar is a whole number of pixels.
const SCALE: usize = 16;

/// The colour of one side at `x` from the thin end and `z` from the bottom, in millimetres. The
/// other side has the other colour of the pair at the same place.
fn color(x: f64, z: f64, front: bool) -> Rgb {
    let pairs = [
        (paint::CHARCOAL, paint::WHITE),
        (paint::OCHRE, paint::INDIGO),
        (paint::PLUM, paint::LEAF),
        (paint::BRICK, [88, 178, 190]),
    ];
    // Four rows of bars, finest at the bottom, and a chirp above them.
    let row = (z / 4.0) as usize;
    let period = [0.5, 1.0, 2.0, 4.0];
    let (bar, pair) = if row < 4 {
        (((2.0 * x / period[row]) as u64).is_multiple_of(2), pairs[row])
    } else {
        // The period falls from 8 mm to 0.5 mm along the wedge.
        let turns = LENGTH / 7.5 * libm::log(8.0 / (8.0 - 7.5 * x / LENGTH));
        (((2.0 * turns) as u64).is_multiple_of(2), (paint::ORANGE, paint::SKY))
    };
    if bar == front { pair.0 } else { pair.1 }
}

pub fn model() -> Model {
    let (width, height) = (LENGTH as usize * SCALE, HEIGHT as usize * SCALE);
    let mut image = Image::new(width, 2 * height + 4, paint::WHITE);
    let front = Rect { x: 0, y: 0, width, height };
    let back = Rect { x: 0, y: height, width, height };
    let edge = Rect { x: 0, y: 2 * height, width, height: 4 };
    // Pixel centres in millimetres; seen from the back, x runs to the left.
    let mm = |t: f64, pixels: usize| (t * (pixels - 1) as f64 + 0.5) / SCALE as f64;
    image.paint(front, |u, v| color(mm(u, width), mm(v, height), true));
    image.paint(back, |u, v| color(mm(1.0 - u, width), mm(v, height), false));
    let corners = std::array::from_fn(|k| {
        let far = k & 1 == 1;
        let half = if far { THICK } else { THIN } / 2.0;
        [
            if far { LENGTH } else { 0.0 },
            if k & 2 == 2 { half } else { -half },
            if k & 4 == 4 { HEIGHT } else { 0.0 },
        ]
    });
    Model { name: "wedge", part: box_part(corners, &image, front, back, edge), texture: image, view: -25.0 }
}
