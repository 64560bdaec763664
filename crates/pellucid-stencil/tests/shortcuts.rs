//! What is left out changes no bit.

mod common;

use common::*;
use pellucid_stencil::{ChangedTiles, Coefficients, Features, StencilSpec, Stencils};
use pellucid_voxel::{Control, CountSat, Frame, LabelGrid, Pitch, TILE_VOXELS, Tile};
use proptest::prelude::*;

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn levels_beyond_the_object_are_zero() {
    // One small cube far from most points: their fine levels meet nothing.
    let grid = grid_of([90, 90, 90], |v| if v.iter().all(|&c| (70..78).contains(&c)) { 2 } else { 0 });
    let sat = sat_of(&grid, 2);
    let spec = StencilSpec::new([5, 3, 9], 7).unwrap();
    let points = [[3, 4, 5], [74, 74, 20], [69, 74, 74], [77, 77, 77], [89, 0, 0]];
    let counts = counts_of(spec, &grid, &sat, &points);
    for (p, counts) in points.iter().zip(counts.chunks_exact(spec.cells_in_all() * 2)) {
        assert_eq!(counts, naive_counts(spec, &grid, 2, *p), "{p:?}");
    }
    let empty = grid_of([20, 20, 20], |_| 0);
    assert!(counts_of(spec, &empty, &sat_of(&empty, 2), &[[1, 2, 3]]).iter().all(|&n| n == 0));
}

#[test]
fn constant_neighbourhoods() {
    // Three layers of tiles of labels 1, 0 and 3, and one odd voxel.
    let frame = Frame::new([0.0; 3], Pitch::j750(), [70, 60, 150]).unwrap();
    let mut grid =
        LabelGrid::from_tiles(frame, |t| Tile::Constant([1, 1, 1, 0, 0, 0, 3, 3, 3, 3][t[2] as usize]));
    grid.set([60, 50, 20], 2);
    let sat = sat_of(&grid, 3);
    let spec = StencilSpec::new([5, 3, 9], 6).unwrap();
    let points = [
        [24, 24, 23],
        [24, 24, 24],
        [30, 30, 72],
        [30, 30, 125],
        [0, 0, 0],
        [59, 50, 20],
        [69, 59, 149],
        [35, 30, 47],
    ];
    for points in [&points[..], &points[..1], &points[2..4], &points[3..4]] {
        let counts = counts_of(spec, &grid, &sat, points);
        for (p, counts) in points.iter().zip(counts.chunks_exact(spec.cells_in_all() * 3)) {
            assert_eq!(counts, naive_counts(spec, &grid, 3, *p), "{p:?}");
        }
    }
}

#[test]
fn repeated_channels() {
    let spec = StencilSpec::new([5, 3, 9], 5).unwrap();
    let grid = test_grid(0, 5, [40, 30, 50], 4);
    let sat = sat_of(&grid, 5);
    let table = table_of(5, 3, 9, 1.0);
    let stencils = Stencils::new(spec, &grid, &sat).unwrap();
    let points = [[20, 15, 3], [5, 6, 7]];
    let extract = |channels: &[usize], features| {
        let coefficients = Coefficients::new(&table, channels, features).unwrap();
        let mut out = vec![f32::NAN; points.len() * coefficients.values_per_point(&spec)];
        stencils.extract(&coefficients, &points, &mut out, &Control::none()).unwrap();
        out
    };
    for features in [Features::ScatterAbsorb, Features::WithOccupancy] {
        let channels = [2, 0, 2, 2, 1, 0, 2];
        let row = spec.cells_in_all() * features.len();
        let repeated = extract(&channels, features);
        for (i, &channel) in channels.iter().enumerate() {
            let alone = extract(&[channel], features);
            for p in 0..points.len() {
                let at = (p * channels.len() + i) * row;
                assert_eq!(bits(&repeated[at..at + row]), bits(&alone[p * row..(p + 1) * row]));
            }
        }
    }
}

#[test]
fn converting_counts_is_extracting() {
    let spec = StencilSpec::new([5, 3, 9], 6).unwrap();
    let grid = test_grid(1, 7, [40, 30, 50], 4);
    let sat = sat_of(&grid, 7);
    let table = table_of(7, 5, 9, 1.0);
    let coefficients = Coefficients::all(&table, Features::WithOccupancy).unwrap();
    let points = [[20, 15, 3]];
    let counts = counts_of(spec, &grid, &sat, &points);
    let mut converted = vec![f32::NAN; coefficients.values_per_point(&spec)];
    coefficients.convert(&spec, &counts, &mut converted);
    let extracted = descriptors_of(spec, &grid, &sat, &table, Features::WithOccupancy, &points);
    assert_eq!(bits(&converted), bits(&extracted));
}

