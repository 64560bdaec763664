//! The derivative whose part by scattering is averaged over boxes.

use std::collections::BTreeMap;

use pellucid_trace::{AdjointOptions, InstructionSet, TraceOptions};
use pellucid_voxel::{MaterialTable, Pitch};

use super::sums::{Scene, Sums, measured, rgb};
use crate::common::{Object, hash};

/// What scatters by 1 /mm and absorbs nothing, and the same with absorption: neither is in the object.
const PROBE: u8 = 4;
const DARK: u8 = 5;

/// Derivatives are rounded to 6e-8 of themselves, and what is compared are differences and sums of them, which may be a
/// thousand times smaller.
const ROUNDING: f64 = 1e-4;

fn table() -> MaterialTable {
    rgb(&[
        ([(0.5, 4.0), (3.0, 1.0), (7.0, 0.2)], 0.4),
        ([(0.0, 2.0), (0.3, 0.0), (9.0, 1.0)], 0.4),
        ([(6.0, 0.01), (9.0, 0.003), (24.0, 0.02)], 0.4),
        ([(1.0, 0.0); 3], 0.4),
        ([(1.0, 3.0), (1.0, 2.0), (1.0, 1.0)], 0.4),
    ])
}

fn object() -> Object {
    Object::new(Pitch::j750(), [19, 10, 23], |v| [3, 3, 1, 2][hash(v) as usize % 4])
}

fn pullback(scene: &Scene<'_>, set: Option<InstructionSet>, pooled: bool, iteration: u32) -> Sums {
    let mut sums = Sums::default();
    let scene = Scene { options: TraceOptions { instruction_set: set, ..scene.options }, ..*scene };
    scene.pullback_by(iteration, &AdjointOptions { paths: 3.0, pooled }, &mut sums);
    sums
}

#[test]
fn boxes_keep_their_weighted_mean_and_voxels_their_absorption() {
    let (object, table) = (object(), table());
    let points: Vec<u32> = (0..object.surface.len() as u32).collect();
    // One channel alone, whose coefficients weigh.
    for channel in 0..3 {
        let mut d_radiance = vec![0.0; 3 * points.len()];
        d_radiance[channel..].iter_mut().step_by(3).enumerate().for_each(|(i, r)| *r = 1.0 - (i % 3) as f32);
        let options = TraceOptions::default();
        let scene = Scene::new(&object, &table, options, &points, &d_radiance);
        let [plain, pooled] = [false, true].map(|pooled| pullback(&scene, None, pooled, 0));
        for set in InstructionSet::available() {
            assert!(pullback(&scene, Some(set), true, 0).calls == pooled.calls, "{set:?}");
        }
        let mut boxes: BTreeMap<[u32; 3], Vec<[u32; 3]>> = BTreeMap::new();
        for &(voxel, label) in pooled.values.keys() {
            if label == PROBE {
                boxes.entry(voxel.map(|v| v / 4)).or_default().push(voxel);
            }
            // Absorption alone tells these apart.
            if label == DARK && plain.values.contains_key(&(voxel, DARK)) {
                let by_absorption = |sums: &Sums| sums.at(voxel, DARK) - sums.at(voxel, PROBE);
                let (a, b) = (by_absorption(&plain), by_absorption(&pooled));
                assert!((a - b).abs() < ROUNDING * a.abs().max(1.0), "{voxel:?}: {a} {b}");
            }
        }
        for voxels in boxes.values() {
            let sigma_s = |v: &[u32; 3]| f64::from(table.get(object.grid.get(*v)).unwrap().sigma_s[channel]);
            let weighed = |sums: &Sums| voxels.iter().map(|v| sigma_s(v) * sums.at(*v, PROBE)).sum::<f64>();
            let size = voxels.iter().map(|v| sigma_s(v) * plain.at(*v, PROBE).abs()).sum::<f64>();
            let (a, b) = (weighed(&plain), weighed(&pooled));
            assert!((a - b).abs() < ROUNDING * size.max(1.0), "{voxels:?}: {a} {b}");
            let first = pooled.at(voxels[0], PROBE);
            assert!(
                voxels.iter().all(|v| (pooled.at(*v, PROBE) - first).abs() < ROUNDING * first.abs().max(1.0))
            );
        }
    }
}

#[test]
fn pooling_takes_noise_away_from_what_scatters_little() {
    let (object, table) = (object(), table());
    let points: Vec<u32> = (0..object.surface.len() as u32).collect();
    let d_radiance = vec![1.0; 3 * points.len()];
    let options = TraceOptions::default();
    let scene = Scene::new(&object, &table, options, &points, &d_radiance);
    // White in place of cyan in a voxel under the surface.
    let cyan = (0..19).map(|x| [x, 5, 20]).find(|&v| object.grid.get(v) == 1).unwrap();
    let noise = |pooled| {
        let rows = (0..24).map(|i| {
            let sums = pullback(&scene, None, pooled, i);
            vec![sums.at(cyan, 3) - sums.at(cyan, 1)]
        });
        measured(rows.collect())[0].error
    };
    // Of 24 runs a standard error is known to 15 %.
    let (plain, pooled) = (noise(false), noise(true));
    assert!(pooled < 0.5 * plain, "{pooled} of {plain}");
}
