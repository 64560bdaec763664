//! Closed forms and invariances.

mod common;

use common::{Object, dielectric, hash, matched, table};
use pellucid_color::plane_parallel::{Layer, Solver};
use pellucid_trace::phase::{cosine_density, deflect, sample_cosine};
use pellucid_trace::{Boundary, TraceOptions, Tracking, internal_reflectance};
use pellucid_voxel::{MaterialTable, Pitch};
use proptest::prelude::*;

/// A knobbly heterogeneous object: a ball with bites, five materials at random.
fn knobbly() -> Object {
    Object::new(Pitch::j750(), [40, 24, 60], |v| {
        let c: f64 = (0..3)
            .map(|a| {
                let r = [20.0, 12.0, 30.0][a];
                ((f64::from(v[a]) + 0.5) / r - 1.0).powi(2)
            })
            .sum();
        if c > 1.0 || hash(v.map(|x| x / 6)).is_multiple_of(5) { 0 } else { 1 + (hash(v) % 5) as u8 }
    })
}

#[test]
fn furnace_is_exactly_one_without_absorption() {
    let object = knobbly();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(37).collect();
    for g in [-0.99, -0.5, 0.0, 1e-4, 0.4, 0.99] {
        let rows = [(3.0, 0.0, g), (0.0, 0.0, g), (20.0, 0.0, g), (0.1, 0.0, 0.4), (9.0, 0.0, g)];
        for tracking in [Tracking::Delta, Tracking::Regular] {
            for options in [matched(16), dielectric(16)] {
                for (l, e) in object.radiance(&table(&rows), TraceOptions { tracking, ..options }, &points) {
                    assert_eq!((l, e), (1.0, 0.0), "g {g}, {tracking:?}, {:?}", options.boundary);
                }
            }
        }
    }
}

#[test]
fn pure_absorption_attenuates_by_beer_and_lambert() {
    // Layers of two absorbers and a clear one, with a strong scatterer far off to the side that
    // only raises the majorant.
    let pitch = Pitch::j750();
    let object =
        Object::new(pitch, [80, 40, 50], |v| if v[0] < 4 { 4 } else { [1, 2, 3][(v[2] / 17) as usize] });
    let t = table(&[(0.0, 0.7, 0.4), (0.0, 1.9, 0.4), (0.0, 0.0, 0.4), (40.0, 0.0, 0.4)]);
    let mm = pitch.mm()[2];
    let through = (-(17.0 * 0.7 + 17.0 * 1.9) * mm).exp();
    let there_and_back = {
        let r = 0.04;
        through * (1.0 - r) / (1.0 - r * through)
    };
    for (options, exact) in [(matched(200_000), through), (dielectric(200_000), there_and_back)] {
        for tracking in [Tracking::Delta, Tracking::Regular] {
            let (l, e) = object.radiance(&t, TraceOptions { tracking, ..options }, &[object.top()])[0];
            assert!(
                (l - exact).abs() < 4.0 * e,
                "{:?} {tracking:?}: {l} +- {e} for {exact}",
                options.boundary
            );
        }
    }
}

#[test]
fn slabs_and_half_spaces_agree_with_the_plane_parallel_solution() {
    let pitch = Pitch::new([0.1, 0.1, 0.05]).unwrap();
    // Wide enough that light does not reach the sides.
    let object = Object::new(pitch, [200, 200, 20], |v| if v[2] < 8 { 1 } else { 2 });
    let rows: [(f32, f32, f32); 2] = [(14.7, 0.3, 0.4), (5.0, 0.9, 0.7)];
    for index in [1.0, 1.33, 1.5] {
        let solver = Solver::new(index).unwrap();
        let layers = [(rows[1], 0.6), (rows[0], 0.4)].map(|((s, a, g), mm)| Layer {
            sigma_s: f64::from(s),
            sigma_a: f64::from(a),
            g: f64::from(g),
            thickness_mm: mm,
        });
        let exact = solver.radiance_normal(&layers).unwrap();
        let options = TraceOptions {
            spp: 150_000,
            boundary: Boundary::with_index(index).unwrap(),
            ..TraceOptions::default()
        };
        let (l, e) = object.radiance(&table(&rows), options, &[object.top()])[0];
        assert!((l - exact).abs() < 3.5 * e, "index {index}: {l} +- {e} for {exact}");
    }
    let thick = Object::new(Pitch::new([1.0; 3]).unwrap(), [64, 64, 32], |_| 1);
    for (albedo, g) in [(0.3, 0.0), (0.9, 0.8), (0.9, -0.6), (0.98, 0.4)] {
        for index in [1.0, 1.5] {
            let exact = Solver::new(index).unwrap().half_space(albedo, g).unwrap();
            let (albedo, g) = (albedo as f32, g as f32);
            let t = table(&[(10.0 * albedo, 10.0 * (1.0 - albedo), g)]);
            let boundary = Boundary::with_index(index).unwrap();
            let options = TraceOptions { spp: 150_000, boundary, ..TraceOptions::default() };
            let (l, e) = thick.radiance(&t, options, &[thick.top()])[0];
            assert!((l - exact).abs() < 3.5 * e, "albedo {albedo}, g {g}, {index}: {l} +- {e} for {exact}");
        }
    }
}

