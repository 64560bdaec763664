//! Where the derivative is known.

use pellucid_trace::{Boundary, TraceOptions, Tracking, internal_reflectance};
use pellucid_voxel::Pitch;

use super::sums::{Scene, measured};
use crate::common::{Object, table};

/// Light goes straight through layers that only absorb, and comes back from the far side with a boundary.
#[test]
fn absorbing_layers_follow_beer_and_lambert() {
    let pitch = Pitch::j750();
    let mm = pitch.mm()[2];
    let layers = [1u8, 2, 1, 3, 3, 2, 1];
    let object = Object::new(pitch, [40, 20, 7], |v| layers[v[2] as usize]);
    let sigma_a = [0.4f32, 3.0, 9.0];
    let rows: Vec<_> = sigma_a.iter().map(|&a| (0.0, a, 0.4)).chain([(0.0, 1.0, 0.4)]).collect();
    let table = table(&rows);
    let tau: f64 = layers.iter().map(|&l| f64::from(sigma_a[usize::from(l) - 1]) * mm).sum();
    let t = (-tau).exp();
    let point = object.top();
    for (index, tracking) in
        [(1.0, Tracking::Delta), (1.0, Tracking::Regular), (1.5, Tracking::Delta), (1.5, Tracking::Regular)]
    {
        let r = internal_reflectance(1.0, index);
        let by_length = -t * (1.0 - r) / (1.0 - r * t).powi(2);
        let options = TraceOptions {
            boundary: Boundary::with_index(index).unwrap(),
            tracking,
            ..TraceOptions::default()
        };
        let points = [point];
        let scene = Scene::new(&object, &table, options, &points, &[-2.0]);
        // Label 4 absorbs by 1 per mm: the derivative by its amount is that by sigma_a.
        let column: Vec<[u32; 3]> = (0..7).map(|z| [20, 10, z]).collect();
        let runs: Vec<Vec<f64>> = (0..16)
            .map(|i| {
                let sums = scene.pullback(i, 12_000.0);
                let beside: Vec<_> = sums.values.keys().filter(|(v, _)| (v[0], v[1]) != (20, 10)).collect();
                assert!(beside.is_empty(), "{beside:?} get something");
                column.iter().map(|&v| sums.at(v, 4)).collect()
            })
            .collect();
        for (z, found) in measured(runs).into_iter().enumerate() {
            let exact = -2.0 * by_length * mm;
            let what = format!("layer {z}, n = {index}, {tracking:?}: {found:?} for {exact}");
            assert!((found.mean - exact).abs() < 3.5 * found.error + 1e-4 * exact, "{what}");
            assert!(found.error < 0.005 * exact, "{what}");
        }
    }
}

/// A half-space that meets no other index looks the same at any density, so that what its voxels' derivatives add up
/// to is nothing, though each is not.
#[test]
fn a_half_space_does_not_depend_on_its_density() {
    let object = Object::new(Pitch::j750(), [120, 60, 180], |_| 1);
    let table = table(&[(8.0, 4.0, 0.4)]);
    for tracking in [Tracking::Delta, Tracking::Regular] {
        let options = TraceOptions { boundary: Boundary::Matched, tracking, ..TraceOptions::default() };
        let points = [object.top()];
        let scene = Scene::new(&object, &table, options, &points, &[1.0]);
        let found = scene.functionals(16, 8000.0, |sums| {
            vec![sums.total(|_| Some(1)), sums.values.values().map(|d| d.abs()).sum()]
        });
        let (sum, size) = (found[0], found[1]);
        assert!(sum.mean.abs() < 3.5 * sum.error && sum.error < 0.02 * size.mean, "{sum:?} of {size:?}");
    }
}
