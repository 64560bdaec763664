//! Outward normals from the solid voxels about a surface voxel.
//!
//! The estimate is the gradient of the smoothed solid, turned outward: minus the first moment
//! of the solid voxels within a ball in millimetres, weighted by a smooth function of distance.
//! Weights are integers, so sums are exact: a mirrored volume has mirrored normals and a
//! symmetric surrounding has a moment of exactly zero.
//!
//! An estimate is taken when its moment is not negligible and it does not point into the solid:
//! its product with the sum of the directions to the voxel's open faces must be positive. Else
//! the ball's radius is halved, which keeps other parts nearby (the far side of a thin sheet or
//! of a narrow gap) out of it. When no ball serves, the sum of the open faces' directions is
//! taken; when that is zero too (a lone voxel, a sheet one voxel thick), the first open face in
//! the order +z, -z, +x, -x, +y, -y.

use crate::occupancy::solid_row;
use crate::{LabelGrid, TILE, VoxelError};

/// Farthest a window reaches along an axis, in voxels.
const MAX_REACH: usize = 24;
/// Longest window in voxel edges it is raised to, along the coarsest axis.
const MIN_EDGES: f64 = 1.75;
/// Weight of a window's centre.
const UNIT_WEIGHT: f64 = 4096.0;
/// Least moment taken, as a part of that of a half-space.
const LEAST_MOMENT: f64 = 0.05;

/// Sums over one byte of a row: weights, and weights times the offset along x.
#[derive(Clone, Copy, Default)]
struct Sums {
    weight: i32,
    weight_x: i32,
}

/// A ball of weights about a voxel.
struct Window {
    reach: [usize; 3],
    /// Bytes that hold a row of 2 * reach x + 1 bits.
    bytes: usize,
    /// `[|dz|][|dy|][byte][256]`.
    sums: Vec<Sums>,
    /// Offsets dz, dy of the rows that have weight.
    rows: Vec<[i32; 2]>,
    least_moment: f64,
}

impl Window {
    fn new(radius: f64, pitch: [f64; 3]) -> Self {
        let reach = pitch.map(|p| ((radius / p).ceil() as usize - 1).min(MAX_REACH));
        let bytes = (2 * reach[0] + 1).div_ceil(8);
        let weight = |d: [usize; 3]| {
            let r2: f64 = (0..3).map(|a| (d[a] as f64 * pitch[a]).powi(2)).sum();
            let s = (1.0 - r2 / (radius * radius)).max(0.0);
            (UNIT_WEIGHT * s * s).round() as i32
        };
        let mut sums = Vec::with_capacity((reach[2] + 1) * (reach[1] + 1) * bytes * 256);
        let mut total = 0.0;
        for dz in 0..=reach[2] {
            for dy in 0..=reach[1] {
                for byte in 0..bytes {
                    sums.extend((0..256usize).map(|bits| {
                        let mut s = Sums::default();
                        for bit in (0..8).filter(|b| bits >> b & 1 == 1) {
                            let dx = (byte * 8 + bit) as i32 - reach[0] as i32;
                            if dx <= reach[0] as i32 {
                                let w = weight([dx.unsigned_abs() as usize, dy, dz]);
                                s.weight += w;
                                s.weight_x += w * dx;
                            }
                        }
                        s
                    }));
                }
            }
        }
        let mut rows = Vec::new();
        for dz in -(reach[2] as i32)..=reach[2] as i32 {
            for dy in -(reach[1] as i32)..=reach[1] as i32 {
                let [y, z] = [dy, dz].map(|d| d.unsigned_abs() as usize);
                if weight([0, y, z]) > 0 {
                    rows.push([dz, dy]);
                }
                for dx in -(reach[0] as i32)..=reach[0] as i32 {
                    let x = dx.unsigned_abs() as usize;
                    let d: f64 =
                        [(x, 0), (y, 1), (z, 2)].iter().map(|&(n, a)| (n as f64 * pitch[a]).powi(2)).sum();
                    total += f64::from(weight([x, y, z])) * d.sqrt();
                }
            }
        }
        // In a half-space of constant weight by radius, the moment is a quarter of the ball's
        // first absolute moment.
        Self { reach, bytes, sums, rows, least_moment: LEAST_MOMENT * total / 4.0 }
    }

