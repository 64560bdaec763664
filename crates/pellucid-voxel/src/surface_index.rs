//! From a voxel to its position in the list of surface voxels.

use crate::occupancy::ROWS;
use crate::{TILE, VoxelError};

/// Marks a tile without surface voxels.
const NO_SLOT: u32 = u32::MAX;
/// Most surface voxels: positions are 32 bits and the last one is no position.
const MAX_VOXELS: u64 = u32::MAX as u64 - 1;
/// Most tiles of a grid. A frame of the most voxels has half of these unless it is all edges.
const MAX_TILES: u64 = 1 << 29;

/// Position of each surface voxel in the list ordered by (z, y, x). Tiles with surface voxels hold
/// one word a row of 16: the list position of the row's first surface voxel and a bit a voxel.
#[derive(Clone, Debug)]
pub(crate) struct SurfaceIndex {
    tile_dims: [u32; 3],
    /// One entry a tile: where its rows start in `rows`, divided by [`ROWS`].
    slots: Vec<u32>,
    /// Low 32 bits: list position before the row; next 16 bits: the surface voxels.
    rows: Vec<u64>,
    /// First list position of each layer of tiles, and the list's length.
    slabs: Vec<u32>,
}

impl SurfaceIndex {
    /// The number of tiles, when it is one this index handles.
    pub(crate) fn check_size(tile_dims: [u32; 3]) -> Result<usize, VoxelError> {
        let tiles: u64 = tile_dims.iter().map(|&d| u64::from(d)).product();
        if tiles > MAX_TILES {
            return Err(VoxelError::unsupported(
                "frame size",
                format!("{tiles} tiles, more than {MAX_TILES}; use a coarser pitch or a smaller object"),
            ));
        }
        Ok(tiles as usize)
    }

    /// Builds the index from the surface rows of each tile that has any, ascending by tile index.
    pub(crate) fn new(tile_dims: [u32; 3], tiles: &[(u32, [u16; ROWS])]) -> Result<Self, VoxelError> {
        let mut index = Self::with_capacity(tile_dims, tiles.len())?;
        let per_slab = tile_dims[0] * tile_dims[1];
        let mut rest = tiles;
        for tz in 0..tile_dims[2] {
            let (slab, next) = rest.split_at(rest.partition_point(|(tile, _)| tile / per_slab == tz));
            index.push_slab(slab)?;
            rest = next;
        }
        Ok(index)
    }

    /// An index without layers of tiles yet, with room for `tiles` tiles that have surface voxels.
    pub(crate) fn with_capacity(tile_dims: [u32; 3], tiles: usize) -> Result<Self, VoxelError> {
        let slots = vec![NO_SLOT; Self::check_size(tile_dims)?];
        let mut slabs = Vec::with_capacity(tile_dims[2] as usize + 1);
        slabs.push(0);
        Ok(Self { tile_dims, slots, rows: Vec::with_capacity(tiles * ROWS), slabs })
    }

    /// Adds the next layer of tiles: the surface rows of each of its tiles that has any, ascending by tile index.
    pub(crate) fn push_slab(&mut self, tiles: &[(u32, [u16; ROWS])]) -> Result<(), VoxelError> {
        let first = self.rows.len() / ROWS;
        for (slot, (tile, _)) in (first..).zip(tiles) {
            self.slots[*tile as usize] = slot as u32;
        }
        self.rows.resize(self.rows.len() + tiles.len() * ROWS, 0);
        let dx = self.tile_dims[0];
        let mut next = self.len() as u64;
        for z in 0..TILE {
            let mut start = first;
            for line in tiles.chunk_by(|a, b| a.0 / dx == b.0 / dx) {
                for y in 0..TILE {
                    for (i, (_, masks)) in line.iter().enumerate() {
                        let mask = masks[z * TILE + y];
                        self.rows[(start + i) * ROWS + z * TILE + y] =
                            next & u64::from(u32::MAX) | u64::from(mask) << 32;
                        next += u64::from(mask.count_ones());
                    }
                }
                start += line.len();
            }
        }
        if next > MAX_VOXELS {
            return Err(too_many(next));
        }
        self.slabs.push(next as u32);
        Ok(())
    }

