//! Straight flights from voxel to voxel.
//!
//! Positions are in voxels, margin included. A position on a voxel face belongs to the upper
//! voxel; one that must lie below the face is the next lower float.

use crate::bricks::Bricks;

/// Most voxels between a surface voxel's centre and where its paths start.
const START_REACH: usize = 64;

/// A straight flight from voxel to voxel.
pub(crate) struct Flight {
    pub(crate) position: [f32; 3],
    rate: [f32; 3],
}

// Loops over axes, no closures: within the kernel they would not inherit its instruction set, and be called.
impl Flight {
    /// From a position along a direction in millimetres, through voxels of edges `mm`.
    #[inline(always)]
    pub(crate) fn new(mm: [f64; 3], position: [f32; 3], direction: [f32; 3]) -> Self {
        let mut rate = [0.0; 3];
        for a in 0..3 {
            rate[a] = direction[a] / mm[a] as f32;
        }
        Self { position, rate }
    }

    /// Moves to the next voxel face, onto its far side; returns the axis crossed.
    #[inline(always)]
    pub(crate) fn advance(&mut self) -> usize {
        let mut plane = [0.0; 3];
        let mut time = [0.0; 3];
        for a in 0..3 {
            // Positions are not negative: truncation is the floor.
            let floor = self.position[a] as i32 as f32;
            plane[a] = if self.rate[a] > 0.0 { floor + 1.0 } else { floor };
            time[a] = (plane[a] - self.position[a]).abs() / self.rate[a].abs().max(1e-12);
        }
        let axis = if time[0] <= time[1] && time[0] <= time[2] {
            0
        } else if time[1] <= time[2] {
            1
        } else {
            2
        };
        for a in 0..3 {
            self.position[a] += self.rate[a] * time[axis];
        }
        self.position[axis] = if self.rate[axis] > 0.0 { plane[axis] } else { plane[axis].next_down() };
        axis
    }
}

/// The voxel of a position.
#[inline(always)]
pub(crate) fn voxel(position: [f32; 3]) -> [u32; 3] {
    [position[0] as u32, position[1] as u32, position[2] as u32]
}

/// True where a position lies in a solid voxel.
#[inline(always)]
pub(crate) fn solid(bricks: &Bricks, position: [f32; 3]) -> bool {
    byte(bricks, position) & 15 != 0
}

/// The byte of the voxel at a position; 0, air, outside.
#[inline(always)]
pub(crate) fn byte(bricks: &Bricks, position: [f32; 3]) -> u8 {
    let [x, y, z] = position;
    if x >= 0.0 && y >= 0.0 && z >= 0.0 { bricks.byte(voxel(position)) } else { 0 }
}

/// The point where the ray from a voxel's centre along `normal` leaves the object, on the inner
/// side of the face; the centre when the ray does not leave within reach.
pub(crate) fn surface_position(bricks: &Bricks, mm: [f64; 3], voxel: [u32; 3], normal: [f32; 3]) -> [f32; 3] {
    let centre = voxel.map(|v| v as f32 + 0.5);
    let mut flight = Flight::new(mm, centre, normal);
    for _ in 0..START_REACH {
        let axis = flight.advance();
        if !solid(bricks, flight.position) {
            let mut inner = flight.position;
            inner[axis] = inner_side(inner[axis], normal[axis] > 0.0);
            return if solid(bricks, inner) { inner } else { centre };
        }
    }
    centre
}

/// The other side of the face that a flight just crossed.
#[inline(always)]
pub(crate) fn inner_side(p: f32, upward: bool) -> f32 {
    if upward { p.next_down() } else { p.next_up() }
}
