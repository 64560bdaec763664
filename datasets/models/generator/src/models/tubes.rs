//! A cat bent from thin tubes: open loops, legs and a tail in many directions.

use crate::Model;
use crate::image::{Image, Rect, Rgb, paint};
use crate::sheet::{Curve, Ends, sheet, tube_point};
use crate::vec3::{V3, scale};

/// Texture strip of one tube.
const STRIP: (usize, usize) = (768, 32);
/// From the drawing below to a print of 60 mm.
const SCALE: f64 = 60.0 / 64.8654;

struct Tube {
    knots: &'static [V3],
    ends: Ends,
    /// A direction the tube never takes, to measure its angle from.
    side: V3,
    radius: f64,
    paint: fn(f64) -> Rgb,
}

/// Tabby stripes along a tube, by arc length in millimetres.
fn tabby(s: f64) -> Rgb {
    match s.rem_euclid(4.0) {
        t if t < 1.1 => paint::BROWN,
        t if t < 1.6 => paint::CREAM,
        _ => paint::ORANGE,
    }
}

/// A leg from the body down: stripes, then a white sock.
fn leg(s: f64) -> Rgb {
    if s > 15.0 { paint::WHITE } else { tabby(s) }
}

/// A tail with a dark tip.
fn tail(s: f64) -> Rgb {
    if s > 42.0 { paint::CHARCOAL } else { tabby(s) }
}

/// The round of the face: plain with a pale chin.
fn face(s: f64) -> Rgb {
    if (18.0..32.0).contains(&s) { paint::WHITE } else { tabby(s) }
}

fn collar(s: f64) -> Rgb {
    if s.rem_euclid(2.0) < 1.0 { paint::INDIGO } else { paint::SKY }
}

fn whisker(_: f64) -> Rgb {
    paint::CHARCOAL
}

fn nose(_: f64) -> Rgb {
    paint::ROSE
}