#[test]
fn majorant_tracking_and_roulette_do_not_matter() {
    let object = knobbly();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(301).collect();
    let materials = MaterialTable::cmykw();
    // A sixth material that raises every majorant eightfold and lies in one voxel only.
    let mut rows = materials.materials().to_vec();
    let mut heavy = rows[0].clone();
    heavy.name = "heavy".into();
    heavy.sigma_s = vec![200.0; 3];
    rows.push(heavy);
    let heavier = MaterialTable::new(materials.channel_names().to_vec(), rows).unwrap();
    let mut grid = object.grid.clone();
    let far = object.surface.voxels()[object.surface.len() / 2];
    grid.set(far, 6);
    let marked = Object::of(grid);
    let average = |values: Vec<(f64, f64)>| {
        let n = values.len() as f64;
        let variance: f64 = values.iter().map(|v| v.1 * v.1).sum();
        (values.iter().map(|v| v.0).sum::<f64>() / n, variance.sqrt() / n)
    };
    for options in [matched(4000), dielectric(4000)] {
        let delta = TraceOptions { tracking: Tracking::Delta, ..options };
        let base = average(marked.radiance(&heavier, delta, &points));
        for other in [
            TraceOptions { tracking: Tracking::Regular, seed: 6, ..options },
            TraceOptions { roulette: 0.05, seed: 7, ..delta },
            TraceOptions { roulette: 1.0, seed: 8, ..delta },
        ] {
            let (l, e) = average(marked.radiance(&heavier, other, &points));
            let z = (l - base.0) / e.hypot(base.1);
            assert!(z.abs() < 3.5, "{other:?}: {l} for {}, z = {z:.2}", base.0);
        }
    }
}

#[test]
fn thread_count_and_neighbouring_points_do_not_matter() {
    let object = knobbly();
    let materials = MaterialTable::cmykw();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(11).collect();
    let run = |threads: usize, points: &[u32]| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| object.radiance(&materials, dielectric(700), points))
    };
    let one = run(1, &points);
    assert_eq!(one, run(3, &points));
    let mut backward: Vec<u32> = points.iter().rev().copied().skip(5).collect();
    backward.dedup();
    let other = run(2, &backward);
    for (i, p) in backward.iter().enumerate() {
        let j = points.iter().position(|q| q == p).unwrap();
        assert_eq!(other[3 * i..3 * i + 3], one[3 * j..3 * j + 3], "point {p}");
    }
}

/// The tiles' alignment and constant tiles do not change a voxel's surroundings.
#[test]
fn position_in_the_grid_does_not_matter() {
    let materials = MaterialTable::cmykw();
    let label = |v: [u32; 3]| 1 + (hash(v.map(|x| x / 9)) % 5) as u8;
    let size = [60, 30, 90];
    let plain = Object::new(Pitch::j750(), size, label);
    let shift = [5, 11, 7];
    let moved = Object::new(Pitch::j750(), [70, 45, 100], |v| {
        let inner = (0..3).all(|a| v[a] >= shift[a] && v[a] < size[a] + shift[a]);
        if inner { label(std::array::from_fn(|a| v[a] - shift[a])) } else { 0 }
    });
    let [x, y, z] = [size[0] / 2, size[1] / 2, size[2] - 1];
    let there = moved.surface.index_of([x + shift[0], y + shift[1], z + shift[2]]).unwrap();
    for options in [matched(60_000), dielectric(60_000)] {
        let a = plain.radiance(&materials, options, &[plain.top()]);
        let b = moved.radiance(&materials, TraceOptions { seed: 77, ..options }, &[there]);
        for ((a, ea), (b, eb)) in a.into_iter().zip(b) {
            assert!((a - b).abs() < 3.5 * ea.hypot(eb), "{a} +- {ea} and {b} +- {eb}");
        }
    }
}

