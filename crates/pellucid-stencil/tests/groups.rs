//! Points of one tile, whose coarse levels are looked up together.

mod common;

use common::*;
use pellucid_stencil::StencilSpec;
use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn together_and_one_by_one_count_the_same(
        kind: u8,
        labels in prop_oneof![Just(1u8), Just(5), Just(6)],
        size in [1u32..90, 1u32..70, 1u32..100],
        seed: u64,
        cells in prop_oneof![2 => Just([5, 3, 9]), 1 => Just([1, 3, 3])],
        centre in [any::<u32>(), any::<u32>(), any::<u32>()],
        steps in prop::collection::vec([0u32..20, 0u32..20, 0u32..20], 1..150),
    ) {
        let grid = test_grid(kind, labels, size, seed);
        let sat = sat_of(&grid, labels.into());
        let spec = StencilSpec::new(cells, 7).unwrap();
        let points: Vec<[u32; 3]> =
            steps.iter().map(|s| std::array::from_fn(|a| (centre[a] % size[a] + s[a]) % size[a])).collect();
        let together = counts_of(spec, &grid, &sat, &points);
        let row = together.len() / points.len();
        let level = spec.cells_per_level() * usize::from(labels);
        for (p, counts) in points.iter().zip(together.chunks_exact(row)).step_by(7) {
            let alone = counts_of(spec, &grid, &sat, &[*p]);
            for k in 0..7 {
                let range = k * level..(k + 1) * level;
                prop_assert_eq!(&counts[range.clone()], &alone[range], "level {} of {:?}", k, p);
            }
        }
    }
}
