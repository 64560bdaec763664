//! Exact crossings of grid lines with triangles.
//!
//! A line runs along one axis through voxel centres. A triangle covers it when the line's point
//! lies inside the triangle's projection; each edge decides on which side the line passes from its
//! own two ends alone, in one fixed order, so two triangles that share an edge never both cover,
//! or both miss, a line that passes between them. The signed crossings of a closed surface hence
//! sum to zero on every line, whatever the rounding.

use std::ops::Range;

use crate::geometry::Vec3;

/// Layers that are scanned together.
pub(crate) const SLAB: usize = 16;

/// The axes of a scan: lines run along `t`, are counted along `u` and grouped in layers along `v`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axes {
    pub t: usize,
    pub u: usize,
    pub v: usize,
}

impl Axes {
    /// Lines along x: the order (u, v, t) = (y, z, x) is right-handed, which makes a crossing's sign
    /// +1 where a line enters a surface that faces outwards.
    pub const X: Self = Self { t: 0, u: 1, v: 2 };
    /// Lines along y; signs are reversed.
    pub const Y: Self = Self { t: 1, u: 0, v: 2 };
    /// Lines along z.
    pub const Z: Self = Self { t: 2, u: 0, v: 1 };
}

/// Where a line crosses a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Crossing {
    pub u: u32,
    pub v: u32,
    /// Position along the line in voxels; centres are integers.
    pub t: f64,
    pub sign: i32,
}

/// The layers `v` that may cross a triangle.
pub(crate) fn layers(corners: &[Vec3; 3], v: usize) -> Range<i64> {
    let [a, b, c] = corners.map(|p| p[v]);
    (a.min(b).min(c).ceil() as i64)..(a.max(b).max(c).ceil() as i64)
}

/// Emits the crossings of a triangle with lines in the given layers. `corners` are in voxels, with
/// centres at integers; `lines` is the number of lines along u.
pub(crate) fn scan(
    corners: &[Vec3; 3],
    axes: Axes,
    within: Range<i64>,
    lines: u32,
    mut emit: impl FnMut(Crossing),
) {
    let Axes { t, u, v } = axes;
    let own = layers(corners, v);
    let plane = Plane::of(corners, axes);
    for layer in own.start.max(within.start)..own.end.min(within.end) {
        let height = layer as f64;
        let (mut up, mut down) = (0, 0);
        for k in 0..3 {
            let (a, b) = (&corners[k], &corners[(k + 1) % 3]);
            if a[v] <= height && height < b[v] {
                up = first_line(a, b, height, u, v, lines);
            } else if b[v] <= height && height < a[v] {
                down = first_line(b, a, height, u, v, lines);
            }
        }
        let sign = if up < down { 1 } else { -1 };
        for line in up.min(down)..up.max(down) {
            emit(Crossing { u: line, v: layer as u32, t: plane.at(f64::from(line), height), sign });
        }
    }
    debug_assert!(t != u && u != v);
}

/// The first line at or past the point where the edge from `low` to `high` meets a layer.
fn first_line(low: &Vec3, high: &Vec3, height: f64, u: usize, v: usize, lines: u32) -> u32 {
    let at = low[u] + (height - low[v]) * ((high[u] - low[u]) / (high[v] - low[v]));
    at.ceil().clamp(0.0, f64::from(lines)) as u32
}

/// A triangle's plane as t over (u, v).
struct Plane {
    base: [f64; 3],
    slope: [f64; 2],
    range: [f64; 2],
}

impl Plane {
    fn of(corners: &[Vec3; 3], Axes { t, u, v }: Axes) -> Self {
        let [a, b, c] = corners.map(|p| [p[t], p[u], p[v]]);
        let (e, f): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        let area = e[1] * f[2] - e[2] * f[1];
        let slope = [(e[0] * f[2] - e[2] * f[0]) / area, (e[1] * f[0] - e[0] * f[1]) / area];
        let ts = [a[0], b[0], c[0]];
        Self {
            base: a,
            slope,
            range: [
                ts.iter().copied().fold(f64::INFINITY, f64::min),
                ts.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ],
        }
    }