#[test]
fn henyey_greenstein_is_normalised_with_mean_cosine_g() {
    for g in [-0.99, -0.7, -0.1, -1e-3, 0.0, 1e-3, 2e-3, 0.4, 0.9, 0.99] {
        // Integrate in the angle with a power map that crowds nodes where the lobe is.
        let n = 200_000;
        let (mut total, mut mean) = (0.0, 0.0);
        for i in 0..n {
            let s = (f64::from(i) + 0.5) / f64::from(n);
            let c = 2.0 * s.powi(4) * f64::from(if g < 0.0 { 1 } else { -1 })
                - f64::from(if g < 0.0 { 1 } else { -1 });
            let w = 8.0 * s.powi(3) / f64::from(n) * cosine_density(c, g);
            total += w;
            mean += w * c;
        }
        assert!((total - 1.0).abs() < 1e-6 && (mean - g).abs() < 1e-6, "g {g}: {total}, {mean}");
        // The inverse of the distribution, on a grid of u: its mean and its second moment,
        // 1/3 + 2/3 g².
        let m = 100_000;
        let (mut first, mut second) = (0.0, 0.0);
        for i in 0..m {
            let c = sample_cosine((f64::from(i) + 0.5) / f64::from(m), g);
            assert!((-1.0..=1.0).contains(&c));
            first += c / f64::from(m);
            second += c * c / f64::from(m);
        }
        assert!((first - g).abs() < 1e-5, "g {g}: mean {first}");
        assert!((second - (1.0 + 2.0 * g * g) / 3.0).abs() < 1e-4, "g {g}: second moment {second}");
    }
}

#[test]
fn fresnel_has_its_known_values() {
    assert!(internal_reflectance(0.3, 1.0) < 1e-30);
    for n in [1.2, 1.5, 2.0] {
        let normal: f64 = ((n - 1.0) / (n + 1.0f64)).powi(2);
        assert!((internal_reflectance(1.0, n) - normal).abs() < 1e-12);
        let critical = (1.0 - 1.0 / (n * n)).sqrt();
        assert_eq!(internal_reflectance(critical * 0.999_999, n), 1.0);
        assert!(internal_reflectance((critical * 1.01).min(1.0), n) < 1.0);
        // Brewster's angle for light from inside: only the other polarisation is reflected.
        let brewster = (1.0 / n).atan();
        let s = ((n * n - 1.0) / (n * n + 1.0)).powi(2);
        assert!((internal_reflectance(brewster.cos(), n) - 0.5 * s).abs() < 1e-12);
    }
    // Diffuse internal reflectance at 1.5 (e.g. Egan and Hilgeman 1979: 0.596).
    let steps = 1_000_000;
    let diffuse: f64 = (0..steps)
        .map(|i| {
            let mu = (f64::from(i) + 0.5) / f64::from(steps);
            2.0 * mu * internal_reflectance(mu, 1.5) / f64::from(steps)
        })
        .sum();
    assert!((diffuse - 0.596).abs() < 1e-3, "{diffuse}");
}

proptest! {
    #[test]
    fn deflection_keeps_the_length_and_the_cosine(
        z in -1.0..=1.0f64, azimuth in 0.0..6.3f64, cosine in -1.0..=1.0f64, turn in 0.0..1.0f64,
    ) {
        let s = (1.0 - z * z).sqrt();
        let d = [s * azimuth.cos(), s * azimuth.sin(), z];
        let e = deflect(d, cosine, turn);
        let dot: f64 = (0..3).map(|a| d[a] * e[a]).sum();
        let length: f64 = e.iter().map(|v| v * v).sum();
        prop_assert!((length - 1.0).abs() < 1e-12);
        prop_assert!((dot - cosine).abs() < 1e-9);
    }
}
