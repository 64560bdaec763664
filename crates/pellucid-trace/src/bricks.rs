//! Voxels in bricks of 4 x 4 x 4, one cache line each, behind a flat table.
//!
//! A voxel is one byte: its material's position in the palette in the low four bits (0 is air)
//! and its clearance class in the high four. A brick of equal bytes is shared. Bricks with
//! surface voxels come first and keep their numbers when materials change.

use pellucid_voxel::{AIR, LabelGrid, TILE, Tile};
use rayon::prelude::*;

use crate::TraceError;
use crate::clearance::{Clearance, TileClearance, coords};

/// Voxels along an edge of a brick.
pub(crate) const BRICK: usize = 4;
/// Voxels of air around the grid, one brick.
pub(crate) const MARGIN: u32 = BRICK as u32;
/// Numbers below this stand for bricks of equal bytes.
pub(crate) const SHARED: u32 = 256;
/// Most bricks in a table: 2 GiB of it.
const MAX_TABLE: usize = 1 << 29;
/// Bricks along an edge of a tile.
const PER_TILE: usize = TILE / BRICK;

/// The bytes of a brick, `[z][y][x]`, four a word, lowest first.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Brick(pub(crate) [u32; 16]);

impl Brick {
    fn from_bytes(bytes: &[u8; 64]) -> Self {
        Self(std::array::from_fn(|w| {
            u32::from_le_bytes([bytes[4 * w], bytes[4 * w + 1], bytes[4 * w + 2], bytes[4 * w + 3]])
        }))
    }
}

/// The labels in use, at most fifteen: position p of the palette is label `labels[p]`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Palette {
    pub(crate) labels: Vec<u8>,
    position: [u8; 256],
}

impl Palette {
    fn of(grid: &LabelGrid) -> Result<Self, TraceError> {
        let used = grid
            .tiles()
            .par_iter()
            .fold(
                || [false; 256],
                |mut used, tile| {
                    match tile {
                        Tile::Constant(label) => used[usize::from(*label)] = true,
                        Tile::Dense(labels) => labels.iter().for_each(|&l| used[usize::from(l)] = true),
                    }
                    used
                },
            )
            .reduce(|| [false; 256], |a, b| std::array::from_fn(|i| a[i] | b[i]));
        let mut labels = vec![AIR];
        labels.extend((1..=255u8).filter(|&l| used[usize::from(l)]));
        if labels.len() > 16 {
            return Err(TraceError::unsupported(
                "label grid",
                format!("{} materials in one object; at most 15", labels.len() - 1),
            ));
        }
        let mut position = [0; 256];
        labels.iter().enumerate().for_each(|(p, &l)| position[usize::from(l)] = p as u8);
        Ok(Self { labels, position })
    }
}

/// Where a tile's bricks are: a shared brick's number, or a position in one of its two lists.
#[derive(Clone, Copy)]
enum Place {
    Shared(u8),
    Surface(u32),
    Inner(u32),
}

struct TileBricks {
    places: [Place; PER_TILE * PER_TILE * PER_TILE],
    surface: Vec<Brick>,
    inner: Vec<Brick>,
    /// The labels are solid where the clearance says so.
    consistent: bool,
}

/// The bricks of a grid.
pub(crate) struct Bricks {
    /// Bricks along `[x, y, z]`, margin included.
    pub(crate) dims: [u32; 3],
    /// Brick number by brick position, ordered `[z][y][x]`.
    pub(crate) table: Vec<u32>,
    /// All bricks: 256 shared ones, those with surface voxels, the rest.
    pub(crate) pool: Vec<Brick>,
    /// Number of bricks with surface voxels.
    pub(crate) surface: u32,
    pub(crate) palette: Palette,
    /// The labels are solid where the clearance says so, as far as it tells.
    consistent: bool,
}

