//! One block of the nearest-surface map: three passes over a box of tiles and its surroundings.

use crate::envelope::Envelope;
use crate::occupancy::{ROWS, solid_rows};
use crate::surface_index::SurfaceIndex;
use crate::{AIR, Control, Frame, LabelGrid, TILE, TILE_VOXELS, Tile, VoxelError};

/// The entry of a voxel without a surface voxel within reach.
pub(crate) const NONE: u32 = u32::MAX;

/// Farthest reach along an axis in voxels: offsets are stored in 16 bits.
const MAX_REACH: i64 = 16383;
/// Most voxels of a block along an axis.
const MAX_BLOCK: usize = 128;
/// Bytes a block's offsets may take before its x and y edges are cut.
const BLOCK_BYTES: usize = 64 << 20;
/// Parts of a distance by which one equal to the depth may pass it through rounding.
const SLACK: f64 = 1e-9;
/// No site along a row or in a plane.
const NO_OFFSET: i16 = i16::MIN;

/// The entries of a tile with its position in the grid's list.
pub(crate) type TileEntries = (usize, Box<[u32; TILE_VOXELS]>);

/// What is common to all blocks.
#[derive(Debug)]
pub(crate) struct Plan {
    /// Squared edges as integers.
    weights: [i64; 3],
    /// Largest squared distance in units of the weights.
    limit: i64,
    /// Voxels along each axis within the depth.
    reach: [i64; 3],
    /// Voxels of a block along each axis, multiples of 16.
    block: [usize; 3],
}

impl Plan {
    pub(crate) fn new(frame: &Frame, depth_mm: f64) -> Result<Self, VoxelError> {
        if !(depth_mm.is_finite() && depth_mm >= 0.0) {
            return Err(VoxelError::invalid(
                "depth_mm",
                format!("{depth_mm}; it must be finite and at least 0"),
            ));
        }
        let mm = frame.pitch().mm();
        let size = frame.size();
        let reach: [i64; 3] = std::array::from_fn(|a| {
            let voxels = (depth_mm / mm[a] * (1.0 + SLACK)).floor();
            voxels.min(f64::from(size[a] - 1)) as i64
        });
        if let Some(a) = (0..3).find(|&a| reach[a] > MAX_REACH) {
            return Err(VoxelError::unsupported(
                "depth_mm",
                format!(
                    "{depth_mm} mm reaches {} voxels along {}, more than {MAX_REACH}; use at most {} mm",
                    reach[a],
                    ["x", "y", "z"][a],
                    MAX_REACH as f64 * mm[a]
                ),
            ));
        }
        let mut block = reach.map(|r| (2 * r as usize).next_multiple_of(TILE).clamp(2 * TILE, MAX_BLOCK));
        let bytes = |b: [usize; 3]| (b[2] + 2 * reach[2] as usize) * b[1] * b[0] * size_of::<[i16; 2]>();
        while bytes(block) > BLOCK_BYTES && block[0].max(block[1]) > TILE {
            let a = usize::from(block[1] > block[0]);
            block[a] = (block[a] / 2).next_multiple_of(TILE);
        }
        let extent: [i64; 3] = std::array::from_fn(|a| 2 * reach[a] + block[a] as i64);
        let (weights, scale) = integer_weights(mm, extent);
        let most = weights.iter().zip(reach).map(|(w, r)| w * r * r).sum::<i64>();
        let limit = (depth_mm * depth_mm * scale * (1.0 + 2.0 * SLACK)).min(most as f64) as i64;
        Ok(Self { weights, limit, reach, block })
    }

    /// Lower corners of all blocks of a grid.
    pub(crate) fn blocks(&self, size: [u32; 3]) -> Vec<[usize; 3]> {
        let corners = |a: usize| (0..size[a] as usize).step_by(self.block[a]);
        corners(2).flat_map(|z| corners(1).flat_map(move |y| corners(0).map(move |x| [x, y, z]))).collect()
    }

    /// The tiles with entries of the block at `origin`, ascending.
    pub(crate) fn block(
        &self,
        grid: &LabelGrid,
        index: &SurfaceIndex,
        origin: [usize; 3],
        control: &Control,
    ) -> Result<Vec<TileEntries>, VoxelError> {
        control.check()?;
        let size = grid.size().map(|s| s as usize);
        let extent: [usize; 3] = std::array::from_fn(|a| self.block[a].min(size[a] - origin[a]));
        let tiles = solid_tiles(grid, origin, extent);
        if tiles.is_empty() {
            return Ok(Vec::new());
        }
        let low: [usize; 3] = std::array::from_fn(|a| origin[a].saturating_sub(self.reach[a] as usize));
        let high: [usize; 3] =
            std::array::from_fn(|a| (origin[a] + extent[a] + self.reach[a] as usize).min(size[a]));
        if !any_site(grid, index, low, high) {
            return Ok(Vec::new());
        }
        let mut planes = Planes { plan: self, grid, index, origin, extent, low, high, rows: Vec::new() };
        let area = extent[0] * extent[1];
        let mut offsets = vec![[NO_OFFSET; 2]; (high[2] - low[2]) * area];
        let mut used = Vec::new();
        for (z, plane) in (low[2]..high[2]).zip(offsets.chunks_exact_mut(area)) {
            control.check()?;
            if planes.fill(z, plane) {
                used.push(z);
            }
        }
        Ok(self.along_z(index, origin, extent, low[2], &used, &offsets, &tiles))
    }

