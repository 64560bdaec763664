//! Every form of the kernels gives the scalar form's bits.

use pellucid_voxel::sat::tables::LANES;
use pellucid_voxel::{Control, CountSat, Frame, LabelGrid, Pitch, TILE_VOXELS, Tile};
use proptest::prelude::*;

use super::*;
use crate::axis::{Axis, Extent};
use crate::lattice::{Corners, Member};

/// The forms of this processor other than the scalar one.
fn forms() -> Vec<Kernel> {
    let mut forms: Vec<Kernel> = InstructionSet::available().map(Kernel::of).collect();
    forms.dedup();
    forms.retain(|form| *form != Kernel::Scalar);
    forms
}

fn grid(size: [u32; 3], seed: u64) -> LabelGrid {
    let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
    LabelGrid::from_tiles(frame, |t| {
        let h = (t[0] + 5 * t[1] + 11 * t[2]) as u64 ^ seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let h = h.wrapping_mul(0xff51_afd7_ed55_8ccd) >> 20;
        if h.is_multiple_of(3) {
            return Tile::Constant((h >> 8) as u8 % 7);
        }
        let mut tile = Box::new([0; TILE_VOXELS]);
        for (i, label) in tile.iter_mut().enumerate() {
            *label = ((h + i as u64).wrapping_mul(0xc4ce_b9fe_1a85_ec53) >> 40) as u8 % 7;
        }
        Tile::Dense(tile)
    })
}

