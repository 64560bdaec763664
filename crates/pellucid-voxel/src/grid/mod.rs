//! The sparse tiled label grid.

#[cfg(feature = "ndarray")]
mod array;
mod codec;
mod codec_reader;
mod dense;

use rayon::prelude::*;

use crate::{Frame, VoxelError};

/// The label of empty space.
pub const AIR: u8 = 0;
/// Voxels along each edge of a tile.
pub const TILE: usize = 16;
/// Voxels in a tile.
pub const TILE_VOXELS: usize = TILE * TILE * TILE;

/// The labels of a 16 x 16 x 16 block, ordered `[z][y][x]`, x fastest.
#[derive(Clone, Debug)]
pub enum Tile {
    /// Every voxel has this label.
    Constant(u8),
    /// One label a voxel.
    Dense(Box<[u8; TILE_VOXELS]>),
}

impl Tile {
    /// The label at tile-local coordinates, each below 16.
    #[inline]
    pub fn label(&self, x: usize, y: usize, z: usize) -> u8 {
        match self {
            Tile::Constant(label) => *label,
            Tile::Dense(labels) => labels[(z * TILE + y) * TILE + x],
        }
    }

    /// Tile-local coordinates `[x, y, z]` of a position in a dense tile.
    ///
    /// ```
    /// assert_eq!(pellucid_voxel::Tile::coords(2 * 256 + 3 * 16 + 4), [4, 3, 2]);
    /// ```
    #[inline]
    pub const fn coords(position: usize) -> [usize; 3] {
        [position % TILE, position / TILE % TILE, position / TILE / TILE]
    }
}

/// One material label a voxel, stored in tiles; a constant tile costs one value.
///
/// In an edge tile, a dense tile's labels outside the frame are air, and a constant tile's label
/// holds inside the frame only.
///
/// ```
/// use pellucid_voxel::{Frame, LabelGrid, Pitch};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [40, 20, 30]).unwrap();
/// let mut grid = LabelGrid::new(frame);
/// grid.set([39, 19, 29], 3);
/// assert_eq!(grid.get([39, 19, 29]), 3);
/// assert_eq!(grid.at([-1, 0, 0]), 0); // outside is air
/// assert_eq!(grid.histogram()[3], 1);
/// ```
#[derive(Clone, Debug)]
pub struct LabelGrid {
    frame: Frame,
    tile_dims: [u32; 3],
    tiles: Vec<Tile>,
}

impl LabelGrid {
    /// A grid of air.
    pub fn new(frame: Frame) -> Self {
        let tile_dims = frame.size().map(|s| s.div_ceil(TILE as u32));
        let count = tile_dims.iter().map(|&d| d as usize).product();
        Self { frame, tile_dims, tiles: vec![Tile::Constant(AIR); count] }
    }

    /// Builds every tile in parallel from its tile coordinates `[x, y, z]`.
    ///
    /// `build` may write labels past the frame's edge in an edge tile; they are cleared to air.
    pub fn from_tiles(frame: Frame, build: impl Fn([u32; 3]) -> Tile + Sync) -> Self {
        let mut grid = Self::new(frame);
        let dims = grid.tile_dims;
        let size = frame.size();
        grid.tiles.par_iter_mut().enumerate().for_each(|(i, tile)| {
            let t = tile_coords(dims, i);
            *tile = normalised(build(t), inside(t, size));
        });
        grid
    }

    /// Replaces tiles in parallel: `edit` gets tile coordinates and the present tile and returns
    /// the new one, or `None` to leave it. Returns the indices of the replaced tiles, ascending.
    pub fn update_tiles(&mut self, edit: impl Fn([u32; 3], &Tile) -> Option<Tile> + Sync) -> Vec<u32> {
        let dims = self.tile_dims;
        let size = self.frame.size();
        self.tiles
            .par_iter_mut()
            .enumerate()
            .filter_map(|(i, tile)| {
                let t = tile_coords(dims, i);
                let new = edit(t, tile)?;
                *tile = normalised(new, inside(t, size));
                Some(i as u32)
            })
            .collect()
    }

    /// Where the grid lies.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Voxels along `[x, y, z]`.
    pub fn size(&self) -> [u32; 3] {
        self.frame.size()
    }

    /// Tiles along `[x, y, z]`.
    pub fn tile_dims(&self) -> [u32; 3] {
        self.tile_dims
    }

    /// All tiles, ordered `[z][y][x]`.
    pub fn tiles(&self) -> &[Tile] {
        &self.tiles
    }

    /// The tile at tile coordinates within [`LabelGrid::tile_dims`].
    #[inline]
    pub fn tile(&self, t: [u32; 3]) -> &Tile {
        &self.tiles[self.tile_index(t)]
    }

    /// Position of a tile in [`LabelGrid::tiles`].
    #[inline]
    pub fn tile_index(&self, t: [u32; 3]) -> usize {
        let d = self.tile_dims;
        debug_assert!((0..3).all(|a| t[a] < d[a]));
        (t[2] as usize * d[1] as usize + t[1] as usize) * d[0] as usize + t[0] as usize
    }

