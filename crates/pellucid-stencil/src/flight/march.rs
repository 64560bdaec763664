//! The segments of a ray through the voxels of a grid.

use pellucid_voxel::{LabelGrid, TILE, Tile};

/// Most voxels between a surface voxel's centre and where its ray starts.
const START_REACH: usize = 64;
/// Most air voxels that a ray crosses to get back into the object: steps that voxels make of a slanted surface.
const NOTCH: usize = 4;

/// Part of a ray within one voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Segment {
    /// The voxel.
    pub voxel: [i32; 3],
    /// Its label, 0 for air.
    pub label: u8,
    /// Length in mm.
    pub length: f32,
}

/// Where a ray ends that leaves the object: the last solid voxel and the axis of the face it leaves by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FarSide {
    pub voxel: [i32; 3],
    pub axis: usize,
}

/// Labels of a grid with the tile at hand.
struct Labels<'a> {
    grid: &'a LabelGrid,
    size: [u32; 3],
    dims: [i32; 3],
    at: [i32; 3],
    tile: Option<&'a Tile>,
}

impl<'a> Labels<'a> {
    fn new(grid: &'a LabelGrid) -> Self {
        let dims = grid.tile_dims().map(|d| d as i32);
        Self { grid, size: grid.size(), dims, at: [-1; 3], tile: None }
    }

    #[inline]
    fn get(&mut self, voxel: [i32; 3]) -> u8 {
        const T: i32 = TILE as i32;
        // Below zero is past every size.
        if (0..3).any(|a| voxel[a] as u32 >= self.size[a]) {
            return 0;
        }
        let at = voxel.map(|v| v >> T.trailing_zeros());
        if at != self.at {
            let i = (at[2] * self.dims[1] + at[1]) as usize * self.dims[0] as usize + at[0] as usize;
            (self.at, self.tile) = (at, Some(&self.grid.tiles()[i]));
        }
        match self.tile {
            Some(Tile::Constant(label)) => *label,
            Some(Tile::Dense(labels)) => {
                let [x, y, z] = voxel.map(|v| (v & (T - 1)) as usize);
                labels[(z * TILE + y) * TILE + x]
            }
            None => 0,
        }
    }
}

/// Steps from voxel face to voxel face (Amanatides and Woo 1987).
struct Steps {
    voxel: [i32; 3],
    step: [i32; 3],
    /// Distance in mm of the next face along each axis, and from one to the next.
    next: [f32; 3],
    between: [f32; 3],
    at: f32,
}

impl Steps {
    /// From a voxel's centre along a unit vector in mm.
    fn from_centre(mm: [f32; 3], voxel: [i32; 3], direction: [f32; 3]) -> Self {
        let between: [f32; 3] = std::array::from_fn(|a| mm[a] / direction[a].abs().max(1e-9));
        Self {
            voxel,
            step: direction.map(|d| if d > 0.0 { 1 } else { -1 }),
            next: between.map(|b| 0.5 * b),
            between,
            at: 0.0,
        }
    }

    /// Crosses the next face; returns its axis and the length passed in the voxel that was left.
    #[inline]
    fn advance(&mut self) -> (usize, f32) {
        let [x, y, z] = self.next;
        let axis = if x <= y && x <= z {
            0
        } else if y <= z {
            1
        } else {
            2
        };
        let length = self.next[axis] - self.at;
        self.at = self.next[axis];
        self.next[axis] += self.between[axis];
        self.voxel[axis] += self.step[axis];
        (axis, length)
    }
}

/// Follows the ray that enters the object above a surface voxel's centre along its normal and goes straight in, to
/// the far side or until `visit` returns false. `leaves` tells whether a ray that left `voxel` by the face across
/// `axis` passes out of the object's smooth surface rather than by a step of its staircase.
///
/// The start is where the line through the centre along `normal` leaves the object, as a path's start is; the centre
/// where it does not leave within reach.
pub(super) fn march(
    grid: &LabelGrid,
    mm: [f32; 3],
    voxel: [u32; 3],
    normal: [f32; 3],
    leaves: impl Fn([i32; 3], usize) -> bool,
    mut visit: impl FnMut(Segment) -> bool,
) -> Option<FarSide> {
    let centre = voxel.map(|v| v as i32);
    let mut labels = Labels::new(grid);
    let mut above = [Segment { voxel: centre, label: 0, length: 0.0 }; START_REACH];
    let mut count = 0;
    let mut up = Steps::from_centre(mm, centre, normal);
    let mut label = labels.get(centre);
    loop {
        if count == START_REACH {
            // The ray does not leave within reach: the path starts at the centre.
            count = 0;
            break;
        }
        let before = up.voxel;
        let (_, length) = up.advance();
        above[count] = Segment { voxel: before, label, length };
        count += 1;
        label = labels.get(up.voxel);
        if label == 0 {
            break;
        }
    }
    if !above[..count].iter().rev().all(|&segment| visit(segment)) {
        return None;
    }
    let mut down = Steps::from_centre(mm, centre, normal.map(|n| -n));
    let mut label = labels.get(centre);
    loop {
        let before = down.voxel;
        let (axis, length) = down.advance();
        if !visit(Segment { voxel: before, label, length }) {
            return None;
        }
        label = labels.get(down.voxel);
        if label != 0 {
            continue;
        }
        let far = FarSide { voxel: before, axis };
        if leaves(before, axis) {
            return Some(far);
        }
        let mut crossed = 0;
        while label == 0 {
            if crossed == NOTCH {
                return Some(far);
            }
            let air = down.voxel;
            let (_, length) = down.advance();
            if !visit(Segment { voxel: air, label: 0, length }) {
                return None;
            }
            label = labels.get(down.voxel);
            crossed += 1;
        }
    }
}
