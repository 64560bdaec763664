//! Labels of a volume, ordered `[z][y][x]`, read one after the other.

use std::io::Read;
use std::path::Path;
use std::sync::Mutex;

use pellucid_voxel::{AIR, Control, Frame, LabelGrid, TILE, TILE_VOXELS, Tile};

use crate::SliceError;
use crate::slab::grid_of;

/// Reads the labels of all voxels of a frame, one byte each, after which nothing may follow.
///
/// What is allocated follows what was read, not what the frame claims: a volume that is short or of one label takes no
/// more than its tiles. Progress counts layers.
pub(crate) fn read_labels(
    frame: Frame,
    mut bytes: impl Read,
    path: &Path,
    control: &Control<'_>,
) -> Result<LabelGrid, SliceError> {
    let [width, height, depth] = frame.size();
    let mut line = vec![AIR; width as usize];
    let mut slabs = Vec::new();
    for first in (0..depth).step_by(TILE) {
        let mut slab = Slab { columns: line.len().div_ceil(TILE), tiles: Vec::new() };
        for z in first..depth.min(first + TILE as u32) {
            for y in 0..height {
                control.check()?;
                let in_layer = |e| SliceError::reading(path, e, &format!("layer {z}, row {y}"));
                bytes.read_exact(&mut line).map_err(in_layer)?;
                slab.add(&line, y as usize, (z - first) as usize);
            }
            control.report(u64::from(z) + 1, u64::from(depth));
        }
        slabs.push(slab.tiles.into_iter().map(Building::into_tile).map(Mutex::new).collect());
    }
    let mut more = [0];
    match bytes.read(&mut more).map_err(|e| SliceError::reading(path, e, "the end"))? {
        0 => Ok(grid_of(frame, slabs)),
        _ => Err(SliceError::file(path, "holds more than its header says")),
    }
}

/// A layer of tiles while its rows come.
struct Slab {
    columns: usize,
    tiles: Vec<Building>,
}

/// A tile of which some rows were read.
enum Building {
    Uniform(u8),
    Dense(Box<[u8; TILE_VOXELS]>),
}

impl Slab {
    fn add(&mut self, line: &[u8], y: usize, z: usize) {
        let band = y / TILE * self.columns;
        for (column, labels) in line.chunks(TILE).enumerate() {
            let uniform = labels.iter().all(|&l| l == labels[0]);
            if band + column == self.tiles.len() {
                self.tiles.push(Building::Uniform(labels[0]));
            }
            let tile = &mut self.tiles[band + column];
            match tile {
                Building::Uniform(label) if uniform && *label == labels[0] => continue,
                // All rows so far had the one label; those to come are written over.
                Building::Uniform(label) => *tile = Building::Dense(Box::new([*label; TILE_VOXELS])),
                Building::Dense(_) => {}
            }
            if let Building::Dense(dense) = tile {
                let at = (z * TILE + y % TILE) * TILE;
                dense[at..at + labels.len()].copy_from_slice(labels);
            }
        }
    }
}

impl Building {
    fn into_tile(self) -> Tile {
        match self {
            Self::Uniform(label) => Tile::Constant(label),
            Self::Dense(labels) => Tile::Dense(labels),
        }
    }
}
