//! A checkerboard of white and cyan against a walk that shares nothing with the crate's: absorption
//! ends a path instead of weighting it, and free flights are found cell by cell along the ray
//! instead of by delta tracking.

mod common;

use common::*;
use pellucid_trace::{AnalyticScene, Boundary, Medium, Optics, Shape, TraceOptions};
use pellucid_voxel::{Control, Pitch};
use rand_core::Rng;
use rand_pcg::Pcg32;

/// Albedo and extinction of white and cyan, channel G.
const MATERIALS: [(f64, f64); 2] = [(0.9997, 9.0), (0.7, 4.5)];
const G: f64 = 0.4;

/// A block of `cells` cells from the origin on, of alternating materials.
struct Blocks {
    cell: [f64; 3],
    cells: [i64; 3],
    index: f64,
}

impl Blocks {
    /// Value and standard error of `paths` paths down from a point on the upper face.
    fn radiance(&self, point: [f64; 3], paths: u32) -> (f64, f64) {
        let mut rng = Pcg32::new(2021, 7);
        let left = (0..paths).filter(|_| self.leaves(point, &mut rng)).count();
        let mean = left as f64 / f64::from(paths);
        (mean, (mean * (1.0 - mean) / f64::from(paths)).sqrt())
    }

    fn leaves(&self, mut p: [f64; 3], rng: &mut Pcg32) -> bool {
        let mut d = [0.0, 0.0, -1.0];
        let mut cell: [i64; 3] = std::array::from_fn(|a| (p[a] / self.cell[a]) as i64);
        cell[2] = self.cells[2] - 1;
        loop {
            let mut depth = -uniform(rng).ln();
            loop {
                let (albedo, sigma_t) = MATERIALS[cell.iter().sum::<i64>().rem_euclid(2) as usize];
                let face = |a: usize| self.cell[a] * (cell[a] + i64::from(d[a] > 0.0)) as f64;
                let times: [f64; 3] = std::array::from_fn(|a| {
                    if d[a] == 0.0 { f64::INFINITY } else { ((face(a) - p[a]) / d[a]).max(0.0) }
                });
                let axis = (1..3).fold(0, |best, a| if times[a] < times[best] { a } else { best });
                if depth < sigma_t * times[axis] {
                    p = std::array::from_fn(|a| p[a] + d[a] * depth / sigma_t);
                    if uniform(rng) >= albedo {
                        return false;
                    }
                    d = scattered(d, rng);
                    break;
                }
                depth -= sigma_t * times[axis];
                p = std::array::from_fn(|a| p[a] + d[a] * times[axis]);
                p[axis] = face(axis);
                let step = if d[axis] > 0.0 { 1 } else { -1 };
                if (0..self.cells[axis]).contains(&(cell[axis] + step)) {
                    cell[axis] += step;
                } else if uniform(rng) >= self.reflectance(d[axis].abs()) {
                    return true;
                } else {
                    d[axis] = -d[axis];
                }
            }
        }
    }

    /// Fresnel's reflectance from inside, by Snell's angles.
    fn reflectance(&self, cosine: f64) -> f64 {
        let inside = cosine.min(1.0).acos();
        let sine = self.index * inside.sin();
        if self.index == 1.0 || sine >= 1.0 {
            return if sine >= 1.0 { 1.0 } else { 0.0 };
        }
        let outside = sine.asin();
        let normal = ((self.index - 1.0) / (self.index + 1.0)).powi(2);
        if inside < 1e-6 {
            return normal;
        }
        let s = ((inside - outside).sin() / (inside + outside).sin()).powi(2);
        let p = ((inside - outside).tan() / (inside + outside).tan()).powi(2);
        0.5 * (s + p)
    }
}

fn uniform(rng: &mut Pcg32) -> f64 {
    (rng.next_u64() >> 11) as f64 * f64::powi(2.0, -53) + f64::powi(2.0, -54)
}

