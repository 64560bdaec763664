//! How much surface a grid has, and what memory that takes.

use rayon::prelude::*;

use crate::grid::tile_coords;
use crate::occupancy::surface_rows;
use crate::surface_index::SurfaceIndex;
use crate::{Cancelled, Control, LabelGrid, VoxelError};

/// How much surface a grid has.
#[derive(Clone, Copy, Default)]
pub(crate) struct SurfaceCount {
    /// Surface voxels.
    pub voxels: u64,
    /// Tiles that hold any.
    pub tiles: u64,
}

impl SurfaceCount {
    /// Counts in parallel, without memory.
    pub(crate) fn of(grid: &LabelGrid, control: &Control) -> Result<Self, Cancelled> {
        (0..grid.tiles().len())
            .into_par_iter()
            .with_min_len(64)
            .map(|i| {
                control.check()?;
                let rows = surface_rows(grid, tile_coords(grid.tile_dims(), i));
                Ok(rows.map_or_else(Self::default, |rows| Self {
                    voxels: rows.iter().map(|row| u64::from(row.count_ones())).sum(),
                    tiles: 1,
                }))
            })
            .try_reduce(Self::default, |a, b| {
                Ok(Self { voxels: a.voxels + b.voxels, tiles: a.tiles + b.tiles })
            })
    }

    /// Bytes of a [`Surface`](crate::Surface) of so many.
    pub(crate) fn bytes(self, tile_dims: [u32; 3]) -> u64 {
        let a_voxel = size_of::<[u32; 3]>() + size_of::<[f32; 3]>();
        self.voxels * a_voxel as u64 + SurfaceIndex::memory_of(tile_dims, self.tiles)
    }

    /// Refuses more than `max_bytes`, and tells what it would take.
    pub(crate) fn check(self, tile_dims: [u32; 3], max_bytes: u64) -> Result<(), VoxelError> {
        let needed = self.bytes(tile_dims);
        if needed <= max_bytes {
            return Ok(());
        }
        let gib = |bytes: u64| bytes as f64 / f64::from(1 << 30);
        Err(VoxelError::unsupported(
            "surface",
            format!(
                "{:.1} million surface voxels take {:.2} GiB of memory and {:.2} are allowed; print smaller, in parts \
                 or with a coarser pitch, or allow more (max_bytes)",
                self.voxels as f64 / 1e6,
                gib(needed),
                gib(max_bytes),
            ),
        ))
    }
}