    /// The last pass: from the nearest site in each plane to the nearest of all.
    fn along_z(
        &self,
        index: &SurfaceIndex,
        origin: [usize; 3],
        extent: [usize; 3],
        low_z: usize,
        used: &[usize],
        offsets: &[[i16; 2]],
        tiles: &[SolidTile],
    ) -> Vec<TileEntries> {
        let [wx, wy, wz] = self.weights;
        let area = extent[0] * extent[1];
        let mut entries: Vec<Option<Box<[u32; TILE_VOXELS]>>> = vec![None; tiles.len()];
        let mut envelope = Envelope::new(wz, extent[2]);
        let mut line = vec![[[NO_OFFSET; 2]; TILE]; used.len()];
        let mut columns: Vec<[usize; 2]> = tiles.iter().map(|t| [t.corner[0], t.corner[1]]).collect();
        columns.sort_unstable();
        columns.dedup();
        for [cx, cy] in columns {
            let stack: Vec<usize> =
                (0..tiles.len()).filter(|&i| [tiles[i].corner[0], tiles[i].corner[1]] == [cx, cy]).collect();
            let width = TILE.min(extent[0] - cx);
            for y in 0..TILE.min(extent[1] - cy) {
                for (values, &z) in line.iter_mut().zip(used) {
                    let start = (z - low_z) * area + (cy + y) * extent[0] + cx;
                    values[..width].copy_from_slice(&offsets[start..start + width]);
                }
                for x in 0..width {
                    envelope.clear();
                    for (values, &z) in line.iter().zip(used) {
                        let [dx, dy] = values[x].map(i64::from);
                        if values[x][0] != NO_OFFSET {
                            envelope.push(z as i64 - origin[2] as i64, wx * dx * dx + wy * dy * dy);
                        }
                    }
                    if envelope.is_empty() {
                        continue;
                    }
                    let mut of_tile = 0;
                    envelope.visit(self.limit, |z, site| {
                        while of_tile < stack.len() && tiles[stack[of_tile]].corner[2] + TILE <= z {
                            of_tile += 1;
                        }
                        let Some(&i) = stack.get(of_tile) else { return };
                        let tile = &tiles[i];
                        if z < tile.corner[2] || tile.rows[(z - tile.corner[2]) * TILE + y] >> x & 1 == 0 {
                            return;
                        }
                        let site_z = (origin[2] as i64 + site) as usize;
                        let [dx, dy] =
                            offsets[(site_z - low_z) * area + (cy + y) * extent[0] + cx + x].map(i64::from);
                        let at = [
                            ((origin[0] + cx + x) as i64 + dx) as u32,
                            ((origin[1] + cy + y) as i64 + dy) as u32,
                            site_z as u32,
                        ];
                        let entry = &mut entries[i].get_or_insert_with(|| Box::new([NONE; TILE_VOXELS]));
                        entry[((z - tile.corner[2]) * TILE + y) * TILE + x] = index.get(at).unwrap_or(NONE);
                    });
                }
            }
        }
        tiles.iter().zip(entries).filter_map(|(tile, e)| Some((tile.index, e?))).collect()
    }
}

/// The squared edges as integers and what 1 mm² is in them. `extent` bounds the distances that
/// are compared, in voxels.
fn integer_weights(mm: [f64; 3], extent: [i64; 3]) -> ([i64; 3], f64) {
    const MOST: f64 = (1i64 << 57) as f64;
    let squares = mm.map(|p| p * p);
    let least = squares.iter().copied().fold(f64::INFINITY, f64::min);
    let fits = |scale: f64| (0..3).all(|a| squares[a] * scale * (extent[a] as f64).powi(2) <= MOST);
    let whole =
        |scale: f64| squares.iter().all(|s| (s * scale - (s * scale).round()).abs() <= 1e-12 * s * scale);
    let fraction = (1..=1 << 16).map(|d| f64::from(d) / least).find(|&scale| whole(scale));
    let longest = (0..3).map(|a| squares[a] * (extent[a] as f64).powi(2)).fold(0.0, f64::max);
    let scale = fraction.filter(|&scale| fits(scale)).unwrap_or(MOST / longest);
    (squares.map(|s| ((s * scale).round() as i64).max(1)), scale)
}

