//! The network's gradient against differences of its predictions, where the material of a voxel, or of many, holds a
//! little of another.

mod common;

use std::collections::HashMap;
use std::sync::Arc;

use common::provenance;
use pellucid_predict::{
    BoundPredictor, Changed, Corrected, Correction, Draw, MaterialGradient, MonteCarlo, Network, Object,
    Pass, Predictor, Sharing,
};
use pellucid_rpnn::variant::Head;
use pellucid_rpnn::{Precision, Provenance, TrainedNetwork, Variant, Weights};
use pellucid_voxel::{
    Control, Frame, LabelGrid, Material, MaterialTable, Pitch, Surface, SurfaceOptions, Tile,
};

const DRAW: Draw = Draw::new(0, Pass::Loop(0));
/// Materials whose amounts are moved.
const BASE: u8 = 3;
/// By how much where one voxel is moved: differences stand out of f32 rounding.
const ONE: f32 = 0.02;
/// And where many are: few ReLUs are passed.
const MANY: f32 = 0.002;

/// Three materials in three different channels, and after them, for each two m and k, m with `step` of k added and
/// taken off.
fn materials(step: f32) -> MaterialTable {
    let base: [(&str, [f32; 3], [f32; 3]); BASE as usize] = [
        ("white", [6.0, 9.0, 20.0], [0.5, 0.4, 0.6]),
        ("ink", [2.0, 0.8, 9.0], [0.3, 5.0, 3.0]),
        ("pale", [1.0, 2.0, 1.5], [0.4, 0.3, 0.8]),
    ];
    let material = |name: String, s: [f32; 3], a: [f32; 3]| Material {
        name,
        sigma_s: s.into(),
        sigma_a: a.into(),
        g: 0.4.into(),
    };
    let mut table: Vec<Material> = base.iter().map(|(n, s, a)| material((*n).into(), *s, *a)).collect();
    for (m, (_, s, a)) in base.iter().enumerate() {
        for (k, (_, more_s, more_a)) in base.iter().enumerate() {
            for step in [step, -step] {
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

fn object(grid: &LabelGrid, materials: MaterialTable) -> Arc<Object> {
    let surface = Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap();
    Arc::new(Object::new(surface, materials, 1.5).unwrap())
}

/// A slanted block with specks, a layer and a gap of one voxel, over a thin sheet; some air about it.
fn block(step: f32) -> (LabelGrid, Arc<Object>) {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [26, 20, 44]).unwrap();
    let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(0));
    for z in 3..40u32 {
        for y in 3..17u32 {
            for x in 3..23u32 {
                let solid = z != 20 && !(24..27).contains(&z) && z < 36 + x / 8;
                let label = if z % 7 == 0 { 2 } else { 1 + ((x * 7 + y * 5 + z * 3) % 11 % 3) as u8 };
                grid.set([x, y, z], if solid { label } else { 0 });
            }
        }
    }
    let object = object(&grid, materials(step));
    (grid, object)
}

/// One of random weights whose last layer counts as much as a trained one's, so that surroundings matter, with biases
/// that keep most ReLUs off their bends.
fn network(head: Head, sharing: Option<Sharing>) -> Network {
    let mut weights = Weights::initial(Variant::SharedLevelsAndOctants, head, 2, 8.0);
    for layer in weights.layout().layers.clone() {
        if layer.name == "end3" {
            weights.values_mut()[layer.weight].iter_mut().for_each(|w| *w *= 2.0);
        } else {
            weights.values_mut()[layer.bias].fill(0.3);
        }
    }
    let provenance = Provenance { sigma_a_range: [1e-3, 20.0], ..provenance() };
    let network = Network::new(TrainedNetwork { weights, provenance }, Precision::F32);
    network.with_sharing(sharing).unwrap()
}

const NODES: Sharing = Sharing { spacing_mm: 0.15, fine_levels: 9, coarse_mm: 0.0 };
const NODES_AND_LEVELS: Sharing = Sharing { spacing_mm: 0.15, fine_levels: 3, coarse_mm: 0.4 };
const LEVELS: Sharing = Sharing { spacing_mm: 0.0, fine_levels: 2, coarse_mm: 0.4 };

#[derive(Default)]
struct Sums {
    values: HashMap<([u32; 3], u8), f64>,
    calls: Vec<([u32; 3], u8, u32)>,
    region: Option<[[u32; 3]; 2]>,
}

impl MaterialGradient for Sums {
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
        *self.values.entry((voxel, label)).or_default() += f64::from(derivative);
        self.calls.push((voxel, label, derivative.to_bits()));
    }

    fn region(&self) -> Option<[[u32; 3]; 2]> {
        self.region
    }
}

fn bound(predictor: &dyn Predictor, object: &Arc<Object>, grid: &LabelGrid) -> Box<dyn BoundPredictor> {
    let mut bound = predictor.bind(Arc::clone(object)).unwrap();
    bound.update(grid, Changed::Unknown, &Control::none()).unwrap();
    bound
}

fn pullback(bound: &dyn BoundPredictor, points: &[u32], d_radiance: &[f32]) -> Sums {
    let mut sums = Sums::default();
    bound.pullback(points, DRAW, d_radiance, &mut sums, &Control::none()).unwrap();
    sums
}

fn weighted(bound: &dyn BoundPredictor, points: &[u32], d_radiance: &[f32]) -> f64 {
    let mut out = vec![0.0; d_radiance.len()];
    bound.predict(points, DRAW, &mut out, &Control::none()).unwrap();
    assert!(out.iter().filter(|&&l| l > 0.0).count() > out.len() / 2, "dark outputs prove nothing");
    out.iter().zip(d_radiance).map(|(&l, &d)| f64::from(l) * f64::from(d)).sum()
}

/// Weights of three channels that differ in sign and size.
fn weights(points: &[u32]) -> Vec<f32> {
    (0..3 * points.len()).map(|i| [1.0, -0.6, 0.4][i % 3] * (0.5 + 0.25 * (i % 7) as f32)).collect()
}

/// What the weighted sum of radiance gains by an amount of `k` in every chosen voxel.
struct Compared {
    /// Of predictions, over two steps.
    difference: f64,
    /// What the gradient says.
    derivative: f64,
    /// The sum of what it says of each voxel, in size: most of it may cancel.
    size: f64,
}

impl Compared {
    fn agree(&self, of_derivative: f64, of_size: f64) -> bool {
        let tolerance = of_derivative * self.derivative.abs() + of_size * self.size;
        (self.difference - self.derivative).abs() <= tolerance
    }
}

impl std::fmt::Display for Compared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} for {}, {} in size", self.difference, self.derivative, self.size)
    }
}

