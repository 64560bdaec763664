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

/// The corners of a batch of points along one axis, ordered `[corner][point]`, and sets of points
/// by what must be done for them, one bit a point.
pub(crate) struct Axis {
    points: usize,
    positions: Vec<Position>,
    /// Ordered `[corner][zero, same, split][word]`; split: fresh and reaching into the next tile.
    sets: Vec<u64>,
}

/// Which points of a corner are asked for.
#[derive(Clone, Copy)]
pub(crate) enum Set {
    Zero,
    Same,
    Split,
}

impl Axis {
    /// Corners of `cells` cells, `edge` voxels long (even), centred on voxel coordinates `points`.
    pub fn new(cells: usize, edge: u32, extent: Extent, points: impl ExactSizeIterator<Item = u32>) -> Self {
        let count = points.len();
        let words = count.div_ceil(64);
        let empty = Position { kind: Kind::Zero, local: 0, before: 0, record: 0, slot: 0, inner: 0 };
        let mut positions = vec![empty; (cells + 1) * count];
        let mut sets = vec![0; (cells + 1) * 3 * words];
        let (low, high) = (i64::from(extent.low), i64::from(extent.high));
        let first = -(i64::from(edge) * cells as i64) / 2;
        for (p, point) in points.enumerate() {
            let mut prior = low - 1;
            for corner in 0..=cells {
                // Past the upper bound nothing is added; up to the lower one there is nothing.
                let at = (i64::from(point) + first + i64::from(edge) * corner as i64).clamp(low - 1, high);
                let mut set = Some(Set::Zero);
                if at >= low {
                    let kind = if at == prior { Kind::Same } else { Kind::Fresh };
                    let position = position(kind, at as u32, extent);
                    set = match kind {
                        Kind::Same => Some(Set::Same),
                        _ => (usize::from(position.local) + 1 == TILE).then_some(Set::Split),
                    };
                    positions[corner * count + p] = position;
                }
                if let Some(set) = set {
                    sets[(corner * 3 + set as usize) * words + p / 64] |= 1 << (p % 64);
                }
                prior = at;
            }
        }
        Self { points: count, positions, sets }
    }

    /// One position a point.
    pub fn corner(&self, corner: usize) -> &[Position] {
        &self.positions[corner * self.points..(corner + 1) * self.points]
    }

    /// The points of a corner that a set holds, 64 from `64 word` on.
    #[inline(always)]
    pub fn set(&self, corner: usize, set: Set, word: usize) -> u64 {
        self.sets[(corner * 3 + set as usize) * self.points.div_ceil(64) + word]
    }

    /// The points there are, 64 from `64 word` on.
    #[inline(always)]
    pub fn all(&self, word: usize) -> u64 {
        match self.points - 64 * word {
            0..64 => (1 << (self.points % 64)) - 1,
            _ => u64::MAX,
        }
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.points
    }

    /// True when a corner of no point counts other than the corner before, or than nothing.
    pub fn still(&self, corner: usize) -> bool {
        let unlike = if corner == 0 { Kind::Zero } else { Kind::Same };
        self.corner(corner).iter().all(|p| p.kind == unlike || p.kind == Kind::Zero)
    }

    /// True when no corner of any point must be looked up: no box of the level meets the bounds.
    pub fn beyond(&self) -> bool {
        self.positions.iter().all(|p| p.kind == Kind::Zero)
    }
}

/// Calls `visit` with the position of each bit set.
#[inline(always)]
pub(crate) fn each(mut bits: u64, mut visit: impl FnMut(usize)) {
    while bits != 0 {
        visit(bits.trailing_zeros() as usize);
        bits &= bits - 1;
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
