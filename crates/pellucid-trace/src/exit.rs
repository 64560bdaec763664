//! What happens at the surface: exit, internal reflection, and the steps that voxels make of a
//! smooth surface.
//!
//! Positions are in voxels, margin included. A position on a voxel face belongs to the upper
//! voxel; one that must lie below the face is the next lower float.

use crate::fresnel::internal_reflectance_f32;
use crate::volume::Volume;

/// Most air voxels a path may pass to get back into the object across a step of the surface.
const NOTCH: usize = 4;
/// Most voxels between a surface voxel's centre and where its paths start.
const START_REACH: usize = 64;

/// What a path does at the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome {
    /// It leaves the object.
    Leave,
    /// It goes on inside.
    Stay {
        /// Where, in a solid voxel.
        position: [f32; 3],
        /// Unit direction in millimetres.
        direction: [f32; 3],
    },
}

/// A straight flight from voxel to voxel.
struct Flight {
    position: [f32; 3],
    rate: [f32; 3],
}

impl Flight {
    fn new(volume: &Volume, position: [f32; 3], direction: [f32; 3]) -> Self {
        let mm = volume.frame().pitch().mm();
        Self { position, rate: std::array::from_fn(|a| direction[a] / mm[a] as f32) }
    }

    /// Moves to the next voxel face, onto its far side; returns the axis crossed.
    fn advance(&mut self) -> usize {
        // Positions are not negative: truncation is the floor.
        let floor = self.position.map(|p| p as i32 as f32);
        let plane: [f32; 3] =
            std::array::from_fn(|a| if self.rate[a] > 0.0 { floor[a] + 1.0 } else { floor[a] });
        let time: [f32; 3] =
            std::array::from_fn(|a| (plane[a] - self.position[a]).abs() / self.rate[a].abs().max(1e-12));
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
#[inline]
pub(crate) fn voxel(position: [f32; 3]) -> [u32; 3] {
    position.map(|p| p as u32)
}

fn solid(volume: &Volume, position: [f32; 3]) -> bool {
    position.iter().all(|&p| p >= 0.0) && volume.bricks().byte(voxel(position)) & 15 != 0
}

/// The point where the ray from a voxel's centre along `normal` leaves the object, on the inner
/// side of the face; the centre when the ray does not leave within reach.
pub(crate) fn surface_position(volume: &Volume, voxel: [u32; 3], normal: [f32; 3]) -> [f32; 3] {
    let centre = voxel.map(|v| v as f32 + 0.5);
    let mut flight = Flight::new(volume, centre, normal);
    for _ in 0..START_REACH {
        let axis = flight.advance();
        if !solid(volume, flight.position) {
            let mut inner = flight.position;
            inner[axis] = inner_side(inner[axis], normal[axis] > 0.0);
            return if solid(volume, inner) { inner } else { centre };
        }
    }
    centre
}

/// The other side of the face that a flight just crossed.
#[inline(always)]
fn inner_side(p: f32, upward: bool) -> f32 {
    if upward { p.next_down() } else { p.next_up() }
}

/// Where a flight through air gets back into the object within a few voxels.
fn back_inside(volume: &Volume, position: [f32; 3], direction: [f32; 3]) -> Option<[f32; 3]> {
    let mut flight = Flight::new(volume, position, direction);
    (0..NOTCH).find_map(|_| {
        flight.advance();
        solid(volume, flight.position).then_some(flight.position)
    })
}

/// A path that flew along `d` and just crossed a voxel face across `axis` into air at `position`
/// meets the surface; `u` in 0..1 decides between reflection and transmission. An index of 1
/// never reflects.
///
/// The face is a step of a smooth surface whose normal n the last voxel knows. Where d does not
/// head outward by n, the path crosses the step's notch back into the object. Otherwise it is
/// reflected about n with Fresnel's probability; should the reflected direction still leave by
/// the face, it too crosses the notch. Where no solid voxel follows within [`NOTCH`] voxels (a
/// true edge), the face's own normal decides instead.
#[inline(always)]
pub(crate) fn meet(
    volume: &Volume,
    index: f32,
    position: [f32; 3],
    axis: usize,
    d: [f32; 3],
    u: f32,
) -> Outcome {
    let mut inner = position;
    inner[axis] = inner_side(inner[axis], d[axis] > 0.0);
    let mut face = [0.0; 3];
    face[axis] = if d[axis] > 0.0 { 1.0 } else { -1.0 };
    let mut normal = volume.normal(voxel(inner)).unwrap_or(face);
    if dot(d, normal) <= 0.0 {
        if let Some(position) = back_inside(volume, position, d) {
            return Outcome::Stay { position, direction: d };
        }
        normal = face;
    }
    if u >= internal_reflectance_f32(dot(d, normal), index) {
        return Outcome::Leave;
    }
    let reflected = reflect(d, normal);
    if dot(reflected, face) < 0.0 {
        return Outcome::Stay { position: inner, direction: reflected };
    }
    match back_inside(volume, position, reflected) {
        Some(position) => Outcome::Stay { position, direction: reflected },
        None => Outcome::Stay { position: inner, direction: reflect(d, face) },
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn reflect(d: [f32; 3], n: [f32; 3]) -> [f32; 3] {
    let twice = 2.0 * dot(d, n);
    std::array::from_fn(|a| d[a] - twice * n[a])
}