#[test]
fn order_batches_and_threads_do_not_matter() {
    let spec = StencilSpec::paper();
    let grid = test_grid(0, 5, [60, 50, 80], 21);
    let sat = sat_of(&grid, 5);
    let all: Vec<[u32; 3]> = (0..60)
        .flat_map(|x| (0..50).map(move |y| [x, y, 10 + (x * 7 + y) % 55]))
        .filter(|p| p[0] % 3 == 0 || p[1] < 4)
        .collect();
    let together = counts_of(spec, &grid, &sat, &all);
    let row = spec.cells_in_all() * 5;
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert!(pool.install(|| counts_of(spec, &grid, &sat, &all)) == together);
    }
    let backwards: Vec<_> = all.iter().rev().copied().collect();
    let reversed = counts_of(spec, &grid, &sat, &backwards);
    for (i, p) in all.iter().enumerate() {
        let counts = &together[i * row..(i + 1) * row];
        assert!(counts == &reversed[(all.len() - 1 - i) * row..][..row], "{p:?}");
        if i % 97 == 0 {
            assert_eq!(counts, counts_of(spec, &grid, &sat, &[*p]), "{p:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn refreshing_is_extracting_anew(
        kind: u8,
        size in [20u32..90, 20u32..90, 20u32..90],
        seed: u64,
        picks in prop::collection::vec(any::<[u32; 3]>(), 1..30),
        edits in prop::collection::vec(any::<u64>(), 0..3),
        levels in 1usize..=9,
    ) {
        let spec = StencilSpec::new([5, 3, 9], levels).unwrap();
        let table = table_of(4, 2, seed, 1.0);
        let coefficients = Coefficients::all(&table, Features::ScatterAbsorb).unwrap();
        let mut grid = test_grid(kind, 4, size, seed);
        let mut sat = sat_of(&grid, 4);
        let points: Vec<[u32; 3]> = picks.iter().map(|p| std::array::from_fn(|a| p[a] % size[a])).collect();
        let extract = |grid: &LabelGrid, sat: &CountSat| {
            descriptors_of(spec, grid, sat, &table, Features::ScatterAbsorb, &points)
        };
        let mut kept = extract(&grid, &sat);
        let tiles = grid.tiles().len() as u64;
        let changed = grid.update_tiles(|t, _| {
            let d = size.map(|s| s.div_ceil(16));
            let index = u64::from((t[2] * d[1] + t[1]) * d[0] + t[0]);
            edits.iter().any(|e| e % tiles == index).then(|| Tile::Dense(Box::new([(index % 5) as u8; TILE_VOXELS])))
        });
        sat.update(&grid, &changed, &Control::none()).unwrap();
        let set = ChangedTiles::new(&grid, &changed).unwrap();
        Stencils::new(spec, &grid, &sat)
            .unwrap()
            .refresh(&coefficients, &points, &set, &mut kept, &Control::none())
            .unwrap();
        prop_assert_eq!(bits(&kept), bits(&extract(&grid, &sat)));
        if changed.is_empty() {
            prop_assert!(points.iter().all(|p| set.first_level(&spec, *p) == levels));
        }
    }
}

#[test]
fn an_untouched_level_is_not_written() {
    let mut grid = test_grid(0, 5, [64, 64, 64], 8);
    let spec = StencilSpec::new([5, 3, 9], 9).unwrap();
    let table = table_of(5, 1, 2, 1.0);
    let coefficients = Coefficients::all(&table, Features::ScatterAbsorb).unwrap();
    let changed = grid.update_tiles(|t, _| (t == [3, 3, 3]).then_some(Tile::Constant(1)));
    let sat = sat_of(&grid, 5);
    let set = ChangedTiles::new(&grid, &changed).unwrap();
    let point = [20, 20, 30];
    let first = set.first_level(&spec, point);
    // Level 5 (index 4) reaches 40, 24 and 72 voxels; one less reaches y 32.
    assert_eq!(first, 5);
    let mut out = vec![-1.0; coefficients.values_per_point(&spec)];
    let stencils = Stencils::new(spec, &grid, &sat).unwrap();
    stencils.refresh(&coefficients, &[point], &set, &mut out, &Control::none()).unwrap();
    let level = spec.cells_per_level() * 2;
    assert!(out[..first * level].iter().all(|&v| v == -1.0));
    assert!(out[first * level..].iter().all(|&v| v >= 0.0));
}