    /// The label of a voxel within the grid.
    ///
    /// # Panics
    /// When the voxel lies outside; use [`LabelGrid::at`] where it may.
    #[inline]
    pub fn get(&self, voxel: [u32; 3]) -> u8 {
        let size = self.size();
        assert!((0..3).all(|a| voxel[a] < size[a]), "voxel {voxel:?} lies outside the grid {size:?}");
        let [x, y, z] = voxel.map(|v| v as usize % TILE);
        self.tile(voxel.map(|v| v / TILE as u32)).label(x, y, z)
    }

    /// The label of a voxel anywhere; air outside the grid.
    #[inline]
    pub fn at(&self, voxel: [i64; 3]) -> u8 {
        self.frame.checked(voxel).map_or(AIR, |v| self.get(v))
    }

    /// Sets one label. For many voxels use [`LabelGrid::update_tiles`].
    ///
    /// # Panics
    /// When the voxel lies outside the grid.
    pub fn set(&mut self, voxel: [u32; 3], label: u8) {
        if self.get(voxel) == label {
            return;
        }
        let i = self.tile_index(voxel.map(|v| v / TILE as u32));
        let [x, y, z] = voxel.map(|v| v as usize % TILE);
        let tile = &mut self.tiles[i];
        if let Tile::Constant(constant) = *tile {
            *tile = expanded(constant, inside(voxel.map(|v| v / TILE as u32), self.frame.size()));
        }
        if let Tile::Dense(labels) = tile {
            labels[(z * TILE + y) * TILE + x] = label;
        }
    }

    /// Turns dense tiles whose labels agree into constant ones.
    pub fn compress(&mut self) {
        let dims = self.tile_dims;
        let size = self.size();
        self.tiles.par_iter_mut().enumerate().for_each(|(i, tile)| {
            let taken = std::mem::replace(tile, Tile::Constant(AIR));
            *tile = normalised(taken, inside(tile_coords(dims, i), size));
        });
    }

    /// Copies layer `z` into `layer`, ordered `[y][x]`.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] when `z` is past the grid or `layer` is not size x times size y long.
    pub fn copy_layer(&self, z: u32, layer: &mut [u8]) -> Result<(), VoxelError> {
        let [sx, sy, sz] = self.size().map(|s| s as usize);
        if z as usize >= sz {
            return Err(VoxelError::invalid("layer", format!("{z} of a grid with {sz} layers")));
        }
        if layer.len() != sx * sy {
            return Err(VoxelError::invalid(
                "layer buffer",
                format!("{} bytes for {sx} x {sy} voxels", layer.len()),
            ));
        }
        let lz = z as usize % TILE;
        for (y, row) in layer.chunks_exact_mut(sx).enumerate() {
            for (tx, part) in row.chunks_mut(TILE).enumerate() {
                match self.tile([tx as u32, (y / TILE) as u32, z / TILE as u32]) {
                    Tile::Constant(label) => part.fill(*label),
                    Tile::Dense(labels) => {
                        let start = (lz * TILE + y % TILE) * TILE;
                        part.copy_from_slice(&labels[start..start + part.len()]);
                    }
                }
            }
        }
        Ok(())
    }

    /// Number of voxels of each label.
    pub fn histogram(&self) -> [u64; 256] {
        let size = self.size();
        let dims = self.tile_dims;
        self.tiles
            .par_iter()
            .enumerate()
            .fold(
                || [0u64; 256],
                |mut counts, (i, tile)| {
                    let inside = inside(tile_coords(dims, i), size).iter().product::<usize>() as u64;
                    match tile {
                        Tile::Constant(label) => counts[usize::from(*label)] += inside,
                        Tile::Dense(labels) => {
                            labels.iter().for_each(|&l| counts[usize::from(l)] += 1);
                            counts[usize::from(AIR)] -= TILE_VOXELS as u64 - inside;
                        }
                    }
                    counts
                },
            )
            .reduce(
                || [0u64; 256],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    a
                },
            )
    }

    /// Bytes held by the labels and the tile list.
    pub fn memory_bytes(&self) -> usize {
        let dense = self.tiles.iter().filter(|t| matches!(t, Tile::Dense(_))).count();
        self.tiles.len() * size_of::<Tile>() + dense * TILE_VOXELS
    }
}

/// Grids are equal when they lie in the same frame and every voxel has the same label, however
/// their tiles are stored.
impl PartialEq for LabelGrid {
    fn eq(&self, other: &Self) -> bool {
        self.frame == other.frame
            && self.tiles.par_iter().zip(&other.tiles).enumerate().all(|(i, (a, b))| match (a, b) {
                (Tile::Constant(a), Tile::Constant(b)) => a == b,
                (Tile::Dense(a), Tile::Dense(b)) => a == b,
                (Tile::Dense(labels), Tile::Constant(c)) | (Tile::Constant(c), Tile::Dense(labels)) => {
                    rows(inside(tile_coords(self.tile_dims, i), self.size()))
                        .all(|row| labels[row].iter().all(|l| l == c))
                }
            })
    }
}

