//! Keeps what is thinner than a voxel.
//!
//! A sheet that falls between voxel centres gets no voxel from the winding number. Lines along each
//! axis are crossed with the triangles. Where neither voxel centre next to a crossing is solid, the
//! crossings between these two centres belong to something thin. When all their triangles face
//! mostly along the line it is a sheet, and the voxel that holds their middle is kept; otherwise
//! the line only cuts off an edge of the mesh.
//!
//! Triangles so narrow that they may slip between lines (needles, grains) are sampled at points: the
//! voxel that holds one is kept when no voxel around it is solid, for a long triangle around it
//! across its length.

use pellucid_voxel::{AIR, Control, LabelGrid};
use rayon::prelude::*;

use super::scan::{Axes, SLAB, Slabs, scan};
use crate::MeshError;
use crate::geometry::{Vec3, add, area_vector, centroid, length, scale, sub};
use crate::mesh_places::MOST_PLACES;

/// Steps per voxel of a crossing's stored position.
const STEPS: f64 = 1024.0;
/// Wider triangles meet lines along the axis they face everywhere: seen along it, they are still a
/// voxel wide.
const NARROW: f64 = 2.0;
/// Length over width from which a triangle counts as long.
const LONG: f64 = 4.0;

/// Labels voxels for parts of the mesh that have none, and returns how many and some of them. `corners` are the
/// mesh's triangles in voxels, centres at integers.
pub(crate) fn keep_thin(
    grid: &mut LabelGrid,
    corners: &[[Vec3; 3]],
    label: u8,
    control: &Control,
) -> Result<(u64, Vec<[u32; 3]>), MeshError> {
    let mut sheets = Vec::new();
    for (axis, axes) in [Axes::X, Axes::Y, Axes::Z].into_iter().enumerate() {
        control.report(axis as u64, 4);
        sheets.extend(sheet_voxels(grid, corners, axes, control)?);
    }
    let mut added = Added::default();
    added.set(grid, &sheets, label);
    control.report(3, 4);
    let narrow = corners.par_iter().filter(|c| width(c) < NARROW);
    let points = narrow.flat_map_iter(|c| {
        let along = lengthwise(c);
        samples(c, along).map(move |p| (p, along))
    });
    let grains: Vec<[u32; 3]> = points
        .filter_map(|(p, along)| grid.frame().checked(voxel(p)).filter(|v| !solid_around(grid, *v, along)))
        .collect();
    added.set(grid, &grains, label);
    control.report(4, 4);
    control.check()?;
    Ok((added.count, added.some))
}

/// The voxel that holds a point given in voxels.
fn voxel(p: Vec3) -> [i64; 3] {
    p.map(|c| (c + 0.5).floor() as i64)
}

/// Voxels that were air.
#[derive(Default)]
struct Added {
    count: u64,
    some: Vec<[u32; 3]>,
}

impl Added {
    /// Sets air voxels among those listed.
    fn set(&mut self, grid: &mut LabelGrid, voxels: &[[u32; 3]], label: u8) {
        for &v in voxels {
            if grid.get(v) == AIR {
                grid.set(v, label);
                self.count += 1;
                if self.some.len() < MOST_PLACES {
                    self.some.push(v);
                }
            }
        }
    }
}

/// Voxels to keep for sheets that face along one axis, in a fixed order.
fn sheet_voxels(
    grid: &LabelGrid,
    corners: &[[Vec3; 3]],
    axes: Axes,
    control: &Control,
) -> Result<Vec<[u32; 3]>, MeshError> {
    let size = grid.size();
    let lines = size[axes.u];
    let slabs = Slabs::new(corners, axes.v, size[axes.v]);
    let parts = (0..slabs.len())
        .into_par_iter()
        .map(|s| {
            control.check()?;
            // Line, position in steps, and whether the triangle faces elsewhere, from high to low bits.
            let mut keys: Vec<u64> = Vec::new();
            for &i in slabs.triangles(s) {
                let c = &corners[i as usize];
                let n = area_vector(*c).map(f64::abs);
                let facing = n[axes.t] >= n[axes.u] && n[axes.t] >= n[axes.v];
                scan(c, axes, Slabs::layers(s), lines, |x| {
                    let line = (x.v as usize % SLAB) as u64 * u64::from(lines) + u64::from(x.u);
                    // One voxel of offset keeps a crossing below the first centre positive.
                    let t = ((x.t + 1.0) * STEPS).round().clamp(0.0, f64::from(u32::MAX >> 1));
                    keys.push(line << 32 | (t as u64) << 1 | u64::from(!facing));
                });
            }
            keys.sort_unstable();
            let mut missing = Vec::new();
            let step = |k: u64| k as u32 >> 1;
            let cell = |k: u64| (k >> 32, step(k).div_ceil(STEPS as u32));
            for group in keys.chunk_by(|&a, &b| cell(a) == cell(b)) {
                if group.iter().any(|k| k & 1 == 1) {
                    continue;
                }
                let line = group[0] >> 32;
                let place = |k: u64| f64::from(step(k)) / STEPS - 1.0;
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

/// The longest edge of a triangle.
fn longest_edge(c: &[Vec3; 3]) -> (Vec3, Vec3) {
    let edges = [(c[0], c[1]), (c[1], c[2]), (c[2], c[0])];
    let spans = edges.map(|(a, b)| length(sub(b, a)));
    edges[(0..3).fold(0, |best, k| if spans[k] > spans[best] { k } else { best })]
}

/// The least width of a triangle in voxels.
fn width(c: &[Vec3; 3]) -> f64 {
    let (a, b) = longest_edge(c);
    let span = length(sub(b, a));
    if span > 0.0 { 2.0 * length(area_vector(*c)) / span } else { 0.0 }
}

/// Points along the longest edge of a triangle, at most half a voxel apart, and its centroid. Along a
/// long triangle they keep half a voxel off its ends, so that no voxel centre past them is met.
fn samples(c: &[Vec3; 3], along: Option<usize>) -> impl Iterator<Item = Vec3> + use<> {
    let (a, b) = longest_edge(c);
    let edge = sub(b, a);
    let trim = along.map_or(0.0, |axis| 0.5 / edge[axis].abs());
    let steps = (length(edge) * 2.0).ceil().max(1.0);
    let at = move |i: u64| add(a, scale(edge, trim + (1.0 - 2.0 * trim) * i as f64 / steps));
    (0..=steps as u64).map(at).chain(along.is_none().then_some(centroid(*c)))
}

/// The axis a long triangle runs along, where the triangle's plane is steep enough to it that the
/// voxels around across that axis include one behind the triangle.
fn lengthwise(c: &[Vec3; 3]) -> Option<usize> {
    let (a, b) = longest_edge(c);
    let edge = sub(b, a);
    let axis = (0..3).fold(0, |best, k| if edge[k].abs() > edge[best].abs() { k } else { best });
    let n = area_vector(*c).map(f64::abs);
    let steep = n.iter().sum::<f64>() >= 2.0 * n[axis];
    (edge[axis].abs() > 2.0 && length(edge) > LONG * width(c) && steep).then_some(axis)
}

/// Whether a voxel or one of its neighbours is solid: all 26, or the 8 across an axis.
fn solid_around(grid: &LabelGrid, v: [u32; 3], along: Option<usize>) -> bool {
    let v = v.map(i64::from);
    grid.at(v) != AIR
        || (0..27)
            .map(|k| [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1])
            .filter(|d| along.is_none_or(|axis| d[axis] == 0))
            .any(|d| grid.at([v[0] + d[0], v[1] + d[1], v[2] + d[2]]) != AIR)
}