impl Bricks {
    pub(crate) fn build(grid: &LabelGrid, clearance: &Clearance) -> Result<Self, TraceError> {
        let palette = Palette::of(grid)?;
        let tile_dims = grid.tile_dims();
        let dims = tile_dims.map(|d| d * PER_TILE as u32 + 2);
        let entries = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d as usize));
        let Some(entries) = entries.filter(|&n| n <= MAX_TABLE) else {
            return Err(TraceError::unsupported(
                "label grid",
                format!(
                    "{:?} voxels need more than {MAX_TABLE} bricks of 64; use a coarser pitch or a smaller object",
                    grid.size()
                ),
            ));
        };
        let tiles: Vec<TileBricks> = grid
            .tiles()
            .par_iter()
            .zip(&clearance.tiles)
            .enumerate()
            .map(|(i, (tile, clear))| tile_bricks(grid, coords(tile_dims, i), tile, clear, &palette))
            .collect();
        let surface: usize = tiles.iter().map(|t| t.surface.len()).sum();
        let inner: usize = tiles.iter().map(|t| t.inner.len()).sum();
        let total = SHARED as usize + surface + inner;
        if total > (i32::MAX / 16) as usize {
            return Err(TraceError::unsupported("label grid", format!("{total} mixed bricks of 64 voxels")));
        }
        let mut pool = Vec::with_capacity(total);
        pool.extend((0..SHARED).map(|b| Brick([b * 0x0101_0101; 16])));
        tiles.iter().for_each(|t| pool.extend_from_slice(&t.surface));
        tiles.iter().for_each(|t| pool.extend_from_slice(&t.inner));
        let mut starts = Vec::with_capacity(tiles.len());
        let (mut s, mut n) = (SHARED, SHARED + surface as u32);
        for t in &tiles {
            starts.push((s, n));
            s += t.surface.len() as u32;
            n += t.inner.len() as u32;
        }
        let mut table = vec![0u32; entries];
        let layer = dims[0] as usize * dims[1] as usize;
        let tiles_per_layer = tile_dims[0] as usize * tile_dims[1] as usize;
        table[layer..]
            .par_chunks_mut(layer * PER_TILE)
            .zip(tiles.par_chunks(tiles_per_layer))
            .enumerate()
            .for_each(|(tz, (slab, tiles))| {
                for (j, tile) in tiles.iter().enumerate() {
                    let (tx, ty) = (j % tile_dims[0] as usize, j / tile_dims[0] as usize);
                    let (s, n) = starts[tz * tiles_per_layer + j];
                    for (b, place) in tile.places.iter().enumerate() {
                        let (bx, by, bz) = (b % PER_TILE, b / PER_TILE % PER_TILE, b / PER_TILE / PER_TILE);
                        let at =
                            bz * layer + (ty * PER_TILE + by + 1) * dims[0] as usize + tx * PER_TILE + bx + 1;
                        slab[at] = match *place {
                            Place::Shared(byte) => u32::from(byte),
                            Place::Surface(k) => s + k,
                            Place::Inner(k) => n + k,
                        };
                    }
                }
            });
        Ok(Self {
            dims,
            table,
            pool,
            surface: surface as u32,
            palette,
            consistent: tiles.iter().all(|t| t.consistent),
        })
    }

    /// True when these bricks, built with the clearance of `old`, are solid where those are.
    pub(crate) fn same_shape(&self, old: &Self) -> bool {
        let range = SHARED as usize..(SHARED + self.surface) as usize;
        let solid = |w: &u32| {
            let label = w & 0x0F0F_0F0F;
            (label | label >> 1 | label >> 2 | label >> 3) & 0x0101_0101
        };
        self.consistent
            && self.surface == old.surface
            && self.pool[range.clone()]
                .iter()
                .zip(&old.pool[range])
                .all(|(a, b)| a.0.iter().map(solid).eq(b.0.iter().map(solid)))
    }

    /// Brick number and voxel within it, at a position that counts the margin.
    #[inline(always)]
    pub(crate) fn locate(&self, v: [u32; 3]) -> (u32, u32) {
        let b = [v[0] / BRICK as u32, v[1] / BRICK as u32, v[2] / BRICK as u32];
        let at =
            (b[2] as usize * self.dims[1] as usize + b[1] as usize) * self.dims[0] as usize + b[0] as usize;
        (self.table[at], (v[2] & 3) << 4 | (v[1] & 3) << 2 | v[0] & 3)
    }

    /// Positions of the bricks that may hold solid voxels, margin included: in the table, and in bricks along
    /// `[x, y, z]`.
    pub(crate) fn solid(&self) -> impl Iterator<Item = (usize, [u32; 3])> + '_ {
        let [nx, ny, _] = self.dims.map(|d| d as usize);
        self.table
            .iter()
            .enumerate()
            .filter(|&(_, &brick)| brick >= SHARED || brick & 15 != 0)
            .map(move |(i, _)| (i, [i % nx, i / nx % ny, i / nx / ny].map(|c| c as u32)))
    }

    /// The byte of a voxel at a position that counts the margin; 0, air, past its end.
    #[inline(always)]
    pub(crate) fn byte(&self, v: [u32; 3]) -> u8 {
        let [x, y, z] = self.dims;
        let edge = BRICK as u32;
        if v[0] >= x * edge || v[1] >= y * edge || v[2] >= z * edge {
            return 0;
        }
        let (brick, local) = self.locate(v);
        (self.pool[brick as usize].0[(local / 4) as usize] >> (8 * (local % 4))) as u8
    }
}