/// A tile of a block with solid voxels.
struct SolidTile {
    index: usize,
    /// Lower corner within the block.
    corner: [usize; 3],
    rows: [u16; ROWS],
}

fn solid_tiles(grid: &LabelGrid, origin: [usize; 3], extent: [usize; 3]) -> Vec<SolidTile> {
    let mut tiles = Vec::new();
    for z in (0..extent[2]).step_by(TILE) {
        for y in (0..extent[1]).step_by(TILE) {
            for x in (0..extent[0]).step_by(TILE) {
                let corner = [x, y, z];
                let t = std::array::from_fn(|a| ((origin[a] + corner[a]) / TILE) as u32);
                if !matches!(grid.tile(t), Tile::Constant(AIR)) {
                    tiles.push(SolidTile { index: grid.tile_index(t), corner, rows: solid_rows(grid, t) });
                }
            }
        }
    }
    tiles
}

/// Whether a tile that overlaps the box holds surface voxels.
fn any_site(grid: &LabelGrid, index: &SurfaceIndex, low: [usize; 3], high: [usize; 3]) -> bool {
    let tiles = |a: usize| (low[a] / TILE) as u32..high[a].div_ceil(TILE) as u32;
    tiles(2).any(|z| tiles(1).any(|y| tiles(0).any(|x| index.has_tile(grid.tile_index([x, y, z])))))
}

/// The first two passes: the nearest site within each plane of constant z.
struct Planes<'a> {
    plan: &'a Plan,
    grid: &'a LabelGrid,
    index: &'a SurfaceIndex,
    origin: [usize; 3],
    extent: [usize; 3],
    low: [usize; 3],
    high: [usize; 3],
    /// Offset along x to the nearest site of the row, rows with sites only.
    rows: Vec<i16>,
}

impl Planes<'_> {
    /// Writes the offsets `[x, y]` to the nearest site in plane z, ordered `[y][x]`; false when
    /// none is within reach.
    fn fill(&mut self, z: usize, plane: &mut [[i16; 2]]) -> bool {
        let ys = self.along_x(z);
        if ys.is_empty() {
            return false;
        }
        let [wx, wy, _] = self.plan.weights;
        let width = self.extent[0];
        let y0 = self.origin[1] as i64;
        let first_row = self.low[1];
        let mut row_of = vec![0; self.high[1] - first_row];
        for (row, &y) in ys.iter().enumerate() {
            row_of[y - first_row] = row;
        }
        let mut envelope = Envelope::new(wy, self.extent[1]);
        for x in 0..width {
            envelope.clear();
            for (row, &y) in ys.iter().enumerate() {
                let dx = self.rows[row * width + x];
                if dx != NO_OFFSET {
                    let dx = i64::from(dx);
                    envelope.push(y as i64 - y0, wx * dx * dx);
                }
            }
            envelope.visit(self.plan.limit, |y, site| {
                let row = row_of[(site + y0) as usize - first_row];
                plane[y * width + x] = [self.rows[row * width + x], (site - y as i64) as i16];
            });
        }
        true
    }

    /// Fills `rows` with the offset along x to the nearest site of each row in plane z that has
    /// any within reach, and returns these rows' y.
    fn along_x(&mut self, z: usize) -> Vec<usize> {
        let width = self.extent[0];
        let x0 = self.origin[0] as i64;
        let reach = self.plan.reach[0];
        let mut ys = Vec::new();
        let mut sites: Vec<i64> = Vec::new();
        self.rows.clear();
        for y in self.low[1]..self.high[1] {
            sites.clear();
            for tx in self.low[0] / TILE..self.high[0].div_ceil(TILE) {
                let t = [tx as u32, (y / TILE) as u32, (z / TILE) as u32];
                let mut bits = self.index.row_mask(self.grid.tile_index(t), z % TILE * TILE + y % TILE);
                while bits != 0 {
                    sites.push((tx * TILE) as i64 + i64::from(bits.trailing_zeros()) - x0);
                    bits &= bits - 1;
                }
            }
            let start = self.rows.len();
            self.rows.resize(start + width, NO_OFFSET);
            let row = &mut self.rows[start..];
            let mut any = false;
            for (i, &site) in sites.iter().enumerate() {
                // At equal distance the lower site wins.
                let from = if i > 0 { (sites[i - 1] + site).div_euclid(2) + 1 } else { 0 };
                let to = sites.get(i + 1).map_or(width as i64 - 1, |next| (site + next).div_euclid(2));
                for x in from.max(site - reach).max(0)..=to.min(site + reach).min(width as i64 - 1) {
                    row[x as usize] = (site - x) as i16;
                    any = true;
                }
            }
            if any {
                ys.push(y);
            } else {
                self.rows.truncate(start);
            }
        }
        ys
    }
}
