//! Derivatives of first flights against differences of flights through labels whose materials differ a little.

mod common;

use common::hash;
use pellucid_stencil::{FLIGHT_BINS, FirstFlight, FirstFlights, StencilError};
use pellucid_voxel::{Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions};
use proptest::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::AtomicBool;

/// Materials whose amounts are moved.
const BASE: u8 = 4;
/// By how much: differences of f32 flights are exact to 1e-7 / STEP, and what a second difference leaves is less.
const STEP: f32 = 0.01;

/// Four materials in three different channels, and after them, for each two m and k, m with `STEP` of k added and with
/// `STEP` of k taken off.
fn materials() -> MaterialTable {
    let base: [(&str, [f32; 3], [f32; 3]); BASE as usize] = [
        ("clear", [0.5, 0.4, 0.3], [0.4, 0.3, 0.5]),
        ("ink", [2.0, 0.5, 9.0], [0.3, 7.0, 3.0]),
        ("white", [6.0, 9.0, 24.0], [0.5, 0.4, 0.6]),
        ("dark", [1.0, 2.0, 3.0], [5.0, 4.0, 2.0]),
    ];
    let material = |name: String, s: [f32; 3], a: [f32; 3]| Material {
        name,
        sigma_s: s.to_vec(),
        sigma_a: a.to_vec(),
        g: 0.4.into(),
    };
    let mut table: Vec<Material> = base.iter().map(|(name, s, a)| material((*name).into(), *s, *a)).collect();
    for (m, (_, s, a)) in base.iter().enumerate() {
        for (k, (_, more_s, more_a)) in base.iter().enumerate() {
            for step in [STEP, -STEP] {
                let moved = |v: &[f32; 3], by: &[f32; 3]| std::array::from_fn(|c| v[c] + step * by[c]);
                table.push(material(format!("{m} {k} {step}"), moved(s, more_s), moved(a, more_a)));
            }
        }
    }
    MaterialTable::new(["r", "g", "b"].map(String::from).to_vec(), table).unwrap()
}

/// The label of material `m` with k added or taken off.
fn moved(m: u8, k: u8, more: bool) -> u8 {
    BASE + 1 + 2 * ((m - 1) * BASE + k - 1) + u8::from(!more)
}

fn surface(grid: &LabelGrid) -> Surface {
    Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap()
}

/// J that differs between bins, channels and points.
fn after(point: u32) -> Vec<[f32; FLIGHT_BINS + 1]> {
    (0..3)
        .map(|c| {
            std::array::from_fn(|bin| {
                0.2 + (hash([i64::from(point), c, bin as i64], 5) % 700) as f32 / 1000.0
            })
        })
        .collect()
}

/// The weighted sum of some points' radiance in f64.
fn weighted(grid: &LabelGrid, surface: &Surface, points: &[u32], d_radiance: &[f32], index: f64) -> f64 {
    let table = materials();
    let flights = FirstFlights::new(&table, grid, surface, index).unwrap();
    let mut out = vec![FirstFlight::default(); 3 * points.len()];
    flights.extract(points, &mut out, &Control::none()).unwrap();
    let j = points.iter().flat_map(|&p| after(p));
    let radiance = |f: &FirstFlight, j: [f32; FLIGHT_BINS + 1]| {
        let terms = (0..FLIGHT_BINS).map(|b| f64::from(f.masses[b]) * f64::from(j[b])).sum::<f64>();
        terms + f64::from(f.escaped) + f64::from(f.returned) * f64::from(j[FLIGHT_BINS])
    };
    out.iter().zip(j).zip(d_radiance).map(|((f, j), &d)| f64::from(d) * radiance(f, j)).sum()
}

type Gradient = HashMap<([u32; 3], u8), f64>;

fn pullback(grid: &LabelGrid, surface: &Surface, points: &[u32], d_radiance: &[f32], index: f64) -> Gradient {
    let table = materials();
    let flights = FirstFlights::new(&table, grid, surface, index).unwrap();
    let j: Vec<_> = points.iter().flat_map(|&p| after(p)).collect();
    let mut sums = Gradient::new();
    let mut sink = |voxel, label, value| *sums.entry((voxel, label)).or_default() += f64::from(value);
    flights.pullback(points, &j, d_radiance, &mut sink, &Control::none()).unwrap();
    sums
}