    /// Kept within the triangle's own range, which also settles the NaN of an edge-on triangle.
    fn at(&self, u: f64, v: f64) -> f64 {
        let t = self.base[0] + self.slope[0] * (u - self.base[1]) + self.slope[1] * (v - self.base[2]);
        t.max(self.range[0]).min(self.range[1])
    }
}

/// Triangles grouped by the slab of [`SLAB`] layers they cross, as a compressed list.
pub(crate) struct Slabs {
    starts: Vec<u64>,
    triangles: Vec<u32>,
}

impl Slabs {
    /// Groups triangles for `size` layers along axis `v`.
    pub fn new(corners: &[[Vec3; 3]], v: usize, size: u32) -> Self {
        let count = (size as usize).div_ceil(SLAB);
        let span = |c: &[Vec3; 3]| {
            let l = layers(c, v);
            let (start, end) = (l.start.clamp(0, i64::from(size)), l.end.clamp(0, i64::from(size)));
            (start as usize / SLAB)..if end > start {
                (end as usize).div_ceil(SLAB)
            } else {
                start as usize / SLAB
            }
        };
        let mut starts = vec![0u64; count + 1];
        for c in corners {
            for s in span(c) {
                starts[s + 1] += 1;
            }
        }
        for s in 0..count {
            starts[s + 1] += starts[s];
        }
        let mut next = starts.clone();
        let mut triangles = vec![0u32; starts[count] as usize];
        for (i, c) in corners.iter().enumerate() {
            for s in span(c) {
                triangles[next[s] as usize] = i as u32;
                next[s] += 1;
            }
        }
        Self { starts, triangles }
    }

    /// Number of slabs.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Triangles that cross a slab, ascending.
    pub fn triangles(&self, slab: usize) -> &[u32] {
        &self.triangles[self.starts[slab] as usize..self.starts[slab + 1] as usize]
    }

    /// The layers of a slab; the last may reach past the grid, where nothing crosses.
    pub fn layers(slab: usize) -> Range<i64> {
        (slab * SLAB) as i64..((slab + 1) * SLAB) as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(corners: [Vec3; 3], axes: Axes) -> Vec<Crossing> {
        let mut found = Vec::new();
        scan(&corners, axes, 0..20, 20, |c| found.push(c));
        found
    }

    #[test]
    fn crosses_where_the_plane_says_and_signs_by_facing() {
        // The plane x = 1 + y / 4 + z / 2, seen from +x counter-clockwise: it faces +x, lines leave.
        let at = |y: f64, z: f64| [1.0 + y / 4.0 + z / 2.0, y, z];
        let corners = [at(0.5, 0.5), at(8.5, 0.5), at(0.5, 8.5)];
        let found = all(corners, Axes::X);
        assert_eq!(found.len(), 8 * 7 / 2);
        for c in found {
            assert_eq!(c.sign, -1);
            assert!((c.t - at(f64::from(c.u), f64::from(c.v))[0]).abs() < 1e-12);
        }
        let [a, b, c] = corners;
        assert!(all([a, c, b], Axes::X).iter().all(|c| c.sign == 1));
    }

    proptest! {
        // Corners on a coarse lattice plant lines through vertices, edges and coplanar faces.
        #[test]
        fn a_tetrahedron_sums_to_zero_on_every_line(
            p in prop::array::uniform4(prop::array::uniform3(prop_oneof![
                (0..12i32).prop_map(f64::from),
                0.0..12.0f64,
            ])),
        ) {
            for axes in [Axes::X, Axes::Y, Axes::Z] {
                let mut sums = [[0i32; 20]; 20];
                for [a, b, c] in [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] {
                    for x in all([p[a], p[b], p[c]], axes) {
                        sums[x.u as usize][x.v as usize] += x.sign;
                    }
                }
                prop_assert!(sums.iter().flatten().all(|&s| s == 0));
            }
        }
    }
}
