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

/// A corner between voxel corners `16 tile + local` and the next one.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Position {
    pub kind: Kind,
    pub local: u8,
    pub tile: u32,
}

/// The corners of a batch of points along one axis, ordered `[corner][point]`.
pub(crate) struct Axis {
    points: usize,
    positions: Vec<Position>,
}

impl Axis {
    /// Corners of `cells` cells, `edge` voxels long (even), centred on voxel coordinates `points`,
    /// of a volume that is empty outside `bounds`.
    pub fn new(
        cells: usize,
        edge: u32,
        bounds: (u32, u32),
        points: impl ExactSizeIterator<Item = u32>,
    ) -> Self {
        let count = points.len();
        let empty = Position { kind: Kind::Zero, local: 0, tile: 0 };
        let mut positions = vec![empty; (cells + 1) * count];
        let (low, high) = (i64::from(bounds.0), i64::from(bounds.1));
        let first = -(i64::from(edge) * cells as i64) / 2;
        for (p, point) in points.enumerate() {
            let mut before = low - 1;
            for corner in 0..=cells {
                // Past the upper bound nothing is added; up to the lower one there is nothing.
                let at = (i64::from(point) + first + i64::from(edge) * corner as i64).clamp(low - 1, high);
                let kind = if at < low {
                    Kind::Zero
                } else if at == before {
                    Kind::Same
                } else {
                    Kind::Fresh
                };
                before = at;
                let at = at.max(0) as u32;
                positions[corner * count + p] =
                    Position { kind, local: (at % TILE as u32) as u8, tile: at / TILE as u32 };
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