/// Checks the derivatives by each material in some voxels; returns how many were not zero.
fn check_against_differences(
    grid: &LabelGrid,
    surface: &Surface,
    points: &[u32],
    d_radiance: &[f32],
    index: f64,
    voxels: &[[u32; 3]],
) -> usize {
    let gradient = pullback(grid, surface, points, d_radiance, index);
    let largest = gradient.values().fold(0.0f64, |most, v| most.max(v.abs()));
    let mut found = 0;
    for &voxel in voxels {
        let label = grid.get(voxel);
        for k in 1..=BASE {
            let with = |more: bool| {
                let mut grid = grid.clone();
                grid.set(voxel, moved(label, k, more));
                weighted(&grid, surface, points, d_radiance, index)
            };
            let difference = (with(true) - with(false)) / f64::from(2.0 * STEP);
            let derivative = gradient.get(&(voxel, k)).copied().unwrap_or(0.0);
            found += usize::from(derivative != 0.0);
            // Rounding of f32 flights, 1e-7 each over 2 STEP; a flight's end as opaque moves 1e-4 at most.
            let tolerance = 2e-3 * derivative.abs() + 5e-4 * largest + 1e-5;
            assert!(
                (difference - derivative).abs() <= tolerance,
                "{voxel:?} of {label}, {k}: {difference} {derivative}, largest {largest}"
            );
        }
    }
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20))]
    #[test]
    fn derivatives_are_the_limits_of_differences(
        seed in 0u64..1_000_000,
        size in [8u32..20, 4u32..12, 10u32..50],
        tilt in -0.5f64..0.5,
        pick in 0usize..1000,
        index in 1.0f64..2.0,
    ) {
        // A slanted block of layers and specks with a gap; air above the slant.
        let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
        let gap = size[2] / 3;
        let grid = LabelGrid::from_fn(frame, |[x, y, z]| {
            let top = f64::from(size[2]) * 0.8 + tilt * f64::from(x);
            if f64::from(z) > top || z == gap { return 0; }
            let mixed = hash([x, y, z].map(i64::from), seed) >> 20;
            if z % 5 == 0 { 1 } else { 1 + (mixed % 4) as u8 }
        });
        let surface = surface(&grid);
        let point = (pick % surface.len()) as u32;
        let points = [point, (point + 1) % surface.len() as u32, point];
        let d_radiance: Vec<f32> = (0..9).map(|i| 0.3 * (i % 5) as f32 - 0.5).collect();
        let gradient = pullback(&grid, &surface, &points, &d_radiance, index);
        // Those of the greatest effect, every fifth of the others on the way, and one that no flight passes.
        let mut voxels: Vec<([u32; 3], f64)> = Vec::new();
        for (&(voxel, _), value) in &gradient {
            match voxels.iter_mut().find(|(v, _)| *v == voxel) {
                Some((_, most)) => *most = most.max(value.abs()),
                None => voxels.push((voxel, value.abs())),
            }
        }
        voxels.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let mut chosen: Vec<[u32; 3]> = voxels.iter().take(4).map(|v| v.0).collect();
        chosen.extend(voxels.iter().skip(4).step_by(5).map(|v| v.0));
        chosen.extend(surface.voxels().iter().find(|v| voxels.iter().all(|(w, _)| w != *v)));
        let found = check_against_differences(&grid, &surface, &points, &d_radiance, index, &chosen);
        prop_assert!(found >= chosen.len());
    }
}

/// A layered wall: depth of a voxel below the surface, in layers.
fn wall(layers: u32, label: impl Fn(u32) -> u8 + Sync) -> (LabelGrid, Surface, u32) {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [12, 8, layers + 4]).unwrap();
    let grid =
        LabelGrid::from_fn(
            frame,
            |[_, _, z]| {
                if (2..layers + 2).contains(&z) { label(layers + 1 - z) } else { 0 }
            },
        );
    let surface = surface(&grid);
    let point = surface.index_of([6, 4, layers + 1]).unwrap();
    (grid, surface, point)
}

#[test]
fn every_depth_counts_and_bins_are_crossed_within_voxels() {
    // 0.1 mm lies within layer 3 and 0.35 mm within layer 12 of 27 um; white keeps the ray from reaching far.
    let (grid, surface, point) = wall(20, |depth| 1 + (depth % 4 == 1) as u8 + 2 * (depth == 7) as u8);
    for channel in 0..3 {
        let mut d_radiance = [0.0; 3];
        d_radiance[channel] = 1.0;
        let column: Vec<[u32; 3]> = (2..22).map(|z| [6, 4, z]).collect();
        let found = check_against_differences(&grid, &surface, &[point], &d_radiance, 1.5, &column);
        assert_eq!(found, 20 * usize::from(BASE));
        // The sheet's far side reflects: what lies on the way there matters to what comes back.
        let gradient = pullback(&grid, &surface, &[point], &d_radiance, 1.5);
        assert!(gradient[&([6, 4, 2], 4)].abs() > 1e-3);
    }
}

