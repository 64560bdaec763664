//! Counts against the voxel-by-voxel definition.

mod common;

use common::*;
use pellucid_stencil::{StencilError, StencilSpec, Stencils};
use pellucid_voxel::Control;
use proptest::prelude::*;

fn specs() -> impl Strategy<Value = StencilSpec> {
    prop_oneof![
        3 => (1usize..=6).prop_map(|levels| StencilSpec::new([5, 3, 9], levels).unwrap()),
        1 => (1usize..=5).prop_map(|levels| StencilSpec::new([1, 7, 3], levels).unwrap()),
        1 => (1usize..=7).prop_map(|levels| StencilSpec::new([3, 1, 1], levels).unwrap()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn counts_equal_the_definition(
        spec in specs(),
        kind: u8,
        labels in prop_oneof![Just(1u8), Just(5), Just(6)],
        size in [1u32..50, 1u32..50, 1u32..50],
        seed: u64,
        picks in prop::collection::vec([any::<u32>(), any::<u32>(), any::<u32>()], 1..4),
    ) {
        let grid = test_grid(kind, labels, size, seed);
        let sat = sat_of(&grid, labels.into());
        let points: Vec<[u32; 3]> =
            picks.iter().map(|p| std::array::from_fn(|a| p[a] % size[a])).collect();
        let counts = counts_of(spec, &grid, &sat, &points);
        for (p, counts) in points.iter().zip(counts.chunks_exact(counts.len() / points.len())) {
            prop_assert_eq!(counts, &naive_counts(spec, &grid, labels.into(), *p)[..]);
        }
    }
}

#[test]
fn nine_levels_count_the_whole_object_once() {
    let spec = StencilSpec::paper();
    let size = [70, 60, 90];
    let grid = test_grid(0, 5, size, 11);
    let sat = sat_of(&grid, 5);
    let points = [[35, 30, 1], [0, 0, 0], [69, 59, 89]];
    let counts = counts_of(spec, &grid, &sat, &points);
    let histogram = grid.histogram();
    let level = spec.cells_per_level() * 5;
    for point in counts.chunks_exact(spec.cells_in_all() * 5) {
        // Levels 8 and 9 reach past the object on all sides.
        for counts in point[7 * level..].chunks_exact(level) {
            for m in 0..5 {
                let sum: u64 = counts.iter().skip(m).step_by(5).map(|&n| u64::from(n)).sum();
                assert_eq!(sum, 8 * histogram[m + 1]);
            }
        }
    }
}

#[test]
fn refuses_what_does_not_fit() {
    let grid = test_grid(1, 5, [20, 20, 20], 3);
    let sat = sat_of(&grid, 5);
    let other = test_grid(1, 5, [20, 20, 21], 3);
    let spec = StencilSpec::new([5, 3, 9], 2).unwrap();
    assert!(Stencils::new(spec, &other, &sat).is_err());
    let stencils = Stencils::new(spec, &grid, &sat).unwrap();
    let none = Control::none();
    let mut out = vec![0; spec.cells_in_all() * 5];
    assert!(stencils.extract_counts(&[[20, 0, 0]], &mut out, &none).is_err());
    assert!(stencils.extract_counts(&[[0; 3]; 2], &mut out, &none).is_err());
    assert!(matches!(StencilSpec::new([4, 3, 9], 2), Err(StencilError::Invalid { .. })));
    assert!(matches!(StencilSpec::new([5, 3, 9], 0), Err(StencilError::Invalid { .. })));
    assert!(matches!(StencilSpec::new([5, 3, 33], 9), Err(StencilError::Unsupported { .. })));
    let stop = std::sync::atomic::AtomicBool::new(true);
    let cancelled = Control::none().with_cancel(&stop);
    assert!(matches!(stencils.extract_counts(&[[0; 3]], &mut out, &cancelled), Err(StencilError::Cancelled)));
}