fn compared(
    bound: &mut dyn BoundPredictor,
    gradient: &Sums,
    grid: &LabelGrid,
    points: &[u32],
    step: f32,
    k: u8,
    chosen: &dyn Fn([u32; 3]) -> bool,
) -> Compared {
    let d_radiance = weights(points);
    let solid: Vec<[u32; 3]> = voxels(grid).filter(|&v| chosen(v)).collect();
    let of_voxels = || solid.iter().map(|&v| gradient.values.get(&(v, k)).unwrap_or(&0.0));
    let (derivative, size) = (of_voxels().sum(), of_voxels().map(|d| d.abs()).sum());
    let mut with = |more: bool| {
        let mut grid = grid.clone();
        solid.iter().for_each(|&v| grid.set(v, moved(grid.get(v), k, more)));
        bound.update(&grid, Changed::Unknown, &Control::none()).unwrap();
        weighted(bound, points, &d_radiance)
    };
    Compared { difference: (with(true) - with(false)) / f64::from(2.0 * step), derivative, size }
}

fn voxels(grid: &LabelGrid) -> impl Iterator<Item = [u32; 3]> + '_ {
    let [sx, sy, sz] = grid.size();
    let all = (0..sz).flat_map(move |z| (0..sy).flat_map(move |y| (0..sx).map(move |x| [x, y, z])));
    all.filter(|&v| grid.get(v) != 0)
}

/// Points of the block's top, sides and the sheet under it.
fn some_points(object: &Object) -> Vec<u32> {
    object.points().into_iter().step_by(object.surface().len() / 20).collect()
}

