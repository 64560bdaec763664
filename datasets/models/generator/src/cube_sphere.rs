//! Star-shaped solids over the six faces of a cube.

use crate::image::{Image, Rect, Rgb};
use crate::part::Part;
use crate::vec3::{V3, scale, unit};

/// Axes of the faces: normal, then the directions of u and v, right-handed.
const FACES: [[V3; 3]; 6] = [
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]],
];

/// The point where the ray from the origin along `direction` leaves the solid `distance` < 0.
pub fn leave(direction: V3, reach: f64, distance: &impl Fn(V3) -> f64) -> V3 {
    let (mut lo, mut hi) = (0.0, reach);
    for _ in 0..50 {
        let mid = (lo + hi) / 2.0;
        if distance(scale(direction, mid)) < 0.0 { lo = mid } else { hi = mid }
    }
    scale(direction, lo)
}

/// Meshes a solid that every ray from the origin leaves once, with `n` x `n` quads a face, and
/// bakes `color(point)` into a texture of 3 x 2 faces of `texels` pixels.
pub fn star(
    n: u32,
    texels: usize,
    reach: f64,
    distance: impl Fn(V3) -> f64,
    color: impl Fn(V3) -> Rgb,
) -> (Part, Image) {
    let mut image = Image::new(3 * texels, 2 * texels, [0; 3]);
    let mut part = Part::default();
    for (f, axes) in FACES.iter().enumerate() {
        let rect = Rect { x: f % 3 * texels, y: f / 3 * texels, width: texels, height: texels };
        // Edges between faces hold the same numbers on both sides, so they weld.
        let surface = |u: f64, v: f64| {
            let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
            let on_cube: V3 = std::array::from_fn(|k| axes[0][k] + a * axes[1][k] + b * axes[2][k]);
            leave(unit(on_cube), reach, &distance)
        };
        image.paint(rect, |u, v| color(surface(u, v)));
        let base = part.positions.len() as u32;
        for j in 0..=n {
            for i in 0..=n {
                let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                part.positions.push(surface(u, v));
                part.uv.push(image.uv(rect, u, v));
            }
        }
        for j in 0..n {
            for i in 0..n {
                let at = |i: u32, j: u32| base + j * (n + 1) + i;
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                // Quads are cut along the shorter diagonal, which keeps creases straight.
                let p = |k: u32| part.positions[k as usize];
                let across = |k: u32, l: u32| crate::vec3::length(crate::vec3::sub(p(k), p(l)));
                if across(a, c) <= across(b, d) {
                    part.triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    part.triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
    }
    (part, image)
}
