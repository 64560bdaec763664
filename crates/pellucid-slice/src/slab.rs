//! Layers of labels, read row by row, as the tiles of a grid.

use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use pellucid_voxel::{AIR, Control, Frame, LabelGrid, TILE, TILE_VOXELS, Tile};
use rayon::prelude::*;

use crate::{RowOrder, SliceError};

/// A layer whose rows come one after the other, the top row of its image first.
pub(crate) trait LayerRows {
    /// Fills in the labels of the next row, number `row`.
    fn read_row(&mut self, row: u32, labels: &mut [u8]) -> Result<(), SliceError>;
    /// Checks what follows the last row.
    fn finish(&mut self) -> Result<(), SliceError>;
}

/// Reads `layers` layers, opened by number and at least as many as the frame has, into a grid; those above the frame
/// are read and left out. Each thread has 16 layers open and one row of tiles at a time. Progress counts layers.
pub(crate) fn read_layers<L: LayerRows>(
    frame: Frame,
    layers: u32,
    rows: RowOrder,
    open: impl Fn(u32) -> Result<L, SliceError> + Sync,
    control: &Control<'_>,
) -> Result<LabelGrid, SliceError> {
    let done = AtomicU64::new(0);
    let [width, height, _] = frame.size();
    let slabs = (0..layers.div_ceil(TILE as u32))
        .into_par_iter()
        .map(|slab| {
            control.check()?;
            let first = slab * TILE as u32;
            let inside = first..layers.min(first + TILE as u32);
            let count = u64::from(inside.end - inside.start);
            let mut images = inside.map(&open).collect::<Result<Vec<_>, _>>()?;
            let tiles = read_slab(&mut images, [width, height], rows, control)?;
            control.advance(&done, count, u64::from(layers));
            Ok(tiles)
        })
        .collect::<Result<Vec<Vec<Mutex<Tile>>>, SliceError>>()?;
    Ok(grid_of(frame, slabs))
}

/// The grid of tiles by layers of them, each ordered `[y][x]`.
pub(crate) fn grid_of(frame: Frame, slabs: Vec<Vec<Mutex<Tile>>>) -> LabelGrid {
    let columns = frame.size()[0].div_ceil(TILE as u32) as usize;
    LabelGrid::from_tiles(frame, |[x, y, z]| {
        let tile = &slabs[z as usize][y as usize * columns + x as usize];
        let mut tile = tile.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        std::mem::replace(&mut *tile, Tile::Constant(AIR))
    })
}

/// Reads up to 16 layers side by side, a band of tiles at a time, into tiles `[y][x]`.
fn read_slab<L: LayerRows>(
    images: &mut [L],
    [width, height]: [u32; 2],
    rows: RowOrder,
    control: &Control<'_>,
) -> Result<Vec<Mutex<Tile>>, SliceError> {
    let columns = width.div_ceil(TILE as u32) as usize;
    let mut tiles: Vec<Mutex<Tile>> = Vec::new();
    tiles.resize_with(columns * height.div_ceil(TILE as u32) as usize, || Mutex::new(Tile::Constant(AIR)));
    let mut line = vec![AIR; width as usize];
    // Labels of one band of tiles, ordered [column][z][y][x].
    let mut band = vec![[AIR; TILE_VOXELS]; columns];
    for row in 0..height {
        control.check()?;
        let y = rows.y_of_row(row, height) as usize;
        for (z, image) in images.iter_mut().enumerate() {
            image.read_row(row, &mut line)?;
            for (column, labels) in line.chunks(TILE).enumerate() {
                let at = (z * TILE + y % TILE) * TILE;
                band[column][at..at + labels.len()].copy_from_slice(labels);
            }
        }
        let next = (row + 1 < height).then(|| rows.y_of_row(row + 1, height) as usize / TILE);
        if next != Some(y / TILE) {
            for (column, labels) in band.iter_mut().enumerate() {
                if let Some(tile) = tile_of(labels) {
                    tiles[y / TILE * columns + column] = Mutex::new(tile);
                }
                labels.fill(AIR);
            }
        }
    }
    images.iter_mut().try_for_each(LayerRows::finish)?;
    Ok(tiles)
}

/// The tile of some labels, `None` for air. One label throughout takes no memory.
fn tile_of(labels: &[u8; TILE_VOXELS]) -> Option<Tile> {
    if labels.iter().all(|&l| l == labels[0]) {
        return (labels[0] != AIR).then_some(Tile::Constant(labels[0]));
    }
    Some(Tile::Dense(Box::new(*labels)))
}
