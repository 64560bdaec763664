use super::*;
use crate::{Frame, Pitch, TILE_VOXELS};
use proptest::prelude::*;

fn frame(size: [u32; 3]) -> Frame {
    Frame::new([0.0; 3], Pitch::j750(), size).unwrap()
}

fn build(grid: &LabelGrid, materials: usize) -> CountSat {
    CountSat::build(grid, materials, &Control::none()).unwrap()
}

/// A hash of three coordinates and a seed.
fn hash(v: [u32; 3], seed: u64) -> u64 {
    let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
    for c in v {
        h = (h ^ u64::from(c)).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h ^= h >> 32;
    }
    h
}

/// How a test tile is filled: constant tiles, noise, and noise of few labels, mixed at random.
fn test_tile(t: [u32; 3], labels: u8, seed: u64) -> Tile {
    let h = hash(t, seed);
    let any = |h: u64| ((h >> 20) % (u64::from(labels) + 1)) as u8;
    match h % 5 {
        0 | 1 => Tile::Constant(any(h)),
        2 => {
            let mut tile = Box::new([any(h); TILE_VOXELS]);
            tile[(h >> 40) as usize % TILE_VOXELS] = any(h >> 8);
            Tile::Dense(tile)
        }
        _ => {
            let mut tile = Box::new([0; TILE_VOXELS]);
            for (i, label) in tile.iter_mut().enumerate() {
                *label = any(hash([i as u32, t[0], t[1]], h));
            }
            Tile::Dense(tile)
        }
    }
}

fn test_grid(size: [u32; 3], labels: u8, seed: u64) -> LabelGrid {
    LabelGrid::from_tiles(frame(size), |t| test_tile(t, labels, seed))
}

/// The definition: visit every voxel of the box that lies in the grid.
fn naive(grid: &LabelGrid, low: [i64; 3], high: [i64; 3], materials: usize) -> Vec<u64> {
    let mut counts = vec![0; materials];
    let size = grid.size().map(i64::from);
    let range = |a: usize| low[a].max(0)..high[a].min(size[a]);
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let label = grid.at([x, y, z]);
                if label > 0 {
                    counts[usize::from(label) - 1] += 1;
                }
            }
        }
    }
    counts
}

/// Tables and sums are equal wherever a corner may be asked for.
fn same_everywhere(a: &CountSat, b: &CountSat) -> bool {
    a.groups.iter().zip(&b.groups).all(|(a, b)| {
        let [nx, ny, nz] = a.dims().map(|d| (d * TILE) as u32);
        let plain = |t: &CountTables| {
            t.records().iter().map(|r| (r.table != 0, r.fill, r.depth, r.edges)).collect::<Vec<_>>()
        };
        plain(a) == plain(b)
            && (0..nz).all(|z| (0..ny).all(|y| (0..nx).all(|x| a.prefix([x, y, z]) == b.prefix([x, y, z]))))
    })
}

fn boxes() -> impl Strategy<Value = Vec<([i64; 3], [i64; 3])>> {
    let corner = || [-20i64..75, -20i64..75, -20i64..75];
    prop::collection::vec((corner(), corner()), 1..12)
}