fn tile_bricks(
    grid: &LabelGrid,
    t: [u32; 3],
    tile: &Tile,
    clear: &TileClearance,
    palette: &Palette,
) -> TileBricks {
    let mut out = TileBricks {
        places: [Place::Shared(0); 64],
        surface: Vec::new(),
        inner: Vec::new(),
        consistent: true,
    };
    match (tile, clear) {
        (Tile::Constant(label), TileClearance::Empty) => {
            out.consistent = *label == AIR;
            return out;
        }
        (Tile::Dense(labels), TileClearance::Empty) => {
            out.consistent = labels.iter().all(|&l| l == AIR);
            return out;
        }
        (Tile::Constant(label), TileClearance::Deep) => {
            out.consistent = *label != AIR;
            out.places = [Place::Shared(palette.position[usize::from(*label)] | 15 << 4); 64];
            return out;
        }
        _ => {}
    }
    let mut bytes = [0u8; TILE * TILE * TILE];
    let size = grid.size();
    for (row, values) in bytes.chunks_exact_mut(TILE).enumerate() {
        let classes = clear.row(row);
        match tile {
            Tile::Dense(labels) => {
                for x in 0..TILE {
                    values[x] = palette.position[usize::from(labels[row * TILE + x])] | classes[x] << 4;
                }
            }
            Tile::Constant(label) => {
                let (y, z) = (t[1] as usize * TILE + row % TILE, t[2] as usize * TILE + row / TILE);
                if y < size[1] as usize && z < size[2] as usize {
                    let inside = (size[0] as usize - t[0] as usize * TILE).min(TILE);
                    for x in 0..inside {
                        values[x] = palette.position[usize::from(*label)] | classes[x] << 4;
                    }
                }
            }
        }
    }
    out.consistent = bytes.iter().all(|&v| v & 15 != 0 || v == 0);
    for (b, place) in out.places.iter_mut().enumerate() {
        let origin = (b / 16 * BRICK * TILE + b / 4 % 4 * BRICK) * TILE + b % 4 * BRICK;
        let mut brick = [0u8; 64];
        for (r, part) in brick.chunks_exact_mut(BRICK).enumerate() {
            let at = origin + (r / BRICK * TILE + r % BRICK) * TILE;
            part.copy_from_slice(&bytes[at..at + BRICK]);
        }
        // A solid voxel of class 0 touches air, if only at a corner.
        let surface = brick.iter().any(|&v| v != 0 && v >> 4 == 0);
        *place = if surface {
            out.surface.push(Brick::from_bytes(&brick));
            Place::Surface(out.surface.len() as u32 - 1)
        } else if brick.iter().all(|&v| v == brick[0]) {
            Place::Shared(brick[0])
        } else {
            out.inner.push(Brick::from_bytes(&brick));
            Place::Inner(out.inner.len() as u32 - 1)
        };
    }
    out
}
