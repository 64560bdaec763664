//! Volumes and a naive stencil shared by the test files.
#![allow(dead_code)] // Each test file uses its own part.

use pellucid_stencil::{Coefficients, Features, StencilSpec, Stencils};
use pellucid_voxel::{
    Control, CountSat, Frame, LabelGrid, Material, MaterialTable, Pitch, TILE, TILE_VOXELS, Tile,
};

/// A hash of three coordinates and a seed.
pub fn hash(v: [i64; 3], seed: u64) -> u64 {
    let mut h = seed ^ 0x9e37_79b9_7f4a_7c15;
    for c in v {
        h = (h ^ c as u64).wrapping_mul(0xff51_afd7_ed55_8ccd);
        h ^= h >> 32;
    }
    h
}

/// A grid from a label a voxel.
pub fn grid_of(size: [u32; 3], label: impl Fn([u32; 3]) -> u8 + Sync) -> LabelGrid {
    let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
    LabelGrid::from_tiles(frame, |t| {
        let mut tile = Box::new([0; TILE_VOXELS]);
        for (i, l) in tile.iter_mut().enumerate() {
            let local = [i % TILE, i / TILE % TILE, i / TILE / TILE];
            let v: [u32; 3] = std::array::from_fn(|a| t[a] * TILE as u32 + local[a] as u32);
            if (0..3).all(|a| v[a] < size[a]) {
                *l = label(v);
            }
        }
        Tile::Dense(tile)
    })
}

/// Volumes of the kinds that matter: blobs with a noisy skin over one label, noise in blocks of
/// several sizes, slabs, sparse dots.
pub fn label_at(kind: u8, labels: u8, size: [u32; 3], v: [u32; 3], seed: u64) -> u8 {
    let noise = |shift: u32| {
        let h = hash(v.map(|c| i64::from(c >> shift)), seed);
        ((h >> 13) % (u64::from(labels) + 1)) as u8
    };
    match kind % 5 {
        0 => {
            let r: f64 =
                (0..3).map(|a| (2.0 * (f64::from(v[a]) + 0.5) / f64::from(size[a]) - 1.0).powi(2)).sum();
            match r {
                r if r > 0.95 => 0,
                r if r > 0.6 => 1 + noise(0) % labels,
                _ => labels,
            }
        }
        1 => noise(0),
        2 => noise(3),
        3 => {
            if v[2] % 24 < 20 {
                1 + (v[2] / 24) as u8 % labels
            } else {
                0
            }
        }
        _ => {
            if hash(v.map(i64::from), seed).is_multiple_of(97) {
                1 + noise(1) % labels
            } else {
                0
            }
        }
    }
}

pub fn test_grid(kind: u8, labels: u8, size: [u32; 3], seed: u64) -> LabelGrid {
    grid_of(size, |v| label_at(kind, labels, size, v, seed))
}

pub fn sat_of(grid: &LabelGrid, materials: usize) -> CountSat {
    CountSat::build(grid, materials, &Control::none()).unwrap()
}

/// A table of `materials` materials over `channels` channels with hashed coefficients.
pub fn table_of(materials: usize, channels: usize, seed: u64, scale: f64) -> MaterialTable {
    let value = |m: usize, c: usize, k: i64| {
        (scale * (hash([m as i64, c as i64, k], seed) % 100_000) as f64 / 4096.0) as f32
    };
    let materials = (0..materials)
        .map(|m| Material {
            name: format!("m{m}"),
            sigma_s: (0..channels).map(|c| value(m, c, 0)).collect(),
            sigma_a: (0..channels).map(|c| value(m, c, 1)).collect(),
            g: 0.4.into(),
        })
        .collect();
    MaterialTable::new((0..channels).map(|c| format!("c{c}")).collect(), materials).unwrap()
}

pub fn counts_of(spec: StencilSpec, grid: &LabelGrid, sat: &CountSat, points: &[[u32; 3]]) -> Vec<u32> {
    let mut out = vec![7; points.len() * spec.cells_in_all() * sat.materials()];
    Stencils::new(spec, grid, sat).unwrap().extract_counts(points, &mut out, &Control::none()).unwrap();
    out
}

pub fn descriptors_of(
    spec: StencilSpec,
    grid: &LabelGrid,
    sat: &CountSat,
    table: &MaterialTable,
    features: Features,
    points: &[[u32; 3]],
) -> Vec<f32> {
    let coefficients = Coefficients::all(table, features).unwrap();
    let mut out = vec![f32::NAN; points.len() * coefficients.values_per_point(&spec)];
    Stencils::new(spec, grid, sat)
        .unwrap()
        .extract(&coefficients, points, &mut out, &Control::none())
        .unwrap();
    out
}

/// The definition: eighths of a voxel that each cell covers, voxel by voxel, ordered
/// `[level][cell][material]`.
pub fn naive_counts(spec: StencilSpec, grid: &LabelGrid, materials: usize, point: [u32; 3]) -> Vec<u32> {
    let n = spec.cells();
    let mut out = vec![0; spec.cells_in_all() * materials];
    for level in 0..spec.levels() {
        let edge = i64::from(spec.cell_edge(level));
        // Along an axis in half voxels: the faces of cell i and how much of a voxel lies between.
        let covered = |a: usize, i: usize| {
            let centre = 2 * i64::from(point[a]) + 1;
            let low = centre + edge * (2 * i as i64 - n[a] as i64);
            let high = low + 2 * edge;
            let first = low.div_euclid(2).max(0);
            let last = (high + 1).div_euclid(2).min(i64::from(grid.size()[a]));
            (first..last).map(move |v| (v, (high.min(2 * v + 2) - low.max(2 * v)) as u32))
        };
        for z in 0..n[2] {
            for y in 0..n[1] {
                for x in 0..n[0] {
                    let cell = level * spec.cells_per_level() + spec.cell_index([x, y, z]);
                    for (vz, wz) in covered(2, z) {
                        for (vy, wy) in covered(1, y) {
                            for (vx, wx) in covered(0, x) {
                                let label = grid.at([vx, vy, vz]);
                                if label > 0 {
                                    out[cell * materials + usize::from(label) - 1] += wx * wy * wz;
                                }
                            }
                        }
                    }
                }
            }
        }
    }
    out
}
