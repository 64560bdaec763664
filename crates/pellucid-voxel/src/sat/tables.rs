//! The layout of one group of up to five materials: tile tables, tile records and edge lines.
//!
//! Write a corner as tile corner (X, Y, Z) plus local offset (x, y, z), each 0..=15. The count of
//! a material in the box from the origin to that corner splits into eight parts:
//!
//! | part of the box | held in |
//! | --- | --- |
//! | behind the tile and the slabs that follow it: `P(X+x, Y, Z)`, `P(X, Y+y, Z) - P(X, Y, Z)` and `P(X, Y, Z+z) - P(X, Y, Z)` | [`TileRecord::edges`], u32 |
//! | three bars, such as `[X, X+x) x [Y, Y+y) x [0, Z)` | [`TileTables::bars`] of the last mixed tile behind, u32, plus a product for the constant tiles since |
//! | the rest inside the tile | [`TileTables::local`], 12 bits a material, five to a word |
//!
//! Sums are modulo 2^32, so a difference of corners is exact for every box of fewer than 2^32
//! voxels.

use crate::TILE;

/// Materials a group counts.
pub const LANES: usize = 5;
/// Counts of a group's materials.
pub type Lanes = [u32; LANES];

/// Local offsets 1..=15 are stored; offset 0 counts nothing.
pub const INNER: usize = TILE - 1;
/// Bits of one material in a packed local count.
pub const LANE_BITS: u32 = 12;
/// Words of a tile's local table.
pub const LOCAL: usize = INNER * INNER * INNER;
/// Entries of one bar table.
pub const BAR: usize = INNER * INNER;

/// The tables of a tile that is mixed within its group; 40,884 bytes.
#[derive(Clone)]
pub struct TileTables {
    /// Packed counts of `[0, x) x [0, y) x [0, z)` within the tile, at
    /// `((z - 1) * 15 + y - 1) * 15 + x - 1` for offsets 1..=15. Material `m` of the group sits at
    /// bit `12 m`: a mixed tile holds at most 4095 voxels of one material.
    pub local: [u64; LOCAL],
    /// Per axis, the counts of the bar from the grid's lower face through the end of this tile:
    /// what lies behind the tiles that follow. Along z at `(y - 1) * 15 + x - 1`, along y at
    /// `(z - 1) * 15 + x - 1`, along x at `(z - 1) * 15 + y - 1`.
    pub bars: [[Lanes; BAR]; 3],
    /// Per axis, packed counts of the tile's first 1..=16 layers.
    pub profile: [[u64; TILE]; 3],
}

impl TileTables {
    /// All zero: what a constant tile and an empty bar refer to.
    pub(super) fn zero() -> Box<Self> {
        Box::new(Self { local: [0; LOCAL], bars: [[[0; LANES]; BAR]; 3], profile: [[0; TILE]; 3] })
    }
}

/// What a group knows of one tile; 1,056 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct TileRecord {
    /// Position of the tile's own tables; 0, the zero tables, when the tile is constant.
    pub table: u32,
    /// Per axis, position of the tables of the nearest mixed tile behind; 0 when there is none.
    pub behind: [u32; 3],
    /// Per axis, voxels of each material in one voxel line through the constant tiles since.
    pub depth: [Lanes; 3],
    /// 1 in the lane of a constant tile's material.
    pub fill: Lanes,
    /// Per axis, at local offset 0..=15: the counts up to the tile's corner moved along x, and by
    /// how much moving it along y or z adds to them.
    pub edges: [[Lanes; TILE]; 3],
}

impl TileRecord {
    pub(super) const EMPTY: Self = Self {
        table: 0,
        behind: [0; 3],
        depth: [[0; LANES]; 3],
        fill: [0; LANES],
        edges: [[[0; LANES]; TILE]; 3],
    };
}

/// The summed-area tables of one group of up to five materials.
pub struct CountTables {
    pub(super) size: [u32; 3],
    pub(super) dims: [usize; 3],
    pub(super) records: Vec<TileRecord>,
    pub(super) tables: Vec<Option<Box<TileTables>>>,
    pub(super) free: Vec<u32>,
}