/// The closed form in a wall of one material that is clear, opaque, or neither: by the amount of the material itself.
#[test]
fn clear_and_opaque_walls_have_their_closed_forms() {
    let names = ["none", "faint", "solid"].map(String::from).to_vec();
    let material = |name: &str, s: [f32; 3], a: [f32; 3]| Material {
        name: name.into(),
        sigma_s: s.to_vec(),
        sigma_a: a.to_vec(),
        g: 0.0.into(),
    };
    let table = MaterialTable::new(
        names,
        vec![
            material("wall", [0.0, 1e-5, 4e3], [0.0, 2e-5, 1e3]),
            material("other", [3.0, 5.0, 7.0], [2.0, 1.0, 0.5]),
        ],
    )
    .unwrap();
    let (grid, surface, point) = wall(9, |_| 1);
    let flights = FirstFlights::new(&table, &grid, &surface, 1.0).unwrap();
    let j = after(point);
    let mut sums = HashMap::new();
    for channel in 0..3 {
        let mut d_radiance = [0.0; 3];
        d_radiance[channel] = 2.0;
        let mut sink = |voxel: [u32; 3], label: u8, value: f32| {
            assert!(value.is_finite());
            *sums.entry((channel, voxel, label)).or_insert(0.0) += f64::from(value);
        };
        flights.pullback(&[point], &j, &d_radiance, &mut sink, &Control::none()).unwrap();
    }
    let at = |channel: usize, layer: u32, label: u8| sums.get(&(channel, [6, 4, 10 - layer], label)).copied();
    let length = Pitch::j750().mm()[2];
    for channel in 0..2 {
        // Light passes, whatever it passes: J s_m - t_m times the length. The second layer lies in the first bin.
        let (label, s, t) = (2, [3.0, 5.0][channel], [5.0, 6.0][channel]);
        let expected = 2.0 * length * (s * f64::from(j[channel][0]) - t);
        let got = at(channel, 1, label).unwrap();
        assert!((got - expected).abs() < 1e-4 * expected.abs(), "{channel}: {got} {expected}");
    }
    assert_eq!(at(0, 1, 1), Some(0.0));
    // All is collected in the first layer: J d(s / t), by amounts of themselves nothing.
    let (s, t) = (4e3, 5e3);
    let expected = 2.0 * f64::from(j[2][0]) * (7.0 * t - 7.5 * s) / (t * t);
    let got = at(2, 0, 2).unwrap();
    assert!((got - expected).abs() < 1e-5 * expected.abs(), "{got} {expected}");
    assert!(at(2, 0, 1).unwrap().abs() < 1e-5);
    assert!(at(2, 5, 2).is_none_or(|v| v == 0.0));
}

#[test]
fn sums_follow_the_weights_and_not_the_threads() {
    let (grid, surface, _) = wall(20, |depth| 1 + (depth % 4) as u8);
    let table = materials();
    let flights = FirstFlights::new(&table, &grid, &surface, 1.5).unwrap();
    let points: Vec<u32> = (0..surface.len() as u32).chain(0..300).collect();
    let j: Vec<_> = points.iter().flat_map(|&p| after(p)).collect();
    let weights = |seed: u64| -> Vec<f32> {
        (0..3 * points.len() as i64).map(|i| (hash([i, 0, 0], seed) % 101) as f32 / 50.0 - 1.0).collect()
    };
    let run = |threads: usize, d_radiance: &[f32]| {
        let mut calls = Vec::new();
        let mut sink = |voxel: [u32; 3], label: u8, value: f32| calls.push((voxel, label, value.to_bits()));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| flights.pullback(&points, &j, d_radiance, &mut sink, &Control::none())).unwrap();
        calls
    };
    let (a, b) = (weights(1), weights(2));
    let one = run(1, &a);
    assert!(one == run(3, &a), "other threads, other bytes");
    let sums = |calls: &[([u32; 3], u8, u32)]| {
        let mut sums = HashMap::new();
        for &(voxel, label, bits) in calls {
            *sums.entry((voxel, label)).or_insert(0.0) += f64::from(f32::from_bits(bits));
        }
        sums
    };
    let mixed: Vec<f32> = a.iter().zip(&b).map(|(a, b)| 0.5 * a - 2.0 * b).collect();
    let (of_a, of_b, of_mixed) = (sums(&one), sums(&run(2, &b)), sums(&run(2, &mixed)));
    for (at, value) in &of_mixed {
        let expected = 0.5 * of_a.get(at).unwrap_or(&0.0) - 2.0 * of_b.get(at).unwrap_or(&0.0);
        // Some tens of f32 terms of up to 1.
        assert!((value - expected).abs() < 1e-5, "{at:?}: {value} {expected}");
    }
    assert!(run(1, &vec![0.0; a.len()]).is_empty());
}

#[test]
fn refuses_what_does_not_fit_and_stops_when_told() {
    let (grid, surface, point) = wall(6, |_| 2);
    let table = materials();
    let flights = FirstFlights::new(&table, &grid, &surface, 1.5).unwrap();
    let j = after(point);
    let mut none = |_: [u32; 3], _: u8, _: f32| panic!("nothing is to be added");
    let mut run = |points: &[u32], j: &[[f32; 4]], d: &[f32], control: &Control<'_>| {
        flights.pullback(points, j, d, &mut none, control)
    };
    let free = Control::none();
    assert!(run(&[point], &j[1..], &[1.0; 3], &free).unwrap_err().to_string().contains('J'));
    assert!(run(&[point], &j, &[1.0; 4], &free).is_err());
    assert!(run(&[surface.len() as u32], &j, &[1.0; 3], &free).is_err());
    let stop = AtomicBool::new(true);
    let stopped = run(&[point], &j, &[1.0; 3], &Control::none().with_cancel(&stop));
    assert!(matches!(stopped, Err(StencilError::Cancelled)));
}
