//! The same bytes however the work is done, and linearity.

use pellucid_core::team::Threads;
use pellucid_trace::{InstructionSet, TraceOptions, Tracking};
use pellucid_voxel::{MaterialTable, Pitch};
use proptest::prelude::*;
use rayon::ThreadPoolBuilder;

use super::sums::{Scene, Sums, measured};
use crate::common::{Object, hash};

/// Scattered inks in white.
fn halftone(seed: u32) -> Object {
    Object::new(Pitch::j750(), [30, 18, 40], move |v| {
        let h = hash([v[0] ^ seed << 8, v[1], v[2]]);
        if h.is_multiple_of(3) { 1 + (h / 3 % 5) as u8 } else { 5 }
    })
}

fn weights(points: usize) -> Vec<f32> {
    (0..3 * points).map(|i| ((i * 7919) % 101) as f32 / 50.0 - 1.0).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]
    #[test]
    fn threads_instruction_sets_and_regions_change_no_byte(
        seed in any::<u32>(),
        regular in any::<bool>(),
        paths in 0.3f32..6.0,
        corner in [0u32..20, 0u32..12, 0u32..30],
    ) {
        let object = halftone(seed & 0xff_ffff);
        let table = MaterialTable::cmykw();
        let points: Vec<u32> = (0..object.surface.len() as u32).step_by(3).collect();
        let d_radiance = weights(points.len());
        let tracking = if regular { Tracking::Regular } else { Tracking::Delta };
        let options = TraceOptions { seed: u64::from(seed), tracking, ..TraceOptions::default() };
        let scene = |options| Scene::new(&object, &table, options, &points, &d_radiance);
        let whole = scene(options).pullback(3, paths);
        prop_assert!(!whole.calls.is_empty());
        for (&(v, label), d) in &whole.values {
            prop_assert!(object.grid.get(v) != 0 && (1..=5).contains(&label) && d.is_finite());
        }
        for threads in [1, 2] {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let other = pool.install(|| scene(options).pullback(3, paths));
            prop_assert!(other.calls == whole.calls, "{threads} threads");
        }
        for set in InstructionSet::available() {
            let options = TraceOptions { instruction_set: Some(set), ..options };
            prop_assert!(scene(options).pullback(3, paths).calls == whole.calls, "{set:?}");
        }
        let region = [corner, [corner[0] + 9, corner[1] + 5, corner[2] + 9]];
        let inside = |v: &[u32; 3]| (0..3).all(|a| (region[0][a]..region[1][a]).contains(&v[a]));
        let mut part = Sums { region: Some(region), ..Sums::default() };
        scene(options).pullback_to(3, paths, &mut part);
        let expected: Vec<_> = whole.calls.iter().filter(|(v, _, _)| inside(v)).copied().collect();
        prop_assert_eq!(part.calls, expected);
    }
}

#[test]
fn every_member_of_a_team_gets_the_bytes_of_one_alone() {
    let object = halftone(3);
    let table = MaterialTable::cmykw();
    let points: Vec<u32> = (0..object.surface.len() as u32).collect();
    let d_radiance = weights(points.len());
    let scene = Scene::new(&object, &table, TraceOptions::default(), &points, &d_radiance);
    let whole = scene.pullback(1, 4.0).calls;
    for size in [2, 3] {
        let all = Threads::run(size, |team| scene.pullback_in(&team, 1, 4.0).calls);
        assert!(all.iter().all(|calls| *calls == whole), "{size} members");
    }
}

#[test]
fn weights_times_a_power_of_two_give_derivatives_times_it() {
    let object = halftone(1);
    let table = MaterialTable::cmykw();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(5).collect();
    let weights = weights(points.len());
    let of = |factor: f32| {
        let d_radiance: Vec<f32> = weights.iter().map(|w| w * factor).collect();
        let options = TraceOptions::default();
        let scene = Scene::new(&object, &table, options, &points, &d_radiance);
        scene.pullback(0, 2.0).calls
    };
    let times = |factor: f32| {
        let exact = |&(v, l, bits): &([u32; 3], u8, u32)| (v, l, (f32::from_bits(bits) * factor).to_bits());
        of(1.0).iter().map(exact).collect::<Vec<_>>()
    };
    for factor in [-1.0, 0.25, -8.0] {
        assert_eq!(of(factor), times(factor), "{factor}");
    }
}

#[test]
fn sums_of_weights_give_sums_of_derivatives_on_average() {
    let object = halftone(2);
    let table = MaterialTable::cmykw();
    let points: Vec<u32> = (0..object.surface.len() as u32).step_by(7).collect();
    let a = weights(points.len());
    let b: Vec<f32> = (0..a.len()).map(|i| if i % 4 == 0 { 3.0 } else { -0.1 }).collect();
    let both: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a + b).collect();
    // Any linear functional will do; these tell depths and labels apart.
    let functionals = |d_radiance: &[f32], first: u32| {
        let options = TraceOptions::default();
        let scene = Scene::new(&object, &table, options, &points, d_radiance);
        let of = |sums: &Sums| -> Vec<f64> {
            (1..=5u8)
                .flat_map(|l| {
                    let part = |top: bool| sums.total(|v| ((v[2] >= 20) == top).then_some(l));
                    [part(false), part(true)]
                })
                .collect()
        };
        measured((first..first + 24).map(|i| of(&scene.pullback(i, 8.0))).collect())
    };
    let (of_a, of_b, of_both) = (functionals(&a, 0), functionals(&b, 100), functionals(&both, 200));
    for ((a, b), both) in of_a.iter().zip(&of_b).zip(&of_both) {
        let error = a.error.hypot(b.error).hypot(both.error);
        let z = (a.mean + b.mean - both.mean) / error;
        assert!(z.abs() < 3.5, "{a:?} and {b:?} for {both:?}, z = {z:.2}");
    }
}
