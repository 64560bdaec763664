//! Which triangle each texel of an image shows.

use pellucid_voxel::Control;

use super::CornerUv;
use crate::MeshError;
use crate::geometry::nearest_on_triangle;

/// No triangle.
pub(super) const NOTHING: u32 = u32::MAX;
/// Texels around a triangle that take its nearest colour, so that filters do not mix in what lies beside it.
pub(super) const GUTTER: f64 = 2.0;
/// A texel counts as covered twice where both triangles hold its middle by so much of a texel.
const OVERLAP: f64 = 0.25;
/// Triangles between looks at the cancellation flag.
const CHUNK: usize = 1024;

/// An image's texels and the triangles on them.
pub(super) struct Raster {
    pub size: [u32; 2],
    /// Corners by triangle, in texels.
    pub uv: Vec<CornerUv>,
    /// By texel.
    pub owner: Vec<u32>,
}

/// Signed area of a triangle in the image.
pub(super) fn area([a, b, c]: &CornerUv) -> f64 {
    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]))
}

impl Raster {
    /// From corners between 0 and 1.
    pub fn new(size: [u32; 2], uv: Vec<CornerUv>) -> Self {
        let scale = size.map(f64::from);
        let uv = uv.into_iter().map(|t| t.map(|c| [c[0] * scale[0], c[1] * scale[1]])).collect();
        Self::of_texels(size, uv)
    }

    /// From corners in texels.
    pub fn of_texels(size: [u32; 2], uv: Vec<CornerUv>) -> Self {
        Self { size, uv, owner: vec![NOTHING; size[0] as usize * size[1] as usize] }
    }

    /// Gives every texel whose middle a triangle holds to the first that does. Returns whether some lie well within two
    /// of them.
    pub fn cover(&mut self, control: &Control<'_>) -> Result<bool, MeshError> {
        let mut overlaps = false;
        for t in 0..self.uv.len() {
            if t % CHUNK == 0 {
                control.check()?;
            }
            let corners = self.uv[t];
            self.each_texel(t, 0.0, |owner, middle| {
                let depth = depth_inside(middle, &corners);
                if depth < 0.0 {
                    return owner;
                }
                if owner == NOTHING {
                    return t as u32;
                }
                overlaps |= depth > OVERLAP;
                owner
            });
            if overlaps && self.is_really_covered_twice(t) {
                return Ok(true);
            }
            overlaps = false;
        }
        Ok(false)
    }

    /// Whether a texel well within triangle `t` lies well within another one, its owner.
    fn is_really_covered_twice(&mut self, t: usize) -> bool {
        let corners = self.uv[t];
        let uv = std::mem::take(&mut self.uv);
        let mut found = false;
        let low_high = bounds(&corners, 0.0, self.size);
        for y in low_high[1].0..low_high[1].1 {
            for x in low_high[0].0..low_high[0].1 {
                let owner = self.owner[y as usize * self.size[0] as usize + x as usize];
                let middle = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                found |= owner != NOTHING
                    && owner as usize != t
                    && depth_inside(middle, &corners) > OVERLAP
                    && depth_inside(middle, &uv[owner as usize]) > OVERLAP;
            }
        }
        self.uv = uv;
        found
    }

    /// Gives free texels near a triangle to the first one near.
    pub fn spread(&mut self, control: &Control<'_>) -> Result<(), MeshError> {
        for t in 0..self.uv.len() {
            if t % CHUNK == 0 {
                control.check()?;
            }
            let corners = self.uv[t];
            self.each_texel(t, GUTTER, |owner, middle| {
                let near = owner == NOTHING && nearest(middle, &corners).1 <= GUTTER * GUTTER;
                if near { t as u32 } else { owner }
            });
        }
        Ok(())
    }

    /// Weights of the point of a triangle that is nearest to a texel's middle.
    pub fn barycentric(&self, triangle: u32, [x, y]: [u32; 2]) -> [f64; 3] {
        nearest([f64::from(x) + 0.5, f64::from(y) + 0.5], &self.uv[triangle as usize]).0
    }

    /// Lets `choose` give an owner to each texel around a triangle, from the one it has and its middle.
    fn each_texel(&mut self, triangle: usize, around: f64, mut choose: impl FnMut(u32, [f64; 2]) -> u32) {
        let [columns, rows] = bounds(&self.uv[triangle], around, self.size);
        for y in rows.0..rows.1 {
            for x in columns.0..columns.1 {
                let owner = &mut self.owner[y as usize * self.size[0] as usize + x as usize];
                *owner = choose(*owner, [f64::from(x) + 0.5, f64::from(y) + 0.5]);
            }
        }
    }
}

/// First and past-the-last column and row of the texels whose middles lie around a triangle.
fn bounds(corners: &CornerUv, around: f64, size: [u32; 2]) -> [(u32, u32); 2] {
    [0, 1].map(|a| {
        let low = corners.iter().map(|c| c[a]).fold(f64::INFINITY, f64::min) - around;
        let high = corners.iter().map(|c| c[a]).fold(f64::NEG_INFINITY, f64::max) + around;
        // The casts saturate.
        let first = ((low - 0.5).ceil().max(0.0) as u32).min(size[a]);
        let last = (((high - 0.5).floor() + 1.0).max(0.0) as u32).min(size[a]);
        (first, last.max(first))
    })
}

/// How far inside all edges of a triangle a point lies; below 0 outside, or where the triangle has no area.
fn depth_inside(p: [f64; 2], corners: &CornerUv) -> f64 {
    let turn = area(corners).signum();
    if area(corners) == 0.0 {
        return -1.0;
    }
    (0..3)
        .map(|k| {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            turn * (dx * (p[1] - a[1]) - dy * (p[0] - a[0])) / dx.hypot(dy)
        })
        .fold(f64::INFINITY, f64::min)
}

/// Weights of the nearest point of a triangle, and its squared distance.
fn nearest(p: [f64; 2], corners: &CornerUv) -> ([f64; 3], f64) {
    nearest_on_triangle([p[0], p[1], 0.0], corners.map(|[x, y]| [x, y, 0.0]))
}