const TUBES: [Tube; 15] = [
    // The two sides of the body, joined at the shoulders and the hips.
    Tube {
        knots: &[
            [-16.0, 0.0, 21.0],
            [-9.0, -6.0, 20.5],
            [4.0, -6.5, 19.0],
            [13.0, -4.0, 21.0],
            [15.0, 0.0, 22.0],
            [13.0, 4.0, 21.0],
            [4.0, 6.5, 19.0],
            [-9.0, 6.0, 20.5],
        ],
        ends: Ends::Ring,
        side: [0.0, 0.0, 1.0],
        radius: 1.5,
        paint: tabby,
    },
    // The back, from the hips to the neck.
    Tube {
        knots: &[
            [15.0, 0.0, 22.0],
            [8.0, 0.0, 26.0],
            [-4.0, 0.0, 24.5],
            [-13.0, 0.0, 27.0],
            [-19.0, 0.0, 33.0],
        ],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.6,
        paint: tabby,
    },
    // The chest.
    Tube {
        knots: &[[-19.0, 0.0, 33.0], [-19.5, 0.0, 27.0], [-16.0, 0.0, 21.0]],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.5,
        paint: tabby,
    },
    Tube {
        knots: &[[-9.0, -6.0, 20.5], [-12.0, -6.8, 12.0], [-10.5, -6.5, 5.0], [-12.5, -6.5, 1.4]],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.4,
        paint: leg,
    },
    Tube {
        knots: &[[-9.0, 6.0, 20.5], [-15.0, 6.8, 13.0], [-17.5, 6.5, 6.0], [-21.0, 6.5, 1.4]],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.4,
        paint: leg,
    },
    Tube {
        knots: &[[12.0, -4.6, 21.0], [14.5, -6.2, 14.0], [10.5, -6.5, 8.0], [9.0, -6.5, 1.4]],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.4,
        paint: leg,
    },
    Tube {
        knots: &[[12.0, 4.6, 21.0], [17.0, 6.2, 14.5], [18.5, 6.5, 7.0], [16.5, 6.5, 1.4]],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.4,
        paint: leg,
    },
    // The tail.
    Tube {
        knots: &[
            [15.0, 0.0, 22.0],
            [22.0, 0.0, 24.0],
            [26.5, 0.0, 32.0],
            [23.0, 0.0, 41.0],
            [25.0, 0.0, 50.0],
            [31.0, 0.0, 53.5],
        ],
        ends: Ends::Poles,
        side: [0.0, 1.0, 0.0],
        radius: 1.3,
        paint: tail,
    },
    // The head: a ring that faces -x, and its crossing round.
    Tube {
        knots: &[
            [-24.0, 0.0, 48.0],
            [-24.5, -7.5, 45.0],
            [-25.0, -8.5, 39.5],
            [-24.5, -4.5, 34.0],
            [-24.0, 0.0, 32.6],
            [-24.5, 4.5, 34.0],
            [-25.0, 8.5, 39.5],
            [-24.5, 7.5, 45.0],
        ],
        ends: Ends::Ring,
        side: [1.0, 0.0, 0.0],
        radius: 1.4,
        paint: face,
    },
    Tube {
        knots: &[
            [-24.0, 0.0, 48.0],
            [-29.0, 0.0, 44.0],
            [-30.5, 0.0, 38.5],
            [-28.0, 0.0, 34.0],
            [-24.0, 0.0, 32.6],
            [-19.5, 0.0, 34.5],
            [-17.5, 0.0, 40.5],
            [-19.5, 0.0, 46.0],
        ],
        ends: Ends::Ring,
        side: [0.0, 1.0, 0.0],
        radius: 1.4,
        paint: face,
    },
    // Ears.
    Tube {
        knots: &[[-24.2, -2.2, 47.6], [-24.0, -6.2, 53.6], [-24.6, -8.2, 43.8]],
        ends: Ends::Poles,
        side: [1.0, 0.0, 0.0],
        radius: 1.1,
        paint: tabby,
    },
    Tube {
        knots: &[[-24.2, 2.2, 47.6], [-24.0, 6.2, 53.6], [-24.6, 8.2, 43.8]],
        ends: Ends::Poles,
        side: [1.0, 0.0, 0.0],
        radius: 1.1,
        paint: tabby,
    },
    // The collar, whiskers and nose.
    Tube {
        knots: &[[-19.4, -3.2, 30.6], [-22.2, 0.0, 30.4], [-19.4, 3.2, 30.6], [-16.4, 0.0, 31.0]],
        ends: Ends::Ring,
        side: [0.0, 0.0, 1.0],
        radius: 1.2,
        paint: collar,
    },
    Tube {
        knots: &[
            [-27.0, -12.0, 38.2],
            [-29.6, -6.0, 38.8],
            [-30.4, 0.0, 38.4],
            [-29.6, 6.0, 38.8],
            [-27.0, 12.0, 38.2],
        ],
        ends: Ends::Poles,
        side: [0.0, 0.0, 1.0],
        radius: 0.6,
        paint: whisker,
    },
    Tube {
        knots: &[[-31.0, -0.8, 39.6], [-31.2, 0.0, 39.6], [-31.0, 0.8, 39.6]],
        ends: Ends::Poles,
        side: [0.0, 0.0, 1.0],
        radius: 1.5,
        paint: nose,
    },
];

pub fn model() -> Model {
    let mut image = Image::new(STRIP.0, STRIP.1 * TUBES.len(), paint::WHITE);
    let mut part = crate::part::Part::default();
    for (k, tube) in TUBES.iter().enumerate() {
        let curve = Curve::new(tube.knots, tube.ends == Ends::Ring);
        let rect = Rect { x: 0, y: k * STRIP.1, width: STRIP.0, height: STRIP.1 };
        image.paint(rect, |u, _| (tube.paint)(u * curve.length()));
        let rows = (curve.length() / 1.15).ceil().max(8.0) as u32;
        let mut mesh = sheet(12, rows, tube.ends, &image, rect, |u, v| {
            tube_point(&curve, tube.ends, tube.side, |_| tube.radius, u, v)
        });
        crate::sheet::quarter_turn(&mut mesh, &image, rect);
        part.append(mesh);
    }
    part.positions.iter_mut().for_each(|p| *p = scale(*p, SCALE));
    Model { name: "tubes", part, texture: image, view: -50.0 }
}
