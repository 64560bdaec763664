//! Coefficients and grids at the ends of their ranges, against f64.
//!
//! The bound: counts times f32 coefficients are exact in f64, their sum over N materials has a
//! relative error below N 2^-53, and one rounding to f32 adds half a unit in the last place. So a
//! value lies within (2^-24 + N 2^-53) of the truth, relatively, or within half the smallest
//! subnormal.

mod common;

use common::*;
use pellucid_stencil::{Features, StencilSpec};
use pellucid_voxel::{Control, CountSat, Frame, LabelGrid, Material, MaterialTable, Pitch, Tile};

fn check(spec: StencilSpec, grid: &LabelGrid, table: &MaterialTable, points: &[[u32; 3]]) {
    let sat = sat_of(grid, table.len());
    let values = descriptors_of(spec, grid, &sat, table, Features::WithOccupancy, points);
    let (cells, m) = (spec.cells_in_all(), table.len());
    let bound = f64::powi(2.0, -24) + m as f64 * f64::powi(2.0, -53);
    let smallest = f64::from(f32::from_bits(1)) / 2.0;
    for (p, values) in points.iter().zip(values.chunks_exact(cells * 3 * table.channels())) {
        let counts = naive_counts(spec, grid, m, *p);
        for (channel, values) in values.chunks_exact(cells * 3).enumerate() {
            for (cell, (values, counts)) in values.chunks_exact(3).zip(counts.chunks_exact(m)).enumerate() {
                let full = f64::from(spec.full_count(cell / spec.cells_per_level()));
                for (k, value) in values.iter().enumerate() {
                    let truth: f64 = table
                        .materials()
                        .iter()
                        .zip(counts)
                        .map(|(m, &n)| {
                            f64::from([m.sigma_s[channel], m.sigma_a[channel], 1.0][k]) * f64::from(n)
                        })
                        .sum::<f64>()
                        / full;
                    let error = (f64::from(*value) - truth).abs();
                    assert!(
                        error <= bound * truth + smallest,
                        "{p:?} channel {channel} cell {cell}: {value} {truth}"
                    );
                }
            }
        }
    }
}

fn table(values: &[[f32; 2]]) -> MaterialTable {
    let channels = 31;
    let materials = values
        .iter()
        .enumerate()
        .map(|(i, v)| Material {
            name: format!("m{i}"),
            sigma_s: (0..channels).map(|c| v[0] * (1.0 + c as f32 / 7.0)).collect(),
            sigma_a: (0..channels).map(|c| v[1] / (1.0 + c as f32 / 3.0)).collect(),
            g: 0.0.into(),
        })
        .collect();
    MaterialTable::new((0..channels).map(|c| format!("{c}")).collect(), materials).unwrap()
}

#[test]
fn zero_tiny_and_huge_coefficients_over_31_channels() {
    let spec = StencilSpec::new([5, 3, 9], 6).unwrap();
    let tables = [
        table(&[[0.0, 0.0], [1e-12, 1e6], [1e6, 1e-12], [1e-12, 1e-12], [24.0, 0.001]]),
        table(&[[1e6, 1e6], [0.0, 1e6], [3.3, 0.1], [1e-38, 1e-45], [1e-30, 1e30]]),
    ];
    for table in &tables {
        for kind in [0, 1] {
            let grid = test_grid(kind, 5, [40, 35, 50], 17);
            check(spec, &grid, table, &[[20, 17, 2], [39, 0, 49]]);
        }
    }
}

#[test]
fn single_file_grids() {
    let spec = StencilSpec::paper();
    let table = table(&[[3.0, 0.1], [1e6, 1e-12], [0.5, 2.0]]);
    for (size, point) in [
        ([1, 1, 700], [0, 0, 350]),
        ([1, 1, 700], [0, 0, 699]),
        ([300, 1, 1], [0, 0, 0]),
        ([1, 200, 1], [0, 77, 0]),
        ([1, 1, 1], [0, 0, 0]),
    ] {
        check(spec, &test_grid(1, 3, size, 3), &table, &[point]);
    }
}

#[test]
fn anisotropy_does_not_enter() {
    // The descriptor counts voxels: the same labels at any pitch give the same bits.
    let spec = StencilSpec::new([5, 3, 9], 7).unwrap();
    let plain = test_grid(0, 5, [50, 40, 60], 5);
    let stretched = LabelGrid::from_tiles(
        Frame::new([0.0; 3], Pitch::new([0.001, 1.0, 0.03]).unwrap(), plain.size()).unwrap(),
        |t| plain.tile(t).clone(),
    );
    let table = table_of(5, 3, 1, 1.0);
    let extract = |grid: &LabelGrid| {
        descriptors_of(
            spec,
            grid,
            &sat_of(grid, 5),
            &table,
            Features::ScatterAbsorb,
            &[[25, 20, 3], [10, 11, 12]],
        )
    };
    assert_eq!(extract(&plain), extract(&stretched));
}

#[test]
fn counts_past_thirty_two_bits() {
    // 2^32 solid voxels and more behind the corners of the coarse levels.
    let size = [2048, 2048, 1056];
    let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
    let grid = LabelGrid::from_tiles(frame, |t| Tile::Constant(1 + (t[0] % 2) as u8));
    let sat = CountSat::build(&grid, 2, &Control::none()).unwrap();
    let spec = StencilSpec::paper();
    let point = [2040, 2039, 1050];
    let counts = counts_of(spec, &grid, &sat, &[point]);
    for level in 0..9 {
        let edge = f64::from(spec.cell_edge(level));
        for z in 0..9usize {
            // Along one axis: what a cell has of the grid, and of odd tiles.
            let overlap = |a: usize, i: usize, odd: bool| {
                let low = f64::from(point[a]) + 0.5 + edge * (i as f64 - spec.cells()[a] as f64 / 2.0);
                let (low, high) = (low.max(0.0), (low + edge).min(f64::from(size[a])));
                let tiles = (low / 16.0).floor() as i64..(high / 16.0).ceil() as i64;
                tiles
                    .filter(|t| !odd || t % 2 == 1)
                    .map(|t| ((t as f64 + 1.0) * 16.0).min(high) - (t as f64 * 16.0).max(low))
                    .filter(|l| *l > 0.0)
                    .sum::<f64>()
            };
            for y in 0..3 {
                for x in 0..5 {
                    let across = overlap(1, y, false) * overlap(2, z, false);
                    let (odd, all) = (overlap(0, x, true) * across, overlap(0, x, false) * across);
                    let at = (level * spec.cells_per_level() + spec.cell_index([x, y, z])) * 2;
                    assert_eq!(f64::from(counts[at]), 8.0 * (all - odd), "{level} {x} {y} {z}");
                    assert_eq!(f64::from(counts[at + 1]), 8.0 * odd, "{level} {x} {y} {z}");
                }
            }
        }
    }
}
