//! Weighted sums over the solid voxels in a ball about a voxel.

use crate::occupancy::solid_row;
use crate::{LabelGrid, TILE};

/// Farthest a window reaches along an axis, in voxels.
pub(crate) const MAX_REACH: usize = 24;
/// Weight of a window's centre. Weights are whole numbers, so sums are exact in any order.
const UNIT_WEIGHT: f64 = 4096.0;

/// Sum of weights in the low 32 bits and of weights times the offset along x above them: sums of
/// such words are sums of both, as the weights of a window stay below 2^32.
#[derive(Clone, Copy, Default)]
struct Sums(i64);

impl Sums {
    fn new(weight: i64, weight_x: i64) -> Self {
        Self(weight + (weight_x << 32))
    }

    #[inline]
    fn weight(self) -> i64 {
        self.0 & 0xffff_ffff
    }

    #[inline]
    fn weight_x(self) -> i64 {
        self.0 >> 32
    }
}

/// Moments of the solid voxels of a window in voxel units times weight.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Moments {
    pub weight: i64,
    /// Along x, y, z.
    pub first: [i64; 3],
    /// xx, yy, zz, xy, xz, yz.
    pub second: [i64; 6],
}

/// A ball of weights 1 - (r / radius)².
pub(crate) struct Window {
    pub reach: [usize; 3],
    /// Bytes that hold a row of 2 * reach x + 1 bits.
    bytes: usize,
    /// `[|dz|][|dy|][byte][256]`.
    sums: Vec<Sums>,
    /// Weights times the square of the offset along x, in the same order.
    squares: Vec<i64>,
    /// Offsets dz, dy of the rows that have weight, and the weight of a whole row.
    rows: Vec<([i32; 2], i64)>,
    /// Length in mm times weight of the first moment of a half-space.
    pub half_space: f64,
}

impl Window {
    /// A window of `radius` mm, which reaches at most [`MAX_REACH`] voxels.
    pub(crate) fn new(radius: f64, pitch: [f64; 3]) -> Self {
        let reach = pitch.map(|p| ((radius / p).ceil() as usize).saturating_sub(1).min(MAX_REACH));
        let bytes = (2 * reach[0] + 1).div_ceil(8);
        let distance2 = |d: [usize; 3]| (0..3).map(|a| (d[a] as f64 * pitch[a]).powi(2)).sum::<f64>();
        let weight = |d| (UNIT_WEIGHT * (1.0 - distance2(d) / (radius * radius)).max(0.0)).round() as i64;
        let entries = (reach[2] + 1) * (reach[1] + 1) * bytes * 256;
        let (mut sums, mut squares) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
        for dz in 0..=reach[2] {
            for dy in 0..=reach[1] {
                for byte in 0..bytes {
                    for bits in 0..256usize {
                        let (mut w, mut wx, mut wxx) = (0, 0, 0);
                        for bit in (0..8).filter(|b| bits >> b & 1 == 1) {
                            let dx = (byte * 8 + bit) as i64 - reach[0] as i64;
                            if dx <= reach[0] as i64 {
                                let weight = weight([dx.unsigned_abs() as usize, dy, dz]);
                                w += weight;
                                wx += weight * dx;
                                wxx += weight * dx * dx;
                            }
                        }
                        sums.push(Sums::new(w, wx));
                        squares.push(wxx);
                    }
                }
            }
        }
        let offsets = |a: usize| -(reach[a] as i32)..=reach[a] as i32;
        let mut rows = Vec::new();
        let mut total = 0.0;
        for dz in offsets(2) {
            for dy in offsets(1) {
                let [y, z] = [dy, dz].map(|d| d.unsigned_abs() as usize);
                let mut whole = 0;
                for dx in offsets(0) {
                    let d = [dx.unsigned_abs() as usize, y, z];
                    whole += weight(d);
                    total += weight(d) as f64 * distance2(d).sqrt();
                }
                if whole > 0 {
                    rows.push(([dz, dy], whole));
                }
            }
        }
        // With weights that depend on the radius only, the first moment of a half-space is a
        // quarter of the ball's first absolute moment.
        Self { reach, bytes, sums, squares, rows, half_space: total / 4.0 }
    }

