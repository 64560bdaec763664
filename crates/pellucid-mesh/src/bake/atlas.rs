//! A new atlas: every triangle laid flat, in rows by height.

use pellucid_voxel::Control;

use super::raster::{GUTTER, Raster};
use super::{BakeOptions, CornerUv};
use crate::MeshError;
use crate::geometry::{Vec3, dot, length, sub};

/// Each failed attempt takes texels coarser by so much.
const COARSER: f64 = 1.25;
/// Coarser than this many times what was asked for is refused.
const MOST_COARSE: f64 = 64.0;

/// Packs triangles at `options.texel_mm`, coarser where they do not fit.
pub(super) fn pack(
    name: &str,
    corners: &[[Vec3; 3]],
    options: &BakeOptions,
    control: &Control<'_>,
) -> Result<Raster, MeshError> {
    let mut texel_mm = options.texel_mm;
    while texel_mm <= options.texel_mm * MOST_COARSE {
        control.check()?;
        let flat: Vec<CornerUv> = corners.iter().map(|c| lay_flat(c, texel_mm)).collect();
        if let Some((size, uv)) = shelves(&flat, options.max_edge) {
            let mut raster = Raster::of_texels(size, uv);
            raster.cover(control)?;
            raster.spread(control)?;
            return Ok(raster);
        }
        texel_mm *= COARSER;
    }
    Err(MeshError::unsupported(
        name,
        "texture",
        format!("its {} triangles do not fit into {1} x {1} texels", corners.len(), options.max_edge),
        "simplify the mesh, or allow a larger texture",
    ))
}

/// A triangle in texels with its longest edge along u, its apex below, and its box from the origin.
fn lay_flat(corners: &[Vec3; 3], texel_mm: f64) -> CornerUv {
    let edge = |k: usize| length(sub(corners[(k + 1) % 3], corners[k]));
    let first = (1..3).fold(0, |best, k| if edge(k) > edge(best) { k } else { best });
    let [a, b, c] = [0, 1, 2].map(|k| corners[(first + k) % 3]);
    let long = edge(first);
    let mut flat = [[0.0; 2]; 3];
    if long > 0.0 {
        let along = dot(sub(c, a), sub(b, a)) / long;
        let height = (dot(sub(c, a), sub(c, a)) - along * along).max(0.0).sqrt();
        let placed = [[0.0, 0.0], [long, 0.0], [along.clamp(0.0, long), height]];
        for (k, place) in placed.into_iter().enumerate() {
            flat[(first + k) % 3] = place.map(|v| v / texel_mm);
        }
    }
    flat
}

/// Puts boxes in rows, the highest first; `None` where they do not fit.
fn shelves(flat: &[CornerUv], max_edge: u32) -> Option<([u32; 2], Vec<CornerUv>)> {
    let box_of = |t: &CornerUv| [0, 1].map(|a| t.iter().map(|c| c[a]).fold(0.0, f64::max));
    // Whole texels, with a gutter on all sides.
    let cells: Vec<[f64; 2]> = flat.iter().map(|t| box_of(t).map(|v| v.ceil() + 2.0 * GUTTER)).collect();
    let total: f64 = cells.iter().map(|[w, h]| w * h).sum();
    let widest = cells.iter().map(|[w, _]| *w).fold(0.0, f64::max);
    let width = (1.05 * total).sqrt().ceil().max(widest).max(16.0);
    if width > f64::from(max_edge) {
        return None;
    }
    let mut order: Vec<usize> = (0..flat.len()).collect();
    order.sort_by(|&a, &b| cells[b][1].total_cmp(&cells[a][1]));
    let mut uv = vec![[[0.0; 2]; 3]; flat.len()];
    let (mut x, mut y, mut row) = (0.0, 0.0, 0.0);
    for t in order {
        let [w, h] = cells[t];
        if x + w > width {
            (x, y, row) = (0.0, y + row, 0.0);
        }
        row = f64::max(row, h);
        uv[t] = flat[t].map(|[u, v]| [x + GUTTER + u, y + GUTTER + v]);
        x += w;
    }
    let height = y + row;
    (height <= f64::from(max_edge)).then_some(([width as u32, height as u32], uv))
}
