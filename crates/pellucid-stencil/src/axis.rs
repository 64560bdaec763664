//! Where the corners of a level's cells fall along one axis.

use pellucid_voxel::TILE;

/// What must be done for a corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Nothing lies before it.
    Zero,
    /// It counts the same as the corner before it on this axis.
    Same,
    /// It must be looked up.
    Fresh,
}

/// A corner between the voxel corner at offset `local` of a tile and the next voxel corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Position {
    pub kind: Kind,
    /// Within 0..=15.
    pub local: u8,
    /// Voxels of the tile, cut to the grid, before the first and before the second voxel corner,
    /// added; where the second lies in the next tile, before the first alone.
    pub before: u8,
    /// What the tile adds to the position of a tile record.
    pub record: u32,
    /// The last two bits of the tile's coordinate.
    pub slot: u8,
    /// All ones where tables without offset 0 have an entry for `local`, as a mask.
    pub inner: u16,
}

/// One axis of the volume.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    /// Voxels of the grid.
    pub size: u32,
    /// The volume is empty outside `low..high`.
    pub low: u32,
    /// See `low`.
    pub high: u32,
    /// How far apart the records of neighbouring tiles lie.
    pub stride: usize,
}

/// The corners of a batch of points along one axis, ordered `[corner][point]`.
pub(crate) struct Axis {
    points: usize,
    positions: Vec<Position>,
}

impl Axis {
    /// Corners of `cells` cells, `edge` voxels long (even), centred on voxel coordinates `points`.
    pub fn new(cells: usize, edge: u32, extent: Extent, points: impl ExactSizeIterator<Item = u32>) -> Self {
        let count = points.len();
        let empty = Position { kind: Kind::Zero, local: 0, before: 0, record: 0, slot: 0, inner: 0 };
        let mut positions = vec![empty; (cells + 1) * count];
        let (low, high) = (i64::from(extent.low), i64::from(extent.high));
        let first = -(i64::from(edge) * cells as i64) / 2;
        for (p, point) in points.enumerate() {
            let mut prior = low - 1;
            for corner in 0..=cells {
                // Past the upper bound nothing is added; up to the lower one there is nothing.
                let at = (i64::from(point) + first + i64::from(edge) * corner as i64).clamp(low - 1, high);
                if at >= low {
                    let kind = if at == prior { Kind::Same } else { Kind::Fresh };
                    positions[corner * count + p] = position(kind, at as u32, extent);
                }
                prior = at;
            }
        }
        Self { points: count, positions }
    }

    /// One position a point.
    pub fn corner(&self, corner: usize) -> &[Position] {
        &self.positions[corner * self.points..(corner + 1) * self.points]
    }

    /// True when no corner of any point must be looked up: no box of the level meets the bounds.
    pub fn beyond(&self) -> bool {
        self.positions.iter().all(|p| p.kind == Kind::Zero)
    }
}

fn position(kind: Kind, at: u32, extent: Extent) -> Position {
    let (tile, local) = (at / TILE as u32, at % TILE as u32);
    let inside = extent.size.saturating_sub(tile * TILE as u32).min(TILE as u32);
    let second = if local + 1 < TILE as u32 { (local + 1).min(inside) } else { 0 };
    Position {
        kind,
        local: local as u8,
        before: (local.min(inside) + second) as u8,
        record: (tile as usize * extent.stride) as u32,
        slot: (tile & 3) as u8,
        inner: if local > 0 { u16::MAX } else { 0 },
    }
}