    /// First moment of the solid voxels about tile-local voxel `[x, y, z]`.
    pub(crate) fn first(&self, block: &Block, local: [usize; 3]) -> [i64; 3] {
        let mut m = [0i64; 3];
        let all = self.row_mask();
        self.for_rows(block, local, |dy, dz, table, bits, whole| {
            // By symmetry a whole row has no first moment along x.
            let mut sum = Sums(whole);
            if bits != all {
                sum.0 = 0;
                for byte in 0..self.bytes {
                    sum.0 += self.sums[table + byte * 256 + (bits >> (8 * byte) & 0xff) as usize].0;
                }
            }
            m[0] += sum.weight_x();
            m[1] += sum.weight() * dy;
            m[2] += sum.weight() * dz;
        });
        m
    }

    /// Moments of the solid voxels about tile-local voxel `[x, y, z]`.
    pub(crate) fn moments(&self, block: &Block, local: [usize; 3]) -> Moments {
        let mut m = Moments::default();
        self.for_rows(block, local, |dy, dz, table, bits, _| {
            for byte in 0..self.bytes {
                let i = table + byte * 256 + (bits >> (8 * byte) & 0xff) as usize;
                let (w, wx) = (self.sums[i].weight(), self.sums[i].weight_x());
                m.weight += w;
                for (sum, term) in m.first.iter_mut().zip([wx, w * dy, w * dz]) {
                    *sum += term;
                }
                let second = [self.squares[i], w * dy * dy, w * dz * dz, wx * dy, wx * dz, w * dy * dz];
                for (sum, term) in m.second.iter_mut().zip(second) {
                    *sum += term;
                }
            }
        });
        m
    }

    /// A bit for each voxel of a row.
    fn row_mask(&self) -> u64 {
        (1 << (2 * self.reach[0] + 1)) - 1
    }

    /// Calls `add(dy, dz, table, bits, whole)` for each row of the window with solid voxels:
    /// where the row's entries start, its solid voxels and the weight of the whole row.
    #[inline]
    fn for_rows(&self, block: &Block, [x, y, z]: [usize; 3], mut add: impl FnMut(i64, i64, usize, u64, i64)) {
        let mask = self.row_mask();
        let shift = x + MAX_REACH - self.reach[0];
        for &([dz, dy], whole) in &self.rows {
            let bits = block.row(y as i32 + dy, z as i32 + dz) >> shift & mask;
            if bits != 0 {
                let row = dz.unsigned_abs() as usize * (self.reach[1] + 1) + dy.unsigned_abs() as usize;
                add(i64::from(dy), i64::from(dz), row * self.bytes * 256, bits, whole);
            }
        }
    }
}

/// The solid bits of a tile and its surroundings: each row a word that starts [`MAX_REACH`]
/// voxels before the tile along x.
pub(crate) struct Block {
    reach: [i32; 2],
    rows: Vec<u64>,
}

impl Block {
    /// Reads tile `t` and what lies within `reach` voxels of it.
    pub(crate) fn new(grid: &LabelGrid, t: [u32; 3], reach: [usize; 3]) -> Self {
        let [tx, ty, tz] = t.map(i64::from);
        let [ry, rz] = [reach[1] as i64, reach[2] as i64];
        let side = TILE as i64;
        let mut rows = Vec::with_capacity((TILE + 2 * reach[1]) * (TILE + 2 * reach[2]));
        for z in tz * side - rz..(tz + 1) * side + rz {
            for y in ty * side - ry..(ty + 1) * side + ry {
                let part = |step: i64| u64::from(solid_row(grid, tx + step, y, z));
                let mut bits = part(-1) << 8 | part(0) << 24 | part(1) << 40;
                if reach[0] > TILE {
                    bits |= part(-2) >> 8 | part(2) << 56;
                }
                rows.push(bits);
            }
        }
        Self { reach: [reach[1] as i32, reach[2] as i32], rows }
    }

    /// The row at tile-local y and z.
    #[inline]
    fn row(&self, y: i32, z: i32) -> u64 {
        let [ry, rz] = self.reach;
        self.rows[((z + rz) * (TILE as i32 + 2 * ry) + y + ry) as usize]
    }

    /// Whether a voxel at tile-local coordinates is solid.
    pub(crate) fn solid(&self, [x, y, z]: [i32; 3]) -> bool {
        self.row(y, z) >> (x + MAX_REACH as i32) & 1 == 1
    }
}