    /// First moment `[x, y, z]` of the solid voxels in voxel units times weight.
    fn moment(&self, block: &Block, x: usize, y: usize, z: usize) -> [i64; 3] {
        let shift = x + MAX_REACH - self.reach[0];
        let [mut mx, mut my, mut mz] = [0i64; 3];
        for &[dz, dy] in &self.rows {
            let bits = block.row(y as i32 + dy, z as i32 + dz) >> shift;
            if bits == 0 {
                continue;
            }
            let table =
                (dz.unsigned_abs() as usize * (self.reach[1] + 1) + dy.unsigned_abs() as usize) * self.bytes;
            let (mut w, mut wx) = (0i32, 0i32);
            for byte in 0..self.bytes {
                let s = self.sums[(table + byte) * 256 + (bits >> (8 * byte) & 0xff) as usize];
                w += s.weight;
                wx += s.weight_x;
            }
            mx += i64::from(wx);
            my += i64::from(w) * i64::from(dy);
            mz += i64::from(w) * i64::from(dz);
        }
        [mx, my, mz]
    }
}

/// The solid bits of a tile and its surroundings: each row a word that starts 24 voxels before
/// the tile along x.
struct Block {
    reach: [i32; 2],
    rows: Vec<u64>,
}

impl Block {
    fn new(grid: &LabelGrid, t: [u32; 3], reach: [usize; 3]) -> Self {
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
    fn solid(&self, x: i32, y: i32, z: i32) -> bool {
        self.row(y, z) >> (x + MAX_REACH as i32) & 1 == 1
    }
}

/// Estimates normals tile by tile.
pub(crate) struct NormalEstimator<'a> {
    grid: &'a LabelGrid,
    pitch: [f64; 3],
    windows: Vec<Window>,
    reach: [usize; 3],
}

impl<'a> NormalEstimator<'a> {
    pub(crate) fn new(grid: &'a LabelGrid, radius_mm: f64) -> Result<Self, VoxelError> {
        if !(radius_mm.is_finite() && radius_mm > 0.0) {
            return Err(VoxelError::invalid(
                "normal_radius_mm",
                format!("{radius_mm}; it must be finite and above 0, such as 0.25"),
            ));
        }
        let edges = grid.frame().pitch();
        let pitch = edges.mm();
        let mut radius = radius_mm.max(MIN_EDGES * edges.max_mm()).min(MAX_REACH as f64 * edges.min_mm());
        let mut windows = Vec::new();
        while radius > edges.min_mm() {
            windows.push(Window::new(radius, pitch));
            radius /= 2.0;
        }
        let reach = std::array::from_fn(|a| windows.iter().map(|w| w.reach[a]).fold(1, usize::max));
        Ok(Self { grid, pitch, windows, reach })
    }

    /// Normals of a tile's surface voxels, in the order of `points`.
    pub(crate) fn tile(&self, t: [u32; 3], points: &[(u32, [u32; 3])]) -> Vec<[f32; 3]> {
        let block = Block::new(self.grid, t, self.reach);
        points.iter().map(|(_, voxel)| self.normal(&block, voxel.map(|v| v as usize % TILE))).collect()
    }

    fn normal(&self, block: &Block, local: [usize; 3]) -> [f32; 3] {
        let [x, y, z] = local;
        let open = |d: [i32; 3]| !block.solid(x as i32 + d[0], y as i32 + d[1], z as i32 + d[2]);
        let faces = FACES.map(open);
        let outward: [f64; 3] = std::array::from_fn(|a| {
            FACES.iter().zip(faces).filter(|(_, open)| *open).map(|(d, _)| f64::from(d[a])).sum()
        });
        let inner = |n: [f64; 3]| (0..3).map(|a| n[a] * outward[a]).sum::<f64>();
        let lone = outward == [0.0; 3];
        for window in &self.windows {
            let m = window.moment(block, x, y, z);
            let n: [f64; 3] = std::array::from_fn(|a| -(m[a] as f64) * self.pitch[a]);
            let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
            if length >= window.least_moment && (inner(n) > 0.0 || lone) {
                return n.map(|c| (c / length) as f32);
            }
        }
        if !lone {
            let length = inner(outward).sqrt();
            return outward.map(|c| (c / length) as f32);
        }
        let face = FACES.iter().zip(faces).find(|(_, open)| *open).map_or([0, 0, 1], |(d, _)| *d);
        face.map(|c| c as f32)
    }
}

/// Directions to the six face neighbours in the order of preference.
const FACES: [[i32; 3]; 6] = [[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]];
