//! Sums at cell corners, for one plane of corners and a batch of points at a time.
//!
//! A corner of a level above the first lies half a voxel off the voxel corners. The sum there, in
//! eighths of a voxel, is the sum of the table over the 2 x 2 x 2 voxel corners around it.

mod scalar;

use pellucid_voxel::sat::tables::{CountTables, Lanes};

use crate::axis::Position;

/// Sums of the five materials of a group and three spare lanes.
pub(crate) type Sums = [u32; 8];

/// The corners of one plane: positions ordered `[corner][point]` along x and y, `[point]` along z.
pub(crate) struct Plane<'a> {
    pub tables: &'a CountTables,
    pub xs: Vec<&'a [Position]>,
    pub ys: Vec<&'a [Position]>,
    pub z: &'a [Position],
}

/// Fills `sums`, ordered `[point][y corner][x corner]`. Where the plane counts the same as the one
/// before it, that one's sums must still be in place.
pub(crate) fn corner_sums(plane: &Plane, sums: &mut [Sums]) {
    scalar::corner_sums(plane, sums);
}

/// Widens a group's counts.
pub(crate) fn widened(lanes: Lanes) -> Sums {
    let [a, b, c, d, e] = lanes;
    [a, b, c, d, e, 0, 0, 0]
}
