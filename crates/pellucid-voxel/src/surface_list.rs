//! The list of surface voxels with their normals, tile by tile.

use std::sync::atomic::AtomicU64;

use rayon::prelude::*;

use crate::grid::tile_coords;
use crate::normals::NormalEstimator;
use crate::surface_index::SurfaceIndex;
use crate::{Control, TILE, VoxelError};

/// Tiles of a layer that are estimated before their results are put in place.
const TILES_AT_ONCE: usize = 256;

/// Lists the surface voxels and estimates their normals.
pub(crate) fn estimate(
    estimator: &NormalEstimator<'_>,
    index: &SurfaceIndex,
    dims: [u32; 3],
    total: u64,
    control: &Control,
) -> Result<Listed, VoxelError> {
    let mut voxels = vec![[0; 3]; index.len()];
    let mut normals = vec![[0.0; 3]; index.len()];
    let done = AtomicU64::new(0);
    split_slabs(index, dims[2], &mut voxels, &mut normals).into_par_iter().try_for_each(
        |(tz, voxels, normals)| {
            let first = index.slab(tz).start;
            for tiles in index.slab_tiles(tz).chunks(TILES_AT_ONCE) {
                let estimated = tiles
                    .par_iter()
                    .map(|&i| {
                        control.check()?;
                        let points = tile_voxels(index, i, tile_coords(dims, i));
                        let normals = estimator.tile(tile_coords(dims, i), &points);
                        control.advance(&done, 1, total);
                        Ok((points, normals))
                    })
                    .collect::<Result<Vec<_>, VoxelError>>()?;
                for (points, tile_normals) in estimated {
                    for ((position, voxel), normal) in points.into_iter().zip(tile_normals) {
                        voxels[position as usize - first] = voxel;
                        normals[position as usize - first] = normal;
                    }
                }
            }
            Ok::<(), VoxelError>(())
        },
    )?;
    Ok((voxels, normals))
}

/// Surface voxels and their normals.
type Listed = (Vec<[u32; 3]>, Vec<[f32; 3]>);

type Slab<'a> = (usize, &'a mut [[u32; 3]], &'a mut [[f32; 3]]);

/// Cuts the outputs into the parts that belong to each layer of tiles.
fn split_slabs<'a>(
    index: &SurfaceIndex,
    slabs: u32,
    mut voxels: &'a mut [[u32; 3]],
    mut normals: &'a mut [[f32; 3]],
) -> Vec<Slab<'a>> {
    (0..slabs as usize)
        .map(|tz| {
            let count = index.slab(tz).len();
            let (v, rest) = std::mem::take(&mut voxels).split_at_mut(count);
            voxels = rest;
            let (n, rest) = std::mem::take(&mut normals).split_at_mut(count);
            normals = rest;
            (tz, v, n)
        })
        .collect()
}

/// A tile's surface voxels with their list positions.
fn tile_voxels(index: &SurfaceIndex, tile: usize, t: [u32; 3]) -> Vec<(u32, [u32; 3])> {
    let [x0, y0, z0] = t.map(|v| v * TILE as u32);
    let mut points = Vec::new();
    for (row, (first, mask)) in index.tile_rows(tile).into_iter().flatten().enumerate() {
        let (y, z) = (y0 + (row % TILE) as u32, z0 + (row / TILE) as u32);
        let mut bits = mask;
        let mut position = first;
        while bits != 0 {
            points.push((position, [x0 + bits.trailing_zeros(), y, z]));
            position += 1;
            bits &= bits - 1;
        }
    }
    points
}
