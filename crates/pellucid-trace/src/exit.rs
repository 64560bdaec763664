//! What happens at the surface: exit, internal reflection, and the steps that voxels make of a
//! smooth surface.

use crate::fresnel::internal_reflectance_f32;
use crate::march::{Flight, byte, inner_side, voxel};
use crate::volume::Volume;

/// Most air voxels a path may pass to get back into the object across a step of the surface.
const NOTCH: usize = 4;

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
        /// Byte of the voxel.
        byte: u8,
    },
}

/// Where a flight through air gets back into the object within a few voxels, and the voxel's byte there.
#[inline(always)]
fn back_inside(volume: &Volume, position: [f32; 3], direction: [f32; 3]) -> Option<([f32; 3], u8)> {
    let mut flight = Flight::new(volume.mm(), position, direction);
    for _ in 0..NOTCH {
        flight.advance();
        let byte = byte(volume.bricks(), flight.position);
        if byte & 15 != 0 {
            return Some((flight.position, byte));
        }
    }
    None
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
        if let Some((position, byte)) = back_inside(volume, position, d) {
            return Outcome::Stay { position, direction: d, byte };
        }
        normal = face;
    }
    if u >= internal_reflectance_f32(dot(d, normal), index) {
        return Outcome::Leave;
    }
    let mut direction = reflect(d, normal);
    if dot(direction, face) >= 0.0 {
        if let Some((position, byte)) = back_inside(volume, position, direction) {
            return Outcome::Stay { position, direction, byte };
        }
        direction = reflect(d, face);
    }
    Outcome::Stay { position: inner, direction, byte: byte(volume.bricks(), inner) }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn reflect(d: [f32; 3], n: [f32; 3]) -> [f32; 3] {
    let twice = 2.0 * dot(d, n);
    [d[0] - twice * n[0], d[1] - twice * n[1], d[2] - twice * n[2]]
}