    /// Number of surface voxels.
    pub(crate) fn len(&self) -> usize {
        self.slabs.last().map_or(0, |&n| n as usize)
    }

    /// The list position of a surface voxel; `None` for any other voxel, also outside the grid.
    #[inline]
    pub(crate) fn get(&self, voxel: [u32; 3]) -> Option<u32> {
        const T: u32 = TILE as u32;
        let [tx, ty, tz] = voxel.map(|v| v / T);
        let [dx, dy, dz] = self.tile_dims;
        if tx >= dx || ty >= dy || tz >= dz {
            return None;
        }
        let slot = self.slots[(tz as usize * dy as usize + ty as usize) * dx as usize + tx as usize];
        if slot == NO_SLOT {
            return None;
        }
        let row = self.rows[slot as usize * ROWS + (voxel[2] % T * T + voxel[1] % T) as usize];
        let x = voxel[0] % T;
        let mask = (row >> 32) as u32;
        (mask >> x & 1 == 1).then(|| row as u32 + (mask & ((1 << x) - 1)).count_ones())
    }

    /// List position before each of a tile's rows and the rows' surface bits; `None` for a tile
    /// without surface voxels.
    pub(crate) fn tile_rows(&self, tile_index: usize) -> Option<impl Iterator<Item = (u32, u16)>> {
        let slot = self.slots[tile_index];
        (slot != NO_SLOT).then(|| {
            self.rows[slot as usize * ROWS..(slot as usize + 1) * ROWS]
                .iter()
                .map(|&row| (row as u32, (row >> 32) as u16))
        })
    }

    /// Whether a tile has surface voxels.
    #[inline]
    pub(crate) fn has_tile(&self, tile_index: usize) -> bool {
        self.slots[tile_index] != NO_SLOT
    }

    /// The surface voxels of a tile's row `z * 16 + y`, one bit each.
    #[inline]
    pub(crate) fn row_mask(&self, tile_index: usize, row: usize) -> u16 {
        match self.slots[tile_index] {
            NO_SLOT => 0,
            slot => (self.rows[slot as usize * ROWS + row] >> 32) as u16,
        }
    }

    /// List positions of the surface voxels in one layer of tiles.
    pub(crate) fn slab(&self, tz: usize) -> std::ops::Range<usize> {
        self.slabs[tz] as usize..self.slabs[tz + 1] as usize
    }

    /// Indices of the tiles with surface voxels in one layer of tiles, ascending.
    pub(crate) fn slab_tiles(&self, tz: usize) -> Vec<usize> {
        let per_slab = self.tile_dims[0] as usize * self.tile_dims[1] as usize;
        (tz * per_slab..(tz + 1) * per_slab).filter(|&i| self.slots[i] != NO_SLOT).collect()
    }

    /// Bytes held.
    pub(crate) fn memory_bytes(&self) -> usize {
        self.slots.len() * size_of::<u32>()
            + self.rows.len() * size_of::<u64>()
            + self.slabs.len() * size_of::<u32>()
    }

    /// What [`SurfaceIndex::memory_bytes`] will be of a grid with so many tiles with surface voxels.
    pub(crate) fn memory_of(tile_dims: [u32; 3], tiles: u64) -> u64 {
        let all: u64 = tile_dims.iter().map(|&d| u64::from(d)).product();
        let words = all + u64::from(tile_dims[2]) + 1;
        words * size_of::<u32>() as u64 + tiles * (ROWS * size_of::<u64>()) as u64
    }
}

fn too_many(voxels: u64) -> VoxelError {
    VoxelError::unsupported(
        "surface",
        format!(
            "{voxels} surface voxels or more; at most {MAX_VOXELS}: use a coarser pitch or a smaller object"
        ),
    )
}
