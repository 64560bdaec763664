//! Against differences of radiances.

use pellucid_trace::{Boundary, TraceOptions, Tracking};
use pellucid_voxel::{Material, MaterialTable, Pitch};

use super::sums::{Measured, Scene, measured, rgb};
use crate::common::Object;

/// White, three inks, and probes that only absorb or only scatter by 1 per mm; g 0.4. No voxel is a probe, so that the
/// derivative by the amount of a probe is that by a coefficient.
fn inks() -> MaterialTable {
    rgb(&[
        ([(6.0, 0.01), (9.0, 0.005), (24.0, 0.03)], 0.4),
        ([(0.9, 6.0), (3.2, 1.4), (7.0, 0.3)], 0.4),
        ([(2.4, 0.1), (0.8, 2.5), (9.0, 1.0)], 0.4),
        ([(2.2, 0.3), (3.7, 0.2), (4.0, 12.0)], 0.4),
        ([(0.0, 1.0); 3], 0.4),
        ([(1.0, 0.0); 3], 0.4),
    ])
}

const ABSORBS: u8 = 5;
const SCATTERS: u8 = 6;

/// The table with a material's coefficients of one kind times `factor` in every channel.
fn scaled(table: &MaterialTable, label: u8, scatters: bool, factor: f32) -> MaterialTable {
    let mut materials: Vec<Material> = table.materials().to_vec();
    let m = &mut materials[usize::from(label) - 1];
    let row = if scatters { &mut m.sigma_s } else { &mut m.sigma_a };
    row.iter_mut().for_each(|v| *v *= factor);
    MaterialTable::new(table.channel_names().to_vec(), materials).unwrap()
}

/// Half the step of differences, relative.
const STEP: f32 = 0.1;

/// The derivative of the weighted sum by the logarithm of a factor on a table's coefficients, channel by channel, from
/// differences with common random numbers.
fn differences(scene: &Scene<'_>, with: impl Fn(f32) -> MaterialTable) -> Vec<Measured> {
    let (up, down) = (with(1.0 + STEP), with(1.0 - STEP));
    let rows = (0..12).map(|i| {
        let (up, down) = (scene.weighted(i, &up), scene.weighted(i, &down));
        up.iter().zip(down).map(|(up, down)| (up - down) / f64::from(2.0 * STEP)).collect()
    });
    measured(rows.collect())
}

/// Compares, for one channel at a time, what the voxels of each label add up to; standard errors must be at most a part
/// `most` of it, or of a tenth of what a perfect white would shine, where there is less.
fn compare(object: &Object, options: TraceOptions, points: &[u32], labels: &[u8], most: f64) {
    let table = inks();
    // Weights that differ between points.
    let weights: Vec<f32> = (0..3 * points.len()).map(|i| 0.5 + 0.25 * (i / 3 % 4) as f32).collect();
    let scene = Scene::new(object, &table, options, points, &weights);
    let kinds: Vec<(u8, bool)> = labels.iter().flat_map(|&l| [(l, false), (l, true)]).collect();
    let expected: Vec<Vec<Measured>> = kinds
        .iter()
        .map(|&(label, scatters)| differences(&scene, |factor| scaled(&table, label, scatters, factor)))
        .collect();
    let white = f64::from(weights.iter().sum::<f32>() / 3.0);
    for channel in 0..3 {
        let d_radiance: Vec<f32> =
            weights.iter().enumerate().map(|(i, &w)| if i % 3 == channel { w } else { 0.0 }).collect();
        let scene = Scene { d_radiance: &d_radiance, ..scene };
        let found = scene.functionals(12, 1500.0, |sums| {
            let of = |&(label, scatters): &(u8, bool)| {
                let m = table.get(label).unwrap();
                let (probe, sigma) =
                    if scatters { (SCATTERS, m.sigma_s[channel]) } else { (ABSORBS, m.sigma_a[channel]) };
                f64::from(sigma) * sums.total(|v| (object.grid.get(v) == label).then_some(probe))
            };
            kinds.iter().map(of).collect()
        });
        for ((found, expected), (label, scatters)) in found.iter().zip(&expected).zip(&kinds) {
            let expected = expected[channel];
            let kind = if *scatters { "scattering" } else { "absorption" };
            let what = format!("{kind} of label {label} in channel {channel}");
            found.agrees(expected, most * expected.mean.abs().max(0.1 * white), &what);
        }
    }
}

