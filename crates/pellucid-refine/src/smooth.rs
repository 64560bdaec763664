//! Averages over neighbouring surface voxels.

use pellucid_voxel::Surface;
use rayon::prelude::*;

/// The Gaussian is cut off at this many standard deviations.
const CUT_OFF: f64 = 2.0;
/// Neighbours whose normals differ by more than this cosine lie around an edge or on the far side
/// of a thin part.
const SAME_SIDE: f32 = 0.5;

/// Gaussian mean of `values` over the surface voxels around each, with standard deviation
/// `sigma_mm`, leaving out those that face another way.
pub(crate) fn smooth(surface: &Surface, values: &[[f32; 3]], sigma_mm: f64) -> Vec<[f32; 3]> {
    let pitch = surface.frame().pitch().mm();
    let reach = pitch.map(|p| (CUT_OFF * sigma_mm / p).floor().min(64.0) as i64);
    let mut offsets = Vec::new();
    for dz in -reach[2]..=reach[2] {
        for dy in -reach[1]..=reach[1] {
            for dx in -reach[0]..=reach[0] {
                let d = [dx, dy, dz];
                let square: f64 = (0..3).map(|a| (d[a] as f64 * pitch[a]).powi(2)).sum();
                if square <= (CUT_OFF * sigma_mm).powi(2) {
                    offsets.push((d, (-0.5 * square / (sigma_mm * sigma_mm)).exp() as f32));
                }
            }
        }
    }
    let size = surface.frame().size();
    let normals = surface.normals();
    let voxels = surface.voxels().par_iter().zip(normals).with_min_len(256);
    voxels
        .map(|(voxel, normal)| {
            let (mut sum, mut total) = ([0.0f32; 3], 0.0f32);
            for (d, weight) in &offsets {
                let at: [i64; 3] = std::array::from_fn(|a| i64::from(voxel[a]) + d[a]);
                if (0..3).any(|a| at[a] < 0 || at[a] >= i64::from(size[a])) {
                    continue;
                }
                let Some(j) = surface.index_of(at.map(|v| v as u32)) else { continue };
                let other = normals[j as usize];
                let cosine: f32 = (0..3).map(|a| normal[a] * other[a]).sum();
                if cosine < SAME_SIDE {
                    continue;
                }
                total += weight;
                for c in 0..3 {
                    sum[c] += weight * values[j as usize][c];
                }
            }
            // The voxel itself always counts, so the total is at least its weight of 1.
            sum.map(|s| s / total)
        })
        .collect()
}
