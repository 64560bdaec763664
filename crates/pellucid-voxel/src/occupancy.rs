//! Solid or air as bits: the form in which surface, normals and distances read a label grid.

use crate::grid::inside;
use crate::{AIR, LabelGrid, TILE, Tile};

/// Rows of 16 voxels along x in a tile, ordered `[z][y]`.
pub(crate) const ROWS: usize = TILE * TILE;

/// Bit x is set where `labels[x]` is solid.
#[inline]
pub(crate) fn solid_bits(labels: &[u8]) -> u16 {
    const LOW: u64 = 0x7f7f_7f7f_7f7f_7f7f;
    // Gathers the lowest bit of each of eight bytes into the top byte of the product.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let half = |bytes: &[u8]| {
        let v = u64::from_le_bytes(bytes.try_into().expect("eight labels"));
        let nonzero = ((((v & LOW) + LOW) | v) & !LOW) >> 7;
        (nonzero.wrapping_mul(GATHER) >> 56) as u16
    };
    half(&labels[..8]) | half(&labels[8..16]) << 8
}

/// A bit for each of the first `n` voxels of a row, `n` at most 16.
#[inline]
fn first_bits(n: usize) -> u16 {
    ((1u32 << n) - 1) as u16
}

/// The solid voxels of the tile row that starts at voxel `[16 * tx, y, z]`; zero outside the grid.
#[inline]
pub(crate) fn solid_row(grid: &LabelGrid, tx: i64, y: i64, z: i64) -> u16 {
    let size = grid.size();
    let dims = grid.tile_dims();
    if tx < 0
        || tx >= i64::from(dims[0])
        || y < 0
        || y >= i64::from(size[1])
        || z < 0
        || z >= i64::from(size[2])
    {
        return 0;
    }
    let (tx, y, z) = (tx as u32, y as usize, z as usize);
    match grid.tile([tx, (y / TILE) as u32, (z / TILE) as u32]) {
        Tile::Constant(AIR) => 0,
        Tile::Constant(_) => first_bits(((size[0] - tx * TILE as u32) as usize).min(TILE)),
        Tile::Dense(labels) => {
            let start = (z % TILE * TILE + y % TILE) * TILE;
            solid_bits(&labels[start..start + TILE])
        }
    }
}

/// The solid voxels of a whole tile, one bit mask a row.
pub(crate) fn solid_rows(grid: &LabelGrid, t: [u32; 3]) -> [u16; ROWS] {
    let mut rows = [0; ROWS];
    match grid.tile(t) {
        Tile::Constant(AIR) => {}
        Tile::Constant(_) => {
            let [nx, ny, nz] = inside(t, grid.size());
            for z in 0..nz {
                rows[z * TILE..z * TILE + ny].fill(first_bits(nx));
            }
        }
        Tile::Dense(labels) => {
            for (row, labels) in rows.iter_mut().zip(labels.chunks_exact(TILE)) {
                *row = solid_bits(labels);
            }
        }
    }
    rows
}

/// Tile `t` moved by `step`, when it lies within the grid.
pub(crate) fn neighbour(grid: &LabelGrid, t: [u32; 3], step: [i32; 3]) -> Option<[u32; 3]> {
    let dims = grid.tile_dims();
    let mut n = t;
    for a in 0..3 {
        n[a] = t[a].checked_add_signed(step[a]).filter(|&v| v < dims[a])?;
    }
    Some(n)
}

/// The surface voxels of a tile as one bit mask a row; `None` when it has none.
pub(crate) fn surface_rows(grid: &LabelGrid, t: [u32; 3]) -> Option<[u16; ROWS]> {
    const STEPS: [[i32; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];
    let tile = grid.tile(t);
    if let Tile::Constant(label) = tile {
        let solid_around = || {
            let full = inside(t, grid.size()) == [TILE; 3];
            full && STEPS.iter().all(|&s| {
                neighbour(grid, t, s).is_some_and(|n| matches!(grid.tile(n), Tile::Constant(l) if *l != AIR))
            })
        };
        if *label == AIR || solid_around() {
            return None;
        }
    }
    let rows = solid_rows(grid, t);
    let [tx, y0, z0] = [i64::from(t[0]), i64::from(t[1]) * TILE as i64, i64::from(t[2]) * TILE as i64];
    let side = |step| neighbour(grid, t, [step, 0, 0]).map(|n| grid.tile(n));
    let (left, right) = (side(-1), side(1));
    let solid_at = |tile: Option<&Tile>, x, y, z| u16::from(tile.is_some_and(|t| t.label(x, y, z) != AIR));
    let mut surface = [0; ROWS];
    let mut any = 0;
    for z in 0..TILE {
        for y in 0..TILE {
            let row = rows[z * TILE + y];
            if row == 0 {
                continue;
            }
            let lower_y =
                if y > 0 { rows[z * TILE + y - 1] } else { solid_row(grid, tx, y0 - 1, z0 + z as i64) };
            let upper_y = if y + 1 < TILE {
                rows[z * TILE + y + 1]
            } else {
                solid_row(grid, tx, y0 + TILE as i64, z0 + z as i64)
            };
            let lower_z =
                if z > 0 { rows[(z - 1) * TILE + y] } else { solid_row(grid, tx, y0 + y as i64, z0 - 1) };
            let upper_z = if z + 1 < TILE {
                rows[(z + 1) * TILE + y]
            } else {
                solid_row(grid, tx, y0 + y as i64, z0 + TILE as i64)
            };
            let lower_x = row << 1 | solid_at(left, TILE - 1, y, z);
            let upper_x = row >> 1 | solid_at(right, 0, y, z) << (TILE - 1);
            let open = row & !(lower_x & upper_x & lower_y & upper_y & lower_z & upper_z);
            surface[z * TILE + y] = open;
            any |= open;
        }
    }
    (any != 0).then_some(surface)
}
