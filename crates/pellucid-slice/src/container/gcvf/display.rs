//! What a GCVF shows before it is printed: a mesh of blocks, its bounds and the topmost layers.

use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_voxel::{AIR, LabelGrid, TILE, Tile};
use png::{BitDepth, ColorType, EncodingError};
use rayon::prelude::*;

use crate::RowOrder;

/// So many blocks along the longest edge.
const BLOCKS: f64 = 64.0;

/// An object to be shown.
pub(super) struct Display<'a> {
    pub grid: &'a LabelGrid,
    pub rows: RowOrder,
}

impl Display<'_> {
    /// The surface of all blocks with a solid voxel, as a binary STL file.
    pub fn stl(&self) -> Vec<u8> {
        let blocks = Blocks::of(self.grid);
        let mut triangles = Vec::new();
        let mut count = 0u32;
        for (at, axis, up) in blocks.faces() {
            let corners = face(at, axis, up).map(|corner| self.place(blocks.corner(corner)));
            let [a, b, c, d] = corners;
            let mut normal = [0f32; 3];
            normal[axis] = if up != (axis == 1 && self.mirrors()) { 1.0 } else { -1.0 };
            // A mirror image turns the other way.
            let halves = if self.mirrors() { [[a, c, b], [a, d, c]] } else { [[a, b, c], [a, c, d]] };
            for half in halves {
                let values = normal.iter().chain(half.iter().flatten());
                values.for_each(|v| triangles.extend(v.to_le_bytes()));
                triangles.extend([0, 0]);
                count += 1;
            }
        }
        let mut bytes = vec![0; 80];
        let title = b"shape of a print in blocks, mm";
        bytes[..title.len()].copy_from_slice(title);
        bytes.extend(count.to_le_bytes());
        bytes.extend(triangles);
        bytes
    }

    /// Least and greatest corner of the solid voxels in columns, rows and layers, as `f32`.
    pub fn bounds(&self) -> Vec<u8> {
        let (mut low, mut high) = ([u32::MAX; 3], [0u32; 3]);
        for index in 0..self.grid.tiles().len() {
            for_solids(self.grid, index, |[first, last]| {
                low = std::array::from_fn(|a| low[a].min(first[a]));
                high = std::array::from_fn(|a| high[a].max(last[a] + 1));
            });
        }
        if high[0] == 0 {
            low = [0; 3];
        } else if self.rows == RowOrder::HighestYFirst {
            let height = self.grid.size()[1];
            (low[1], high[1]) = (height - high[1], height - low[1]);
        }
        low.iter().chain(&high).flat_map(|&v| (v as f32).to_le_bytes()).collect()
    }

    /// Number of the topmost solid layer of each column of voxels, rows as in the images.
    pub fn zbuffer(&self) -> Vec<u16> {
        let [width, height, _] = self.grid.size();
        let mut image = vec![0; width as usize * height as usize];
        let band = width as usize * TILE;
        // Bands of tiles along y, in the grid's order.
        image.par_chunks_mut(band).enumerate().for_each(|(ty, rows)| {
            for tx in 0..self.grid.tile_dims()[0] {
                self.tops([tx, ty as u32], width as usize, rows);
            }
        });
        if self.rows == RowOrder::HighestYFirst {
            let rows: Vec<&[u16]> = image.chunks(width as usize).rev().collect();
            return rows.concat();
        }
        image
    }

    /// Topmost solid layers of one column of tiles, into the rows of its band.
    fn tops(&self, [tx, ty]: [u32; 2], width: usize, rows: &mut [u16]) {
        let mut found = [[false; TILE]; TILE];
        for tz in (0..self.grid.tile_dims()[2]).rev() {
            let index = self.grid.tile_index([tx, ty, tz]);
            if matches!(self.grid.tiles()[index], Tile::Constant(AIR)) {
                continue;
            }
            let above = found;
            // A tile's voxels come from the bottom up, so that the last one stays.
            for ([x, y, z], label) in self.grid.voxels_of(index) {
                let (lx, ly) = (x as usize % TILE, y as usize % TILE);
                if label != AIR && !above[ly][lx] {
                    found[ly][lx] = true;
                    rows[ly * width + x as usize] = z as u16;
                }
            }
            if found.iter().flatten().all(|&f| f) {
                break;
            }
        }
    }

    /// [`Display::zbuffer`] as a PNG file.
    pub fn zbuffer_png(&self) -> Result<Vec<u8>, EncodingError> {
        let [width, height, _] = self.grid.size();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Sixteen);
        let samples: Vec<u8> = self.zbuffer().iter().flat_map(|v| v.to_be_bytes()).collect();
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&samples)?;
        writer.finish()?;
        Ok(bytes)
    }

    /// Whether rows, taken as falling y, show the object mirrored.
    fn mirrors(&self) -> bool {
        self.rows == RowOrder::LowestYFirst
    }

    /// A corner of voxels in mm, with the first row's edge at y = 0.
    fn place(&self, [x, y, z]: [u32; 3]) -> [f32; 3] {
        let mm = self.grid.frame().pitch().mm();
        let row = if self.mirrors() { y } else { self.grid.size()[1] - y };
        // No minus zero.
        let down = 0.0 - f64::from(row) * mm[1];
        [(f64::from(x) * mm[0]) as f32, down as f32, (f64::from(z) * mm[2]) as f32]
    }
}

