//! Cells of whole voxels at the surface, and the corners and quads between those with material and those without.

use pellucid_core::Control;
use pellucid_voxel::{AIR, LabelGrid, Surface};
use rayon::prelude::*;

use crate::ProofError;

/// Bits of a coordinate in a key; [`pellucid_voxel::Frame::MAX_EDGE`] and one more fit.
const BITS: u32 = 21;

/// A place in one number, ordered by z, y, x; no coordinate is negative.
pub(super) fn key_of(place: [i64; 3]) -> u64 {
    place.iter().rev().fold(0, |key, &v| (key << BITS) | v as u64)
}

/// The place of a key.
pub(super) fn place_of(key: u64) -> [i64; 3] {
    std::array::from_fn(|a| (key >> (BITS * a as u32) & ((1 << BITS) - 1)) as i64)
}

/// Cells that hold surface voxels.
pub(super) struct Cells {
    /// Voxels of a cell along `[x, y, z]`.
    pub voxels: [u32; 3],
    /// `(cell, surface voxel)`, ascending.
    pub members: Vec<(u64, u32)>,
    /// Corners of quads, ascending: that of key `[x, y, z]` lies at the lower corner of that cell.
    pub corners: Vec<u64>,
    /// By positions in `corners`, counter-clockwise from outside; ordered as their cells.
    pub quads: Vec<[u32; 4]>,
}

impl Cells {
    pub fn find(
        labels: &LabelGrid,
        surface: &Surface,
        voxels: [u32; 3],
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let cell_of = |voxel: &[u32; 3]| key_of(std::array::from_fn(|a| i64::from(voxel[a] / voxels[a])));
        let numbered = surface.voxels().par_iter().enumerate();
        let mut members: Vec<(u64, u32)> = numbered.map(|(i, v)| (cell_of(v), i as u32)).collect();
        members.par_sort_unstable();
        control.check()?;
        let mut cells: Vec<u64> = members.iter().map(|m| m.0).collect();
        cells.dedup();
        // A cell without surface voxels is solid or air throughout.
        let is_solid = |place: [i64; 3]| {
            place.iter().all(|&v| v >= 0)
                && (cells.binary_search(&key_of(place)).is_ok()
                    || labels.at(std::array::from_fn(|a| place[a] * i64::from(voxels[a]))) != AIR)
        };
        let faces = |&cell: &u64| {
            let place = place_of(cell);
            let sides = (0..3).flat_map(move |axis| [(axis, false), (axis, true)]);
            let open = sides.filter(|&(axis, upper)| {
                let mut beside = place;
                beside[axis] += if upper { 1 } else { -1 };
                !is_solid(beside)
            });
            open.map(|(axis, upper)| corners_of(place, axis, upper)).collect::<Vec<_>>()
        };
        let faces: Vec<[u64; 4]> = cells.par_iter().flat_map_iter(faces).collect();
        control.check()?;
        let mut corners: Vec<u64> = faces.iter().flatten().copied().collect();
        corners.par_sort_unstable();
        corners.dedup();
        let position = |key: u64| corners.partition_point(|&c| c < key) as u32;
        let quads = faces.par_iter().map(|face| face.map(position)).collect();
        Ok(Self { voxels, members, corners, quads })
    }

    /// The surface voxels of a cell.
    pub fn members_of(&self, cell: u64) -> impl Iterator<Item = u32> + '_ {
        let from = self.members.partition_point(|m| m.0 < cell);
        self.members[from..].iter().take_while(move |m| m.0 == cell).map(|m| m.1)
    }
}

/// Corners of a cell's side, counter-clockwise seen from outside.
fn corners_of(place: [i64; 3], axis: usize, upper: bool) -> [u64; 4] {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let mut corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[along_u, along_v]| {
        let mut corner = place;
        corner[axis] += i64::from(upper);
        corner[u] += along_u;
        corner[v] += along_v;
        key_of(corner)
    });
    if !upper {
        corners.reverse();
    }
    corners
}