fn lanes(sums: &[Sums]) -> Vec<&[u32]> {
    sums.iter().map(|s| &s[..LANES]).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn corner_sums_agree(
        size in [1u32..70, 1u32..70, 1u32..70],
        seed: u64,
        level in 1usize..7,
        picks in prop::collection::vec([any::<u32>(), any::<u32>(), any::<u32>()], 1..140),
    ) {
        let grid = grid(size, seed);
        let sat = CountSat::build(&grid, 6, &Control::none()).unwrap();
        let Some((low, high)) = sat.bounds() else { return Ok(()) };
        for tables in sat.groups() {
            let axes: [Axis; 3] = std::array::from_fn(|a| {
                let extent = Extent { size: size[a], low: low[a], high: high[a], stride: tables.strides()[a] };
                Axis::new([5, 3, 9][a], 1 << level, extent, picks.iter().map(|p| p[a] % size[a]))
            });
            let mut expected = vec![Sums::default(); picks.len() * 24];
            let mut sums = expected.clone();
            for k in 0..10 {
                let plane = Plane { tables, axes: &axes, n: [6, 4], k };
                Kernel::Scalar.corner_sums(&plane, &mut expected);
                for form in forms() {
                    form.corner_sums(&plane, &mut sums);
                    prop_assert_eq!(lanes(&sums), lanes(&expected), "{:?}", form);
                }
            }
        }
    }

    #[test]
    fn lattice_sums_agree(
        size in [1u32..70, 1u32..70, 1u32..70],
        seed: u64,
        level in 4usize..7,
        centre in [any::<u32>(), any::<u32>(), any::<u32>()],
        steps in prop::collection::vec([0u32..16, 0u32..16, 0u32..16], 1..60),
    ) {
        let grid = grid(size, seed);
        let sat = CountSat::build(&grid, 6, &Control::none()).unwrap();
        let Some((low, high)) = sat.bounds() else { return Ok(()) };
        let (n, edge) = ([5, 3, 9], 1 << level);
        let members: Vec<Member> = steps
            .iter()
            .map(|s| Member::new(std::array::from_fn(|a| (centre[a] % size[a] + s[a]) % size[a]), 0, n, edge))
            .collect();
        let mut members: Vec<Member> = members.iter().filter(|m| m.tile == members[0].tile).copied().collect();
        members.sort_by_key(|m| m.split() != 0);
        for tables in sat.groups() {
            let corners: Vec<Corners> = (0..3)
                .filter_map(|a| {
                    let extent = Extent { size: size[a], low: low[a], high: high[a], stride: tables.strides()[a] };
                    Corners::new(n[a], edge, members[0].tile[a].into(), extent)
                })
                .collect();
            let Ok(axes) = <[Corners; 3]>::try_from(corners) else { return Ok(()) };
            for next in 0..8 {
                let pass = || Pass::new(tables, size, &axes, &members, next);
                let (Some(mut first), Some(mut second)) = (pass(), pass()) else { continue };
                let shape = [axes[0].tiles.len(), axes[1].tiles.len()];
                let blank = vec![Sums::default(); shape[0] * shape[1] * members.len()];
                let (mut expected, mut sums) = (blank.clone(), blank.clone());
                let mut columns = [blank.clone(), blank.clone()];
                let cells = Cells { corners: shape, points: members.len(), first: 0, width: shape[0], stride: shape[0] * shape[1] };
                for k in 0..axes[2].tiles.len() {
                    Kernel::Scalar.plane_sums(&mut first, members.len(), k, [0; 2], shape[0], &mut expected);
                    let mut counts = [blank.clone(), blank.clone()];
                    Kernel::Scalar.plane_cells(&cells, &expected, &mut columns[0], &mut counts[0]);
                    for form in forms() {
                        form.plane_sums(&mut second, members.len(), k, [0; 2], shape[0], &mut sums);
                        prop_assert_eq!(lanes(&sums), lanes(&expected), "{:?}", form);
                        form.plane_cells(&cells, &sums, &mut columns[1], &mut counts[1]);
                        prop_assert_eq!(lanes(&counts[1]), lanes(&counts[0]), "{:?}", form);
                    }
                }
            }
        }
    }

    #[test]
    fn unpacking_agrees(counts in prop::collection::vec((prop::array::uniform5(0u64..=819), 0usize..8), 0..40)) {
        let word = |(counts, full): &([u64; 5], usize)| match packed::UNITS.get(*full) {
            Some(unit) => unit.wrapping_mul(packed::MAX_COUNT.into()),
            None => counts.iter().zip(packed::UNITS).map(|(n, unit)| n * unit).sum(),
        };
        let words: Vec<u64> = counts.iter().map(word).collect();
        let (mut expected, mut cells) = (vec![Sums::default(); words.len()], vec![Sums::default(); words.len()]);
        Kernel::Scalar.unpack(&words, &mut expected);
        for form in forms() {
            form.unpack(&words, &mut cells);
            prop_assert_eq!(lanes(&cells), lanes(&expected), "{:?}", form);
        }
    }

    #[test]
    fn features_and_differences_agree(
        counts in prop::collection::vec(any::<[u32; 8]>(), 24..=24),
        values in prop::collection::vec(prop_oneof![0f32..30.0, Just(0.0), Just(1e-12), Just(1e6), Just(f32::MIN_POSITIVE)], 96..=96),
        exponent in -30i32..0,
    ) {
        let counts: Vec<Sums> = counts.iter().map(|c| c.map(|n| n >> 5)).collect();
        let values: Vec<f64> = values.into_iter().map(f64::from).collect();
        for (f, starts) in [(2, vec![0, 30, 60, 90, 200]), (3, vec![0, 40, 200]), (2, vec![7])] {
            let rows = Rows { values: &values, width: 16, features: f, factor: f64::powi(2.0, exponent) };
            let mut expected = vec![-1.0; 240];
            Kernel::Scalar.features(&rows, 6, &counts, 12, starts.iter().copied(), &mut expected);
            for form in forms() {
                let mut out = vec![-1.0; expected.len()];
                form.features(&rows, 6, &counts, 12, starts.iter().copied(), &mut out);
                let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
                prop_assert_eq!(bits(&out), bits(&expected));
            }
        }
        let two = Rows { values: &values, width: 16, features: 2, factor: f64::powi(2.0, exponent) };
        for (cells, materials) in [(8, 5), (24, 3), (13, 5), (7, 5)] {
            let mut expected = vec![-1.0; 240];
            Kernel::Scalar.features(&two, materials, &counts, cells, [0, 60, 130].into_iter(), &mut expected);
            for form in forms() {
                let mut out = vec![-1.0; expected.len()];
                form.features(&two, materials, &counts, cells, [0, 60, 130].into_iter(), &mut out);
                prop_assert!(out.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()));
            }
        }
        for form in forms() {
            let (mut columns, mut cells) = (counts[..15].to_vec(), vec![Sums::default(); 15]);
            let (mut same_columns, mut same_cells) = (columns.clone(), cells.clone());
            Kernel::Scalar.cell_counts(5, &counts, &mut columns, &mut cells);
            form.cell_counts(5, &counts, &mut same_columns, &mut same_cells);
            prop_assert_eq!((columns, cells), (same_columns, same_cells));
        }
    }
}
