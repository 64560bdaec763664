//! A small rasteriser for pictures of the models.

use crate::Model;
use crate::image::{Image, Rect, Rgb};
use crate::vec3::{V3, dot, unit};

/// Background of the pictures.
const GROUND: Rgb = [236, 236, 238];
/// Samples along each edge of a pixel.
const SAMPLES: usize = 3;

/// An orthographic picture of `size` x `size` pixels from the compass direction `turn` (degrees,
/// counter-clockwise from -y seen from above) and `tilt` degrees above the horizon.
pub fn render(model: &Model, turn: f64, tilt: f64, size: usize) -> Image {
    let (a, b) = (turn.to_radians(), tilt.to_radians());
    let (ca, sa, cb, sb) = (libm::cos(a), libm::sin(a), libm::cos(b), libm::sin(b));
    let right: V3 = [ca, sa, 0.0];
    let towards: V3 = [sa * cb, -ca * cb, sb];
    let up: V3 = [-sa * sb, ca * sb, cb];
    let part = &model.part;
    let flat: Vec<V3> =
        part.positions.iter().map(|&p| [dot(p, right), dot(p, up), dot(p, towards)]).collect();
    let bound = |axis: usize| {
        flat.iter().fold((f64::MAX, f64::MIN), |(lo, hi), p| (lo.min(p[axis]), hi.max(p[axis])))
    };
    let (bx, by) = (bound(0), bound(1));
    let fine = size * SAMPLES;
    let scale = fine as f64 * 0.92 / (bx.1 - bx.0).max(by.1 - by.0);
    let middle = [(bx.0 + bx.1) / 2.0, (by.0 + by.1) / 2.0];
    let half = fine as f64 / 2.0;
    let screen = |p: V3| [half + (p[0] - middle[0]) * scale, half - (p[1] - middle[1]) * scale, p[2]];
    let normals = shading_normals(model);
    let light = unit([
        towards[0] + 0.5 * up[0] - 0.4 * right[0],
        towards[1] + 0.5 * up[1] - 0.4 * right[1],
        towards[2] + 0.5 * up[2],
    ]);

    let mut depth = vec![f64::MIN; fine * fine];
    let mut color = vec![GROUND.map(f64::from); fine * fine];
    for (t, corners) in part.triangles.iter().enumerate() {
        let [p, q, r] = corners.map(|i| screen(flat[i as usize]));
        let area = (q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]);
        if area.abs() < 1e-12 {
            continue;
        }
        let clip = |v: f64| v.clamp(0.0, fine as f64) as usize;
        let lo = |k: usize| clip(p[k].min(q[k]).min(r[k]).floor());
        let hi = |k: usize| clip(p[k].max(q[k]).max(r[k]).ceil());
        for y in lo(1)..hi(1) {
            for x in lo(0)..hi(0) {
                let (sx, sy) = (x as f64 + 0.5, y as f64 + 0.5);
                let wq = ((sx - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (sy - p[1])) / area;
                let wr = ((q[0] - p[0]) * (sy - p[1]) - (sx - p[0]) * (q[1] - p[1])) / area;
                let w = [1.0 - wq - wr, wq, wr];
                if w.iter().any(|&v| v < 0.0) {
                    continue;
                }
                let z = w[0] * p[2] + w[1] * q[2] + w[2] * r[2];
                let at = y * fine + x;
                if z <= depth[at] {
                    continue;
                }
                depth[at] = z;
                let blend = |get: &dyn Fn(usize) -> V3| -> V3 {
                    std::array::from_fn(|k| (0..3).map(|c| w[c] * get(c)[k]).sum())
                };
                let uv = blend(&|c| {
                    let uv = part.uv[corners[c] as usize];
                    [uv[0], uv[1], 0.0]
                });
                let base = model.texture.sample([uv[0], uv[1]]);
                let n = unit(blend(&|c| normals[t][c]));
                let shade = 0.72 + 0.30 * dot(n, light).max(-0.6);
                color[at] = base.map(|v| (v * shade).min(255.0));
            }
        }
    }
    let mut image = Image::new(size, size, GROUND);
    image.paint(Rect { x: 0, y: 0, width: size, height: size }, |u, v| {
        let (x, y) =
            ((u * (size - 1) as f64).round() as usize, ((1.0 - v) * (size - 1) as f64).round() as usize);
        std::array::from_fn(|k| {
            let sum: f64 = (0..SAMPLES * SAMPLES)
                .map(|s| color[(y * SAMPLES + s / SAMPLES) * fine + x * SAMPLES + s % SAMPLES][k])
                .sum();
            (sum / (SAMPLES * SAMPLES) as f64).round() as u8
        })
    });
    image
}

/// Normals at the corners of every triangle: smooth, but flat across creases of more than 40 degrees.
fn shading_normals(model: &Model) -> Vec<[V3; 3]> {
    let part = &model.part;
    let smooth = part.normals();
    part.triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|i| part.positions[i as usize]);
            let flat = unit(crate::vec3::cross(crate::vec3::sub(b, a), crate::vec3::sub(c, a)));
            corners.map(|i| {
                let n = smooth[i as usize];
                if dot(n, flat) > 0.766 { n } else { flat }
            })
        })
        .collect()
}

/// All models, each from its own side and from the opposite one, four models a row.
pub fn contact_sheet(models: &[Model], size: usize) -> Image {
    let columns = 4;
    let rows = models.len().div_ceil(columns);
    let mut sheet = Image::new(columns * size, rows * 2 * size, GROUND);
    for (k, model) in models.iter().enumerate() {
        for side in 0..2 {
            let picture = render(model, model.view + 180.0 * side as f64, 24.0, size);
            let (x, y) = (k % columns * size, (k / columns * 2 + side) * size);
            for row in 0..size {
                let start = (y + row) * sheet.width + x;
                sheet.pixels[start..start + size]
                    .copy_from_slice(&picture.pixels[row * size..(row + 1) * size]);
            }
        }
    }
    sheet
}

/// An image with five bits a channel, which a PNG packs well.
pub fn reduced(mut image: Image) -> Image {
    image.pixels.iter_mut().for_each(|p| *p = p.map(|v| (f64::from(v) / 255.0 * 31.0).round() as u8 * 8 + 3));
    image
}