#[test]
fn a_change_in_a_tiles_last_layers_is_seen() {
    for voxel in [[15, 3, 7], [3, 15, 7], [3, 7, 15], [15, 15, 15], [15, 15, 2]] {
        let mut grid = LabelGrid::from_tiles(frame([40, 40, 40]), |t| {
            let mut tile = Box::new([1 + (t[0] + t[1] + t[2]) as u8 % 3; TILE_VOXELS]);
            tile[0] = 5;
            Tile::Dense(tile)
        });
        let mut sat = build(&grid, 5);
        let at = (voxel[2] * TILE + voxel[1]) * TILE + voxel[0];
        let changed = grid.update_tiles(|t, tile| {
            let Tile::Dense(labels) = tile else { return None };
            let mut labels = labels.clone();
            labels[at] = 4;
            (t == [1, 0, 1]).then_some(Tile::Dense(labels))
        });
        sat.update(&grid, &changed, &Control::none()).unwrap();
        assert!(same_everywhere(&sat, &build(&grid, 5)), "{voxel:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn counts_equal_a_naive_sum(
        size in [1u32..56, 1u32..56, 1u32..56],
        labels in prop_oneof![Just(1u8), Just(3), Just(5), Just(6), Just(12)],
        seed: u64,
        boxes in boxes(),
    ) {
        let grid = test_grid(size, labels, seed);
        let sat = build(&grid, usize::from(labels));
        let mut counts = vec![0; usize::from(labels)];
        for (low, high) in boxes {
            sat.counts(low, high, &mut counts);
            prop_assert_eq!(&counts, &naive(&grid, low, high, counts.len()));
        }
        sat.counts([-3; 3], [1000; 3], &mut counts);
        prop_assert_eq!(&counts[..], &grid.histogram()[1..=counts.len()]);
    }

    #[test]
    fn updating_equals_building(
        size in [1u32..70, 1u32..50, 1u32..50],
        labels in prop_oneof![Just(5u8), Just(7)],
        seeds: [u64; 3],
        density in 1u64..12,
    ) {
        let mut grid = test_grid(size, labels, seeds[0]);
        let mut sat = build(&grid, usize::from(labels));
        for seed in &seeds[1..] {
            let mut changed = grid.update_tiles(|t, _| {
                (hash(t, *seed) % 12 < density).then(|| test_tile(t, labels, seed ^ 77))
            });
            changed.reverse();
            sat.update(&grid, &changed, &Control::none()).unwrap();
            let fresh = build(&grid, usize::from(labels));
            prop_assert!(same_everywhere(&sat, &fresh));
            prop_assert_eq!(sat.memory().mixed_tiles, fresh.memory().mixed_tiles);
        }
    }
}

#[test]
fn thin_and_single_voxel_grids() {
    for size in
        [[1, 1, 1], [1, 1, 100], [1, 33, 1], [47, 1, 1], [16, 16, 16], [17, 1, 15], [15, 31, 47], [32, 1, 16]]
    {
        for labels in [1, 5] {
            let grid = test_grid(size, labels, 5);
            let sat = build(&grid, labels.into());
            let mut counts = vec![0; labels.into()];
            let end = size.map(i64::from);
            for (low, high) in [
                ([0; 3], end),
                ([-5; 3], end.map(|e| e + 5)),
                ([0, 0, end[2] / 2], end),
                (end, [100; 3]),
                (end, [0; 3]),
            ] {
                sat.counts(low, high, &mut counts);
                assert_eq!(counts, naive(&grid, low, high, counts.len()), "{size:?} {low:?} {high:?}");
            }
        }
    }
}

#[test]
fn exact_past_four_billion_voxels() {
    // 2^32 + 2^27 voxels: two planted tiles, the rest label 1 or 2 by tile row.
    let size = [2048, 2048, 1056];
    let planted = |t: [u32; 3]| t == [3, 100, 2] || t == [127, 127, 65];
    let grid = LabelGrid::from_tiles(frame(size), |t| {
        if planted(t) { test_tile([0, 0, 1], 3, 3) } else { Tile::Constant(1 + (t[1] % 8 == 0) as u8) }
    });
    let sat = build(&grid, 3);
    let histogram = grid.histogram();
    assert!(histogram[1] + histogram[2] > 1 << 32);
    assert!(histogram[3] > 0);
    let mut counts = [0; 3];
    sat.counts([-1; 3], [1 << 40; 3], &mut counts);
    assert_eq!(counts[..], histogram[1..4]);
    // Boxes that start and end within tiles on both sides of the wrap, against sums by tile row.
    for (low, high) in [
        ([1, 3, 5], [2047, 2046, 1056]),
        ([40, 1500, 900], [2040, 2048, 1050]),
        ([48, 1600, 32], [64, 1616, 48]),
    ] {
        sat.counts(low, high, &mut counts);
        let mut expected = [0u64; 3];
        for y in low[1]..high[1] {
            expected[(y / 16 % 8 == 0) as usize] += ((high[0] - low[0]) * (high[2] - low[2])) as u64;
        }
        for t in [[3i64, 100, 2], [127, 127, 65]] {
            let from: [i64; 3] = std::array::from_fn(|a| low[a].max(t[a] * 16));
            let to: [i64; 3] = std::array::from_fn(|a| high[a].min(t[a] * 16 + 16));
            let volume: i64 = (0..3).map(|a| (to[a] - from[a]).max(0)).product();
            expected[(t[1] % 8 == 0) as usize] -= volume as u64;
            for (e, n) in expected.iter_mut().zip(naive(&grid, from, to, 3)) {
                *e += n;
            }
        }
        assert_eq!(counts, expected, "{low:?} {high:?}");
    }
    let memory = sat.memory();
    assert!(memory.total() as f64 / (grid.tiles().len() as f64) < 1300.0, "{memory:?}");
}

#[test]
fn memory_stays_within_its_bounds() {
    let noise = LabelGrid::from_tiles(frame([96; 3]), |t| {
        let mut tile = Box::new([0; TILE_VOXELS]);
        tile.iter_mut().enumerate().for_each(|(i, l)| *l = (hash([i as u32, t[0], t[2]], 9) % 6) as u8);
        Tile::Dense(tile)
    });
    let memory = build(&noise, 5).memory();
    assert_eq!(memory.mixed_tiles, 216);
    let padded = 7f64.powi(3) / 6f64.powi(3);
    let per_voxel = (memory.tiles as f64 + memory.records as f64 / padded) / 96f64.powi(3);
    assert!(per_voxel < 10.4, "{per_voxel} bytes a voxel");
}

#[test]
fn means_and_bounds() {
    let mut grid = LabelGrid::new(frame([40, 50, 60]));
    let sat = build(&grid, 2);
    assert_eq!(sat.bounds(), None);
    assert_eq!(sat.mean([0; 3], [4; 3], &[1.0, 1.0]), 0.0);
    grid.set([7, 20, 33], 1);
    grid.set([30, 21, 50], 2);
    let sat = build(&grid, 2);
    assert_eq!(sat.bounds(), Some(([7, 20, 33], [31, 22, 51])));
    assert_eq!(sat.mean([-1, 19, 31], [31, 22, 51], &[3.0, 0.5]), 3.5 / (32.0 * 3.0 * 20.0));
    assert_eq!(sat.mean([5; 3], [5; 3], &[3.0, 0.5]), 0.0);
}

#[test]
fn refuses_what_does_not_fit() {
    let grid = test_grid([20, 20, 20], 3, 1);
    let none = Control::none();
    let built = CountSat::build(&grid, 2, &none).err().unwrap();
    assert!(built.to_string().contains("label 3"), "{built}");
    assert!(CountSat::build(&grid, 0, &none).is_err());
    assert!(CountSat::build(&grid, 256, &none).is_err());
    let mut sat = build(&grid, 3);
    assert!(sat.update(&grid, &[8], &none).is_err());
    assert!(sat.update(&test_grid([20, 20, 21], 3, 1), &[0], &none).is_err());
    let stop = std::sync::atomic::AtomicBool::new(true);
    let cancelled = Control::none().with_cancel(&stop);
    assert_eq!(CountSat::build(&grid, 3, &cancelled).err(), Some(VoxelError::Cancelled));
    assert_eq!(sat.update(&grid, &[0], &cancelled), Err(VoxelError::Cancelled));
    assert!(same_everywhere(&sat, &build(&grid, 3)));
}