#[test]
fn gradients_are_the_limits_of_differences_however_points_share() {
    let (grid, object) = block(MANY);
    let points = some_points(&object);
    let ways = [
        (Head::Radiance, None),
        (Head::Radiance, Some(LEVELS)),
        (Head::FirstFlight, None),
        (Head::FirstFlight, Some(LEVELS)),
        (Head::FirstFlight, Some(NODES)),
        (Head::FirstFlight, Some(NODES_AND_LEVELS)),
    ];
    for (head, sharing) in ways {
        let mut bound = bound(&network(head, sharing), &object, &grid);
        let gradient = pullback(&*bound, &points, &weights(&points));
        // All of the block, its layers at several depths, and a scattered third of it.
        type Part<'a> = (u8, &'a dyn Fn([u32; 3]) -> bool);
        let parts: [Part<'_>; 6] = [
            (1, &|_| true),
            (3, &|_| true),
            (2, &|[_, _, z]| z >= 33),
            (3, &|[_, _, z]| (27..33).contains(&z)),
            (1, &|[_, _, z]| z < 20),
            (2, &|[x, y, z]| (x * 3 + y * 5 + z * 7) % 13 < 4),
        ];
        for (i, (k, part)) in parts.into_iter().enumerate() {
            let found = compared(&mut *bound, &gradient, &grid, &points, MANY, k, part);
            // ReLUs that are passed bend differences: a step of white is a twentieth of what is pale.
            assert!(found.agree(0.02, 0.005), "{head:?} {sharing:?}, part {i}: {found}");
            assert!(found.size > 0.1, "{found}");
        }
    }
}

#[test]
fn single_voxels_on_the_ray_have_their_differences() {
    let (grid, object) = block(ONE);
    // A point of the top; its own column at several depths, across the gap too.
    let point = object.surface().index_of([12, 9, 36]).unwrap();
    for sharing in [None, Some(NODES_AND_LEVELS)] {
        let mut bound = bound(&network(Head::FirstFlight, sharing), &object, &grid);
        let gradient = pullback(&*bound, &[point], &weights(&[point]));
        let found: Vec<Compared> = [36, 35, 33, 30, 27, 23, 19]
            .into_iter()
            .flat_map(|z| (1..=BASE).map(move |k| (z, k)))
            .map(|(z, k)| compared(&mut *bound, &gradient, &grid, &[point], ONE, k, &|v| v == [12, 9, z]))
            .collect();
        let largest = found.iter().fold(0.0f64, |most, f| most.max(f.size));
        assert!(largest > 0.01);
        for (i, found) in found.iter().enumerate() {
            // Radiance of about 1 in f32, after as many roundings as a network has: a few 1e-6 over two steps.
            let error = (found.difference - found.derivative).abs();
            assert!(error < 0.02 * found.size + 0.01 * largest + 1e-4, "{sharing:?} {i}: {found}, {largest}");
        }
    }
}

/// Without weights in its last layer the network gives constants: the flight alone is left.
#[test]
fn a_constant_network_leaves_the_flight_alone() {
    let (grid, object) = block(MANY);
    let mut trained = TrainedNetwork::clone(network(Head::FirstFlight, None).trained());
    let end = trained.weights.layout().layers.iter().find(|l| l.name == "end3").unwrap().weight.clone();
    trained.weights.values_mut()[end].fill(0.0);
    let flat = Network::new(trained, Precision::F32).with_sharing(Some(NODES)).unwrap();
    let mut bound = bound(&flat, &object, &grid);
    let point = object.surface().index_of([12, 9, 36]).unwrap();
    let gradient = pullback(&*bound, &[point], &weights(&[point]));
    let off_the_ray = |v: [u32; 3]| v[0].abs_diff(12) > 8;
    let off = compared(&mut *bound, &gradient, &grid, &[point], MANY, 2, &off_the_ray);
    assert_eq!((off.difference, off.size), (0.0, 0.0));
    let on = compared(&mut *bound, &gradient, &grid, &[point], MANY, 2, &|v| !off_the_ray(v));
    assert!(on.agree(2e-3, 2e-3) && on.size > 0.02, "{on}");
}