/// Gives first and last voxel of boxes that make up a tile's solid voxels: a tile of one label is one box.
fn for_solids(grid: &LabelGrid, index: usize, mut give: impl FnMut([[u32; 3]; 2])) {
    match grid.tiles()[index] {
        Tile::Constant(AIR) => {}
        Tile::Constant(_) => {
            let mut voxels = grid.voxels_of(index).map(|(voxel, _)| voxel);
            if let Some(first) = voxels.next() {
                give([first, voxels.last().unwrap_or(first)]);
            }
        }
        Tile::Dense(_) => {
            let solid = grid.voxels_of(index).filter(|&(_, label)| label != AIR);
            solid.for_each(|(voxel, _)| give([voxel, voxel]));
        }
    }
}

/// Blocks of voxels, solid where any voxel is.
struct Blocks {
    /// Voxels of a block along each axis.
    edge: [u32; 3],
    count: [usize; 3],
    size: [u32; 3],
    solid: Vec<bool>,
}

impl Blocks {
    fn of(grid: &LabelGrid) -> Self {
        let (size, mm) = (grid.size(), grid.frame().pitch().mm());
        let longest = (0..3).map(|a| f64::from(size[a]) * mm[a]).fold(0.0, f64::max);
        let edge = mm.map(|mm| (longest / BLOCKS / mm).ceil().max(1.0) as u32);
        let count: [usize; 3] = std::array::from_fn(|a| size[a].div_ceil(edge[a]) as usize);
        let solid: Vec<AtomicBool> = (0..count.iter().product()).map(|_| AtomicBool::new(false)).collect();
        (0..grid.tiles().len()).into_par_iter().for_each(|index| {
            for_solids(grid, index, |[first, last]| {
                let blocks = |a: usize| (first[a] / edge[a]) as usize..=(last[a] / edge[a]) as usize;
                for z in blocks(2) {
                    for y in blocks(1) {
                        for x in blocks(0) {
                            solid[(z * count[1] + y) * count[0] + x].store(true, Ordering::Relaxed);
                        }
                    }
                }
            });
        });
        let solid = solid.into_iter().map(AtomicBool::into_inner).collect();
        Self { edge, count, size, solid }
    }

    fn is_solid(&self, at: [i64; 3]) -> bool {
        let inside = (0..3).all(|a| (0..self.count[a] as i64).contains(&at[a]));
        let [x, y, z] = at.map(|v| v as usize);
        inside && self.solid[(z * self.count[1] + y) * self.count[0] + x]
    }

    /// Block, axis and end of every face between solid and air.
    fn faces(&self) -> impl Iterator<Item = ([u32; 3], usize, bool)> + '_ {
        let [nx, ny, nz] = self.count.map(|n| n as u32);
        let blocks = (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])));
        blocks.filter(|at| self.is_solid(at.map(i64::from))).flat_map(move |at| {
            let sides = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
            sides.filter_map(move |(axis, up)| {
                let mut beside = at.map(i64::from);
                beside[axis] += if up { 1 } else { -1 };
                (!self.is_solid(beside)).then_some((at, axis, up))
            })
        })
    }

    /// The voxel corner at a corner of blocks.
    fn corner(&self, at: [u32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| (at[a] * self.edge[a]).min(self.size[a]))
    }
}

/// Corners of a block's face, anticlockwise as seen from outside.
fn face(at: [u32; 3], axis: usize, up: bool) -> [[u32; 3]; 4] {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[du, dv]| {
        let mut corner = at;
        corner[axis] += u32::from(up);
        corner[u] += du;
        corner[v] += dv;
        corner
    });
    if !up {
        corners.reverse();
    }
    corners
}