/// Tile coordinates of a position in the tile list.
pub(crate) fn tile_coords(dims: [u32; 3], index: usize) -> [u32; 3] {
    let (dx, dy) = (dims[0] as usize, dims[1] as usize);
    [(index % dx) as u32, (index / dx % dy) as u32, (index / dx / dy) as u32]
}

/// How many voxels of a tile lie within the frame, along `[x, y, z]`.
pub(crate) fn inside(t: [u32; 3], size: [u32; 3]) -> [usize; 3] {
    std::array::from_fn(|a| ((size[a] - t[a] * TILE as u32) as usize).min(TILE))
}

/// The x-rows of a tile's labels that lie within the frame.
fn rows(inside: [usize; 3]) -> impl Iterator<Item = std::ops::Range<usize>> {
    let [nx, ny, nz] = inside;
    (0..nz).flat_map(move |z| {
        (0..ny).map(move |y| {
            let start = (z * TILE + y) * TILE;
            start..start + nx
        })
    })
}

/// A constant tile as a dense one, air outside the frame.
fn expanded(label: u8, inside: [usize; 3]) -> Tile {
    let mut labels = Box::new([AIR; TILE_VOXELS]);
    rows(inside).for_each(|row| labels[row].fill(label));
    Tile::Dense(labels)
}

/// Clears what lies outside the frame and makes the tile constant where its inner labels agree.
fn normalised(tile: Tile, inside: [usize; 3]) -> Tile {
    let Tile::Dense(mut labels) = tile else {
        return tile;
    };
    let first = labels[0];
    if rows(inside).all(|row| labels[row].iter().all(|&l| l == first)) {
        return Tile::Constant(first);
    }
    if inside != [TILE; 3] {
        for (row, values) in labels.chunks_exact_mut(TILE).enumerate() {
            let keep = if row / TILE < inside[2] && row % TILE < inside[1] { inside[0] } else { 0 };
            values[keep..].fill(AIR);
        }
    }
    Tile::Dense(labels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pitch;
    use proptest::prelude::*;

    fn grid(size: [u32; 3]) -> LabelGrid {
        LabelGrid::new(Frame::new([0.0; 3], Pitch::j750(), size).unwrap())
    }

    proptest! {
        #[test]
        fn agrees_with_a_dense_array(
            size in [1u32..40, 1u32..40, 1u32..40],
            fill in 0u8..3,
            edits in prop::collection::vec((0u32..40, 0u32..40, 0u32..40, 0u8..6), 0..200),
        ) {
            let mut sparse = LabelGrid::from_tiles(*grid(size).frame(), |_| Tile::Constant(fill));
            let [sx, sy, sz] = size.map(|s| s as usize);
            let mut dense = vec![fill; sx * sy * sz];
            for (x, y, z, label) in edits {
                let v = [x % size[0], y % size[1], z % size[2]];
                sparse.set(v, label);
                dense[(v[2] as usize * sy + v[1] as usize) * sx + v[0] as usize] = label;
            }
            let mut compressed = sparse.clone();
            compressed.compress();
            prop_assert!(compressed == sparse);
            prop_assert!(sparse == compressed);
            let mut layer = vec![9; sx * sy];
            for z in 0..sz {
                compressed.copy_layer(z as u32, &mut layer).unwrap();
                prop_assert_eq!(&layer[..], &dense[z * sx * sy..(z + 1) * sx * sy]);
            }
            let mut counts = [0u64; 256];
            dense.iter().for_each(|&l| counts[l as usize] += 1);
            prop_assert_eq!(sparse.histogram(), counts);
            prop_assert_eq!(compressed.histogram(), counts);
        }
    }

    #[test]
    fn edge_tiles_compress_and_compare_by_their_inner_voxels() {
        let constant = LabelGrid::from_tiles(*grid([17, 5, 3]).frame(), |_| Tile::Constant(2));
        let dense = LabelGrid::from_tiles(*constant.frame(), |_| Tile::Dense(Box::new([2; TILE_VOXELS])));
        assert!(dense.tiles().iter().all(|t| matches!(t, Tile::Constant(2))));
        let mut touched = constant.clone();
        touched.set([16, 4, 2], 1);
        assert!(touched != constant);
        touched.set([16, 4, 2], 2);
        assert!(touched == constant);
        assert!(touched.memory_bytes() > constant.memory_bytes());
    }

    #[test]
    fn update_reports_replaced_tiles() {
        let mut g = grid([64, 16, 16]);
        let changed = g.update_tiles(|t, _| (t[0] % 2 == 1).then_some(Tile::Constant(4)));
        assert_eq!(changed, [1, 3]);
        assert_eq!(g.histogram()[4], 2 * 4096);
    }
}
