//! The adjoint against the stencil: <S x, y> = <x, S^T y>.

mod common;

use common::*;
use pellucid_stencil::{Coefficients, Features, LevelScale, Region, StencilSpec, scatter};
use pellucid_voxel::Control;
use proptest::prelude::*;

fn gradients(len: usize, seed: u64) -> Vec<f32> {
    (0..len).map(|i| (hash([i as i64, 1, 2], seed) % 2001) as f32 / 1000.0 - 1.0).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn dot_products_agree(
        kind: u8,
        labels in prop_oneof![Just(3u8), Just(6)],
        size in [1u32..30, 1u32..30, 1u32..30],
        seed: u64,
        picks in prop::collection::vec(any::<[u32; 3]>(), 1..4),
        levels in 1usize..=7,
        with_occupancy: bool,
        isometric: bool,
    ) {
        let scale = if isometric { LevelScale::Isometric { gamma: 6 } } else { LevelScale::Raw };
        let spec = StencilSpec::new([5, 3, 9], levels).unwrap().with_scale(scale).unwrap();
        let features = if with_occupancy { Features::WithOccupancy } else { Features::ScatterAbsorb };
        let grid = test_grid(kind, labels, size, seed);
        let sat = sat_of(&grid, labels.into());
        let table = table_of(labels.into(), 2, seed, 1.0);
        // A repeated channel has gradients of its own.
        let coefficients = Coefficients::new(&table, &[1, 0, 1], features).unwrap();
        let points: Vec<[u32; 3]> = picks.iter().map(|p| std::array::from_fn(|a| p[a] % size[a])).collect();
        let y = gradients(points.len() * coefficients.values_per_point(&spec), seed);

        // S x in f64, from the exact counts.
        let (mut left, mut scale) = (0.0, 0.0);
        let m = usize::from(labels);
        let counts = counts_of(spec, &grid, &sat, &points);
        let (f, cells) = (features.len(), spec.cells_in_all());
        for (counts, y) in counts.chunks_exact(cells * m).zip(y.chunks_exact(3 * cells * f)) {
            for (channel, y) in [1, 0, 1].into_iter().zip(y.chunks_exact(cells * f)) {
                for (cell, (counts, y)) in counts.chunks_exact(m).zip(y.chunks_exact(f)).enumerate() {
                    for (material, &n) in table.materials().iter().zip(counts) {
                        let values = [material.sigma_s[channel], material.sigma_a[channel], 1.0];
                        for (value, y) in values.iter().zip(y) {
                            let term = f64::from(n) * f64::from(*value) * f64::from(*y)
                                * spec.level_factor(cell / spec.cells_per_level());
                            left += term;
                            scale += term.abs();
                        }
                    }
                }
            }
        }

        // A region that reaches past the grid and cuts nothing off.
        let region = Region { low: [-2, 0, -1], size: size.map(|s| s + 4) };
        let mut gradient = vec![f64::NAN; region.voxels() * m];
        scatter(&spec, &coefficients, &points, &y, region, &mut gradient, &Control::none()).unwrap();
        let mut right = 0.0;
        for z in 0..size[2] {
            for y in 0..size[1] {
                for x in 0..size[0] {
                    let label = grid.get([x, y, z]);
                    if label > 0 {
                        let at: [usize; 3] = std::array::from_fn(|a| ([x, y, z][a] as i64 - region.low[a]) as usize);
                        let [rx, ry, rz] = region.size.map(|s| s as usize);
                        right += gradient[(((usize::from(label) - 1) * rz + at[2]) * ry + at[1]) * rx + at[0]];
                    }
                }
            }
        }
        prop_assert!((left - right).abs() <= 1e-11 * (1.0 + scale), "{left} {right} {scale}");
    }

    #[test]
    fn a_region_is_a_cut_of_the_whole(
        seed: u64,
        low in [-3i64..12, -3i64..12, -3i64..12],
        part in [1u32..9, 1u32..9, 1u32..9],
    ) {
        let spec = StencilSpec::new([5, 3, 9], 4).unwrap();
        let table = table_of(2, 1, seed, 1.0);
        let coefficients = Coefficients::all(&table, Features::ScatterAbsorb).unwrap();
        let points = [[4, 4, 4], [9, 0, 5]];
        let y = gradients(points.len() * coefficients.values_per_point(&spec), seed);
        let run = |region: Region| {
            let mut out = vec![0.0; region.voxels() * 2];
            scatter(&spec, &coefficients, &points, &y, region, &mut out, &Control::none()).unwrap();
            out
        };
        let whole = Region { low: [-3; 3], size: [24; 3] };
        let cut = Region { low, size: part };
        let (all, some) = (run(whole), run(cut));
        let mut values = some.iter();
        for m in 0..2usize {
            for z in 0..part[2] {
                for y in 0..part[1] {
                    for x in 0..part[0] {
                        let at: [usize; 3] = std::array::from_fn(|a| (low[a] + 3) as usize + [x, y, z][a] as usize);
                        let expected = all[((m * 24 + at[2]) * 24 + at[1]) * 24 + at[0]];
                        let value = values.next().unwrap();
                        prop_assert!((value - expected).abs() <= 1e-9, "{value} {expected}");
                    }
                }
            }
        }
    }
}

#[test]
fn refuses_what_does_not_fit() {
    let spec = StencilSpec::new([5, 3, 9], 2).unwrap();
    let table = table_of(2, 1, 3, 1.0);
    let coefficients = Coefficients::all(&table, Features::ScatterAbsorb).unwrap();
    let row = coefficients.values_per_point(&spec);
    let region = Region { low: [0; 3], size: [4; 3] };
    let none = Control::none();
    let mut out = vec![0.0; 128];
    let points = [[0, 0, 0]];
    assert!(scatter(&spec, &coefficients, &points, &vec![0.0; row + 1], region, &mut out, &none).is_err());
    assert!(scatter(&spec, &coefficients, &points, &vec![0.0; row], region, &mut out[1..], &none).is_err());
    let empty = Region { low: [0; 3], size: [4, 0, 4] };
    assert!(scatter(&spec, &coefficients, &points, &vec![0.0; row], empty, &mut [], &none).is_err());
}