impl CountTables {
    /// Tiles along `[x, y, z]`: enough that corners 0..=size+1 each fall into a tile.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Records ordered `[z][y][x]` over [`CountTables::dims`].
    pub fn records(&self) -> &[TileRecord] {
        &self.records
    }

    /// How far apart the records of neighbouring tiles lie along `[x, y, z]`.
    pub fn strides(&self) -> [usize; 3] {
        [1, self.dims[0], self.dims[0] * self.dims[1]]
    }

    /// The tables at a position named by a record.
    ///
    /// # Panics
    /// When no record names the position.
    #[inline]
    pub fn table(&self, position: u32) -> &TileTables {
        self.tables[position as usize].as_deref().expect("records name live tables")
    }

    /// Voxels of tile `t` that lie within the grid along `axis`, 0..=16.
    #[inline]
    pub fn extent(&self, axis: usize, t: usize) -> u32 {
        self.size[axis].saturating_sub((t * TILE) as u32).min(TILE as u32)
    }

    /// Counts of the box from the origin to `corner`, modulo 2^32.
    ///
    /// Corners up to one voxel past the grid's upper faces are allowed.
    ///
    /// # Panics
    /// When the corner lies further outside.
    #[inline]
    pub fn prefix(&self, corner: [u32; 3]) -> Lanes {
        let t = corner.map(|c| c as usize / TILE);
        let l = corner.map(|c| c as usize % TILE);
        let d = self.dims;
        assert!((0..3).all(|a| t[a] < d[a]), "corner {corner:?} lies outside the table");
        let record = &self.records[(t[2] * d[1] + t[1]) * d[0] + t[0]];
        let e: [usize; 3] = std::array::from_fn(|a| l[a].min(self.extent(a, t[a]) as usize));
        let mut out: Lanes = [0; LANES];
        let volume = (e[0] * e[1] * e[2]) as u32;
        for m in 0..LANES {
            out[m] = record.fill[m]
                .wrapping_mul(volume)
                .wrapping_add(record.edges[0][l[0]][m])
                .wrapping_add(record.edges[1][l[1]][m])
                .wrapping_add(record.edges[2][l[2]][m]);
        }
        for axis in 0..3 {
            let (u, v) = across(axis);
            if l[u] > 0 && l[v] > 0 {
                let bar = &self.table(record.behind[axis]).bars[axis][(l[v] - 1) * INNER + l[u] - 1];
                let area = (e[u] * e[v]) as u32;
                for m in 0..LANES {
                    out[m] =
                        out[m].wrapping_add(bar[m]).wrapping_add(record.depth[axis][m].wrapping_mul(area));
                }
            }
        }
        if record.table != 0 && l.iter().all(|&l| l > 0) {
            let packed = self.table(record.table).local[((l[2] - 1) * INNER + l[1] - 1) * INNER + l[0] - 1];
            for (out, count) in out.iter_mut().zip(unpack(packed)) {
                *out = out.wrapping_add(count);
            }
        }
        out
    }

    /// Bytes of `[tile tables, tile records]`.
    pub(super) fn memory(&self) -> [usize; 2] {
        let live = self.tables.iter().flatten().count();
        [
            live * size_of::<TileTables>() + self.tables.len() * size_of::<usize>(),
            self.records.len() * size_of::<TileRecord>(),
        ]
    }
}

/// The axes across a bar: the fast and the slow index of its table.
#[inline]
pub(super) fn across(axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

/// The five counts of a packed word. The last takes the four spare bits too.
#[inline]
pub fn unpack(word: u64) -> Lanes {
    const MASK: u64 = (1 << LANE_BITS) - 1;
    [
        (word & MASK) as u32,
        (word >> LANE_BITS & MASK) as u32,
        (word >> (2 * LANE_BITS) & MASK) as u32,
        (word >> (3 * LANE_BITS) & MASK) as u32,
        (word >> (4 * LANE_BITS)) as u32,
    ]
}
