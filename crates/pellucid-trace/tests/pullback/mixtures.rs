//! Materials of different phase functions, against differences of a walk that shares nothing with the crate's: it
//! mixes two materials in every collision.

use pellucid_trace::{Boundary, TraceOptions};
use pellucid_voxel::Pitch;
use rand_core::Rng;
use rand_pcg::Pcg32;
use rayon::prelude::*;

use super::sums::{Measured, Scene};
use crate::common::{Object, table};

/// Scattering, absorption, mean cosine of the block and of what is mixed in.
const BASE: (f64, f64, f64) = (8.0, 1.5, 0.4);
const OTHERS: [(f64, f64, f64); 2] = [(4.0, 0.3, -0.3), (5.0, 0.5, 0.8)];
const SIZE: [u32; 3] = [48, 24, 30];

fn uniform(rng: &mut Pcg32) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}

/// True if a path leaves a block of the base with an amount of another material before it is absorbed.
fn leaves(size: [f64; 3], mut p: [f64; 3], other: (f64, f64, f64), amount: f64, rng: &mut Pcg32) -> bool {
    let scattering = [BASE.0, amount * other.0];
    let total = scattering[0] + scattering[1] + BASE.1 + amount * other.1;
    let mut d = [0.0, 0.0, -1.0];
    loop {
        let flight = -uniform(rng).ln() / total;
        p = std::array::from_fn(|a| p[a] + d[a] * flight);
        if (0..3).any(|a| !(0.0..size[a]).contains(&p[a])) {
            return true;
        }
        let u = uniform(rng) * total;
        if u >= scattering[0] + scattering[1] {
            return false;
        }
        let g: f64 = if u < scattering[0] { BASE.2 } else { other.2 };
        let s = (1.0 - g * g) / (1.0 - g + 2.0 * g * uniform(rng));
        let cosine = (1.0 + g * g - s * s) / (2.0 * g);
        d = turned(d, cosine, std::f64::consts::TAU * uniform(rng));
    }
}

/// A direction at an angle to `d`, by an explicit orthonormal frame.
fn turned(d: [f64; 3], cosine: f64, azimuth: f64) -> [f64; 3] {
    let least = if d[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let u = cross(d, least);
    let length = u.iter().map(|v| v * v).sum::<f64>().sqrt();
    let u = u.map(|v| v / length);
    let v = cross(d, u);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let e: [f64; 3] =
        std::array::from_fn(|a| cosine * d[a] + sine * (azimuth.cos() * u[a] + azimuth.sin() * v[a]));
    let length = e.iter().map(|v| v * v).sum::<f64>().sqrt();
    e.map(|v| v / length)
}

/// The derivative by the amount at none, from three amounts.
fn difference(size: [f64; 3], p: [f64; 3], other: (f64, f64, f64)) -> Measured {
    const PATHS: u32 = 1 << 20;
    let step = 0.3;
    let radiance = |amount: f64, stream: u64| {
        let left: u32 = (0..64u64)
            .into_par_iter()
            .map(|part| {
                let mut rng = Pcg32::new(part, stream);
                (0..PATHS / 64).filter(|_| leaves(size, p, other, amount, &mut rng)).count() as u32
            })
            .sum();
        let mean = f64::from(left) / f64::from(PATHS);
        (mean, mean * (1.0 - mean) / f64::from(PATHS))
    };
    let (none, once, twice) = (radiance(0.0, 1), radiance(step, 2), radiance(2.0 * step, 3));
    Measured {
        mean: (4.0 * once.0 - 3.0 * none.0 - twice.0) / (2.0 * step),
        error: (16.0 * once.1 + 9.0 * none.1 + twice.1).sqrt() / (2.0 * step),
    }
}

#[test]
fn materials_of_other_phase_functions() {
    let pitch = Pitch::j750();
    let mm = pitch.mm();
    let object = Object::new(pitch, SIZE, |_| 1);
    let row = |m: (f64, f64, f64)| (m.0 as f32, m.1 as f32, m.2 as f32);
    let table = table(&[row(BASE), row(OTHERS[0]), row(OTHERS[1])]);
    let options = TraceOptions { boundary: Boundary::Matched, ..TraceOptions::default() };
    let voxel = [SIZE[0] / 2, SIZE[1] / 2, SIZE[2] - 1];
    let points = [object.surface.index_of(voxel).unwrap()];
    let scene = Scene::new(&object, &table, options, &points, &[1.0]);
    let found =
        scene.functionals(12, 30_000.0, |sums| vec![sums.total(|_| Some(2)), sums.total(|_| Some(3))]);
    let size: [f64; 3] = std::array::from_fn(|a| mm[a] * f64::from(SIZE[a]));
    let mut at: [f64; 3] = std::array::from_fn(|a| mm[a] * (f64::from(voxel[a]) + 0.5));
    at[2] = size[2] - 1e-9;
    for (found, other) in found.into_iter().zip(OTHERS) {
        found.agrees(difference(size, at, other), 0.008, &format!("{other:?}"));
    }
}