/// Points of the top, some of them above the blobs.
fn above(object: &Object, at: &[[u32; 2]]) -> Vec<u32> {
    let z = object.grid.size()[2] - 1;
    at.iter().map(|&[x, y]| object.surface.index_of([x, y, z]).unwrap()).collect()
}

#[test]
fn blobs_at_several_depths() {
    let pitch = Pitch::j750();
    let size = [60, 30, 80];
    // At the surface, 0.2 mm and 0.5 mm deep.
    let blobs = [(2u8, [14, 14], 74..80), (3, [30, 15], 66..73), (4, [44, 16], 50..62)];
    let object = Object::new(pitch, size, |v| {
        blobs
            .iter()
            .find(|(_, at, z)| v[0].abs_diff(at[0]) < 7 && v[1].abs_diff(at[1]) < 4 && z.contains(&v[2]))
            .map_or(1, |b| b.0)
    });
    let points = above(&object, &[[14, 14], [18, 13], [30, 15], [33, 17], [44, 16], [39, 15]]);
    for options in [
        TraceOptions { spp: 4000, tracking: Tracking::Delta, ..TraceOptions::default() },
        TraceOptions {
            spp: 4000,
            tracking: Tracking::Regular,
            boundary: Boundary::Matched,
            ..TraceOptions::default()
        },
    ] {
        compare(&object, options, &points, &[2, 3, 4], 0.075);
    }
}

#[test]
fn a_thin_sheet_of_two_materials() {
    let object = Object::new(Pitch::j750(), [48, 24, 3], |v| 1 + 2 * ((v[0] / 8 + v[1] / 4) % 2) as u8);
    let points = above(&object, &[[22, 12], [26, 12], [24, 10], [24, 14]]);
    let options = TraceOptions { spp: 12_000, ..TraceOptions::default() };
    compare(&object, options, &points, &[1, 3], 0.04);
}

/// What the voxels' own materials add up to is the derivative by the density of the whole.
#[test]
fn all_voxels_together_are_the_density() {
    let object = Object::new(Pitch::j750(), [40, 20, 40], |v| 1 + ((v[0] / 5 + v[2] / 9) % 4) as u8);
    let table = inks();
    let at = |v: [u32; 3]| Some(object.grid.get(v));
    let points = above(&object, &[[12, 9], [20, 10], [29, 11]]);
    let options = TraceOptions { spp: 12_000, ..TraceOptions::default() };
    let d_radiance: Vec<f32> = (0..9).map(|i| [1.0, 0.5, 0.75][i % 3]).collect();
    let scene = Scene::new(&object, &table, options, &points, &d_radiance);
    let found: Vec<Measured> = (0..3)
        .map(|channel| {
            let d_radiance: Vec<f32> =
                d_radiance.iter().enumerate().map(|(i, &w)| if i % 3 == channel { w } else { 0.0 }).collect();
            let scene = Scene { d_radiance: &d_radiance, ..scene };
            scene.functionals(12, 4000.0, |sums| vec![sums.total(at)])[0]
        })
        .collect();
    let with = |factor: f32| {
        let materials = table.materials().iter().cloned().map(|mut m| {
            m.sigma_s.iter_mut().chain(&mut m.sigma_a).for_each(|v| *v *= factor);
            m
        });
        MaterialTable::new(table.channel_names().to_vec(), materials.collect()).unwrap()
    };
    let expected = differences(&scene, with);
    for channel in 0..3 {
        let what = format!("density in channel {channel}");
        found[channel].agrees(expected[channel], 0.04 * expected[channel].mean.abs().max(0.5), &what);
    }
}
