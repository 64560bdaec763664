//! Nothing where no path goes, and media at the edge of what a tracer stands.

use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_trace::{AdjointOptions, Derivatives, TraceError, TraceOptions, Tracer};
use pellucid_voxel::{Control, MaterialTable, Pitch};

use super::sums::{Scene, Sums};
use crate::common::{Object, dielectric, hash, matched, table};

#[test]
fn nothing_where_no_path_goes() {
    // Two blocks apart, the first with a black floor that nothing passes.
    let object = Object::new(Pitch::j750(), [60, 20, 50], |v| match v {
        [26..34, _, _] => 0,
        [_, _, z] if z < 10 => 1,
        [_, _, z] if z < 20 => 2,
        _ => 1,
    });
    let table = table(&[(9.0, 0.5, 0.4), (0.0, 1e5, 0.4)]);
    let point = object.surface.index_of([13, 10, 49]).unwrap();
    let options = dielectric(1);
    let points = [point];
    let scene = Scene::new(&object, &table, options, &points, &[1.0]);
    let sums = scene.pullback(0, 20_000.0);
    assert!(sums.values.len() > 1000);
    for ((v, _), d) in &sums.values {
        assert!(object.grid.get(*v) != 0);
        assert!(*d == 0.0 || v[0] < 26, "the other block gets {d} in {v:?}");
        assert!(*d == 0.0 || v[2] >= 20, "below what is black {d} in {v:?}");
    }
    let none = Scene { d_radiance: &[0.0], ..scene }.pullback(0, 1e4);
    assert!(none.calls.is_empty());
}

#[test]
fn media_at_the_edge() {
    let object = Object::new(Pitch::j750(), [60, 30, 90], |v| 1 + (hash(v.map(|x| x / 4)) % 5) as u8);
    let rows = [(0.0, 0.0, 0.4), (1e5, 0.0, 0.99), (0.0, 1e5, -0.99), (1e-4, 1e-6, 0.0), (9.0, 0.01, 0.4)];
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(97).collect();
    let d_radiance = vec![0.5; points.len()];
    for options in [matched(1), dielectric(1)] {
        let table = table(&rows);
        let scene = Scene::new(&object, &table, options, &points, &d_radiance);
        let sums = scene.pullback(0, 16.0);
        assert!(sums.values.len() > 1000);
        assert!(sums.values.values().all(|d| d.is_finite()));
    }
    // All clear: L is 1, and more of what absorbs takes the length of the column.
    let clear = Object::new(Pitch::j750(), [60, 30, 20], |_| 1);
    let table = table(&[(0.0, 0.0, 0.4), (0.0, 1.0, 0.4)]);
    let points = [clear.top()];
    let options = matched(1);
    let scene = Scene::new(&clear, &table, options, &points, &[1.0]);
    let sums = scene.pullback(0, 4096.0);
    let total = sums.total(|_| Some(2));
    assert!((total + 20.0 * Pitch::j750().mm()[2]).abs() < 1e-4, "{total}");
}

#[test]
fn who_wants_nothing_gets_nothing() {
    struct Nothing;
    impl Derivatives for Nothing {
        fn add(&mut self, voxel: [u32; 3], _: u8, _: f32) {
            panic!("{voxel:?} was not wanted");
        }
        fn wants(&self, _: [u32; 3], _: [u32; 3]) -> bool {
            false
        }
    }
    let object = Object::new(Pitch::j750(), [30, 18, 40], |v| 1 + (hash(v) % 5) as u8);
    let materials = MaterialTable::cmykw();
    let tracer = Tracer::new(&object.volume, &materials, TraceOptions::default()).unwrap();
    let options = AdjointOptions::default();
    let paths = tracer.pullback(&[0, 1], 0, &[1.0; 6], &options, &mut Nothing, &Control::none()).unwrap();
    assert_eq!(paths, 0);
}

#[test]
fn unwanted_boxes_and_stops_and_refusals() {
    struct Half(Sums);
    impl Derivatives for Half {
        fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32) {
            self.0.add(voxel, label, derivative);
        }
        fn wants(&self, first: [u32; 3], end: [u32; 3]) -> bool {
            assert!((0..3).all(|a| first[a] < end[a] && end[a] - first[a] <= 4));
            first[2] >= 16
        }
    }
    let object = Object::new(Pitch::j750(), [30, 18, 40], |v| 1 + (hash(v) % 5) as u8);
    let materials = MaterialTable::cmykw();
    let points: Vec<u32> = (0..object.surface.len() as u32).collect();
    let d_radiance = vec![1.0; 3 * points.len()];
    let tracer = Tracer::new(&object.volume, &materials, TraceOptions::default()).unwrap();
    let options = AdjointOptions::default();
    let (mut all, mut half) = (Sums::default(), Half(Sums::default()));
    let traced = tracer.pullback(&points, 1, &d_radiance, &options, &mut all, &Control::none()).unwrap();
    assert_eq!(traced, 2 * d_radiance.len() as u64);
    tracer.pullback(&points, 1, &d_radiance, &options, &mut half, &Control::none()).unwrap();
    let expected: Vec<_> = all.calls.iter().filter(|(v, _, _)| v[2] >= 16).copied().collect();
    assert_eq!(half.0.calls, expected);

    let stop = AtomicBool::new(false);
    let report = |done: u64, total: u64| {
        assert_eq!(total, traced);
        if done * 3 > total {
            stop.store(true, Ordering::Relaxed);
        }
    };
    let control = Control::none().with_cancel(&stop).with_progress(&report);
    let result = tracer.pullback(&points, 1, &d_radiance, &options, &mut all, &control);
    assert!(matches!(result, Err(TraceError::Cancelled)));

    let none = Control::none();
    let mut refused = |points: &[u32], d: &[f32], paths| {
        let options = AdjointOptions { paths, ..AdjointOptions::default() };
        matches!(tracer.pullback(points, 0, d, &options, &mut all, &none), Err(TraceError::Invalid(_)))
    };
    assert!(refused(&[0], &[1.0; 2], 1.0));
    assert!(refused(&[points.len() as u32], &[1.0; 3], 1.0));
    assert!(refused(&[0], &[1.0, f32::NAN, 1.0], 1.0));
    for paths in [0.0, -1.0, f32::NAN, f32::INFINITY, 2e6] {
        assert!(refused(&[0], &[1.0; 3], paths));
    }
}