#[test]
fn walls_from_clear_to_opaque_have_finite_gradients() {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [16, 10, 22]).unwrap();
    let grid = LabelGrid::from_fn(frame, |[x, _, z]| match z {
        2..6 => 1 + (x % 3) as u8,
        8..20 => 1 + (z % 3) as u8,
        _ => 0,
    });
    let material = |name: &str, s: f32, a: f32| Material {
        name: name.into(),
        sigma_s: vec![s, 2.0 * s, 0.0],
        sigma_a: vec![a, 0.0, 3.0 * a],
        g: 0.4.into(),
    };
    let names = ["r", "g", "b"].map(String::from).to_vec();
    let table = vec![material("none", 0.0, 0.0), material("faint", 1e-6, 1e-6), material("solid", 2e4, 1e4)];
    let object = object(&grid, MaterialTable::new(names, table).unwrap());
    let points = object.points();
    for sharing in [None, Some(NODES_AND_LEVELS)] {
        let bound = bound(&network(Head::FirstFlight, sharing), &object, &grid);
        let sums = pullback(&*bound, &points, &weights(&points));
        assert!(sums.values.values().all(|v| v.is_finite()));
        assert!(sums.values.values().any(|v| v.abs() > 1.0));
    }
}

#[test]
fn gradients_add_up_and_keep_to_their_region() {
    let (grid, object) = block(MANY);
    let points = object.points();
    let bound = bound(&network(Head::FirstFlight, Some(NODES_AND_LEVELS)), &object, &grid);
    let first = weights(&points);
    let second: Vec<f32> = first.iter().rev().map(|d| d * d).collect();
    let both: Vec<f32> = first.iter().zip(&second).map(|(a, b)| 0.5 * a - 2.0 * b).collect();
    let [of_first, of_second, of_both] =
        [&first, &second, &both].map(|d_radiance| pullback(&*bound, &points, d_radiance).values);
    let largest = of_both.values().fold(0.0f64, |most, v| most.max(v.abs()));
    for (at, value) in &of_both {
        let expected = 0.5 * of_first.get(at).unwrap_or(&0.0) - 2.0 * of_second.get(at).unwrap_or(&0.0);
        assert!((value - expected).abs() < 1e-5 * largest, "{at:?}: {value} {expected}");
    }
    // Two halves of the points, one of them cut off in space.
    let half = points.len() / 2;
    let mut halves = pullback(&*bound, &points[..half], &first[..3 * half]);
    bound.pullback(&points[half..], DRAW, &first[3 * half..], &mut halves, &Control::none()).unwrap();
    for (at, value) in &of_first {
        assert!((value - halves.values[at]).abs() < 1e-5 * largest, "{at:?}");
    }
    let region = [[5, 0, 28], [13, 9, 99]];
    let mut some = Sums { region: Some(region), ..Sums::default() };
    bound.pullback(&points, DRAW, &first, &mut some, &Control::none()).unwrap();
    let within = |v: [u32; 3]| (0..3).all(|a| (region[0][a]..region[1][a]).contains(&v[a]));
    let expected = of_first.iter().filter(|((v, _), value)| within(*v) && **value != 0.0);
    assert_eq!(some.values.iter().filter(|(_, v)| **v != 0.0).count(), expected.clone().count());
    for (at, value) in expected {
        assert!((value - some.values[at]).abs() < 1e-5 * largest, "{at:?}");
    }
    // Air gets nothing.
    assert!(of_first.keys().all(|(v, _)| grid.get(*v) != 0));
}

#[test]
fn a_corrected_network_has_the_networks_gradient() {
    let (grid, object) = block(MANY);
    let points = some_points(&object);
    let network = network(Head::FirstFlight, Some(NODES));
    let own = pullback(&*bound(&network, &object, &grid), &points, &weights(&points));
    let corrected = Corrected::new(network, MonteCarlo::new(1).unwrap(), Correction::default()).unwrap();
    assert!(corrected.supports(&object).unwrap().gradient);
    let of_both = pullback(&*bound(&corrected, &object, &grid), &points, &weights(&points));
    assert!(own.calls == of_both.calls && !own.calls.is_empty());
}