/// A direction at a Henyey-Greenstein cosine, found by rejection, from `d`.
fn scattered(d: [f64; 3], rng: &mut Pcg32) -> [f64; 3] {
    let most = (1.0 + G) / (1.0 - G).powi(2);
    loop {
        let z = 2.0 * uniform(rng) - 1.0;
        let turn = std::f64::consts::TAU * uniform(rng);
        let r = (1.0 - z * z).sqrt();
        let e = [r * turn.cos(), r * turn.sin(), z];
        let cosine: f64 = (0..3).map(|a| d[a] * e[a]).sum();
        let density = (1.0 - G * G) / (1.0 + G * G - 2.0 * G * cosine).powf(1.5);
        if uniform(rng) * most < density {
            return e;
        }
    }
}

fn optics() -> Vec<Optics> {
    MATERIALS.iter().map(|(a, s)| Optics { sigma_s: a * s, sigma_a: (1.0 - a) * s, g: G }).collect()
}

#[test]
fn a_checkerboard_agrees_with_an_analog_walk() {
    // On either side of an edge between cells, and on it.
    let points = [[2.9, 2.5, 6.0], [3.1, 2.5, 6.0], [3.0, 3.0, 6.0]];
    for (index, point) in [1.0, 1.5].into_iter().flat_map(|n| points.map(|p| (n, p))) {
        let blocks = Blocks { cell: [1.0; 3], cells: [6; 3], index };
        let (expected, sigma) = blocks.radiance(point, 150_000);
        let shape = Shape::Box { min_mm: [0.0; 3], max_mm: [6.0; 3] };
        let medium = Medium::Checkerboard { cell_mm: 1.0, even: 0, odd: 1 };
        let scene = AnalyticScene::new(shape, medium, optics()).unwrap();
        let boundary = Boundary::with_index(index).unwrap();
        let options = TraceOptions { spp: 300_000, seed: 4, boundary, ..TraceOptions::default() };
        let got = scene.radiance(point, [0.0, 0.0, 1.0], &options, &Control::none()).unwrap();
        let z = (got.value - expected) / got.std_error.hypot(sigma);
        assert!(z.abs() < 3.5, "n = {index}, {point:?}: {} for {expected}, z = {z:.2}", got.value);
    }
}

#[test]
fn voxels_of_whole_cells_agree_with_an_analog_walk() {
    // Cells of 1.016 x 1.016 x 1 mm are whole numbers of voxels: no voxel error.
    let voxels = [24, 12, 37];
    let pitch = Pitch::j750();
    let cell: [f64; 3] = std::array::from_fn(|a| pitch.mm()[a] * f64::from(voxels[a]));
    let size = voxels.map(|v| v * 5);
    let object = Object::new(pitch, size, |v| {
        let parity: u32 = (0..3).map(|a| v[a] / voxels[a]).sum();
        1 + (parity % 2) as u8
    });
    let rows = MATERIALS.map(|(a, s)| ((a * s) as f32, ((1.0 - a) * s) as f32, G as f32));
    let table = table(&rows);
    let blocks = Blocks { cell, cells: [5; 3], index: 1.0 };
    for x in [1, 3, 24, 47, 60] {
        let voxel = [x + 24, 30, size[2] - 1];
        let point = object.surface.index_of(voxel).unwrap();
        let options =
            TraceOptions { spp: 300_000, seed: 9, boundary: Boundary::Matched, ..TraceOptions::default() };
        let (value, error) = object.radiance(&table, options, &[point])[0];
        let mut at: [f64; 3] = std::array::from_fn(|a| pitch.mm()[a] * (f64::from(voxel[a]) + 0.5));
        at[2] = pitch.mm()[2] * f64::from(size[2]);
        let (expected, sigma) = blocks.radiance(at, 150_000);
        let z = (value - expected) / error.hypot(sigma);
        assert!(z.abs() < 3.5, "voxel {voxel:?}: {value} for {expected}, z = {z:.2}");
    }
}
