//! Keeps what is thinner than a voxel.
//!
//! A sheet that falls between voxel centres gets no voxel from the winding number. Along each axis,
//! lines are crossed with the triangles that face mostly along it; where neither voxel centre next
//! to a crossing is solid, the voxel that holds the middle of the crossings between these two
//! centres is kept. Triangles that no line meets at all (needles, grains) are sampled.

use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_voxel::{AIR, Control, LabelGrid};
use rayon::prelude::*;

use super::scan::{Axes, SLAB, Slabs, scan};
use crate::MeshError;
use crate::geometry::{Vec3, add, cross, length, scale, sub};

/// Steps per voxel of a crossing's stored position.
const STEPS: f64 = 1024.0;

/// Labels voxels for parts of the mesh that have none, and returns how many. `corners` are the
/// mesh's triangles in voxels, centres at integers.
pub(crate) fn keep_thin(
    grid: &mut LabelGrid,
    corners: &[[Vec3; 3]],
    label: u8,
    control: &Control,
) -> Result<u64, MeshError> {
    let met: Vec<AtomicBool> = corners.iter().map(|_| AtomicBool::new(false)).collect();
    let mut missing = Vec::new();
    for (axis, axes) in [Axes::X, Axes::Y, Axes::Z].into_iter().enumerate() {
        control.report(axis as u64, 4);
        missing.extend(unsupported(grid, corners, axes, &met, control)?);
    }
    let mut added = set(grid, &missing, label);
    control.report(3, 4);
    let grains: Vec<[u32; 3]> = corners
        .par_iter()
        .zip(&met)
        .filter(|(_, met)| !met.load(Ordering::Relaxed))
        .flat_map_iter(|(c, _)| samples(c))
        .filter_map(|p| grid.frame().checked(voxel(p)))
        .filter(|v| !solid_around(grid, *v))
        .collect();
    added += set(grid, &grains, label);
    control.report(4, 4);
    control.check()?;
    Ok(added)
}

/// The voxel that holds a point given in voxels.
fn voxel(p: Vec3) -> [i64; 3] {
    p.map(|c| (c + 0.5).floor() as i64)
}

/// Sets air voxels among those listed.
fn set(grid: &mut LabelGrid, voxels: &[[u32; 3]], label: u8) -> u64 {
    let mut added = 0;
    for &v in voxels {
        if grid.get(v) == AIR {
            grid.set(v, label);
            added += 1;
        }
    }
    added
}

/// Voxels to keep along one axis, in a fixed order. Marks triangles that any line met.
fn unsupported(
    grid: &LabelGrid,
    corners: &[[Vec3; 3]],
    axes: Axes,
    met: &[AtomicBool],
    control: &Control,
) -> Result<Vec<[u32; 3]>, MeshError> {
    let size = grid.size();
    let lines = size[axes.u];
    let slabs = Slabs::new(corners, axes.v, size[axes.v]);
    let parts = (0..slabs.len())
        .into_par_iter()
        .map(|s| {
            control.check()?;
            let mut keys: Vec<u64> = Vec::new();
            for &i in slabs.triangles(s) {
                let c = &corners[i as usize];
                let n = cross(sub(c[1], c[0]), sub(c[2], c[0])).map(f64::abs);
                let facing = n[axes.t] >= n[axes.u] && n[axes.t] >= n[axes.v];
                let mut any = false;
                scan(c, axes, Slabs::layers(s), lines, |x| {
                    any = true;
                    if facing {
                        let line = (x.v as usize % SLAB) as u64 * u64::from(lines) + u64::from(x.u);
                        // One voxel of offset keeps a crossing below the first centre positive.
                        let t = ((x.t + 1.0) * STEPS).round().clamp(0.0, f64::from(u32::MAX));
                        keys.push(line << 32 | t as u64);
                    }
                });
                if any {
                    met[i as usize].store(true, Ordering::Relaxed);
                }
            }
            keys.sort_unstable();
            let mut missing = Vec::new();
            let cell = |k: &u64| (k >> 32, (*k as u32).div_ceil(STEPS as u32));
            for group in keys.chunk_by(|a, b| cell(a) == cell(b)) {
                let line = group[0] >> 32;
                let place = |k: u64| f64::from(k as u32) / STEPS - 1.0;
                let (low, high) = (place(group[0]), place(group[group.len() - 1]));
                let mut at = [0i64; 3];
                at[axes.u] = (line % u64::from(lines)) as i64;
                at[axes.v] = (line / u64::from(lines)) as i64 + (s * SLAB) as i64;
                // A crossing right at a centre leaves open which side that voxel is on, so its other
                // neighbour counts too.
                let near = 1.0 + 1.5 / STEPS;
                let supported = ((low - near).ceil() as i64..=(high + near).floor() as i64).any(|t| {
                    at[axes.t] = t;
                    grid.at(at) != AIR
                });
                if !supported {
                    at[axes.t] = (0.5 * (low + high) + 0.5).floor() as i64;
                    missing.extend(grid.frame().checked(at));
                }
            }
            Ok(missing)
        })
        .collect::<Result<Vec<_>, MeshError>>()?;
    Ok(parts.into_iter().flatten().collect())
}

/// Points along the longest edge of a triangle and at its centroid, at most half a voxel apart.
fn samples(c: &[Vec3; 3]) -> impl Iterator<Item = Vec3> + use<> {
    let edges = [(c[0], c[1]), (c[1], c[2]), (c[2], c[0])];
    let spans = edges.map(|(a, b)| length(sub(b, a)));
    let k = (0..3).fold(0, |best, k| if spans[k] > spans[best] { k } else { best });
    let (a, b) = edges[k];
    let middle = scale(add(add(c[0], c[1]), c[2]), 1.0 / 3.0);
    let steps = (spans[k] * 2.0).ceil().max(1.0) as u64;
    (0..=steps).map(move |i| add(a, scale(sub(b, a), i as f64 / steps as f64))).chain([middle])
}

/// Whether a voxel or one of its 26 neighbours is solid.
fn solid_around(grid: &LabelGrid, v: [u32; 3]) -> bool {
    let v = v.map(i64::from);
    grid.at(v) != AIR
        || (0..27).any(|k| grid.at([v[0] + k % 3 - 1, v[1] + k / 3 % 3 - 1, v[2] + k / 9 - 1]) != AIR)
}
