//! Which stencils a change of some tiles touches.

use pellucid_voxel::{LabelGrid, TILE};

use crate::{StencilError, StencilSpec};

/// A set of changed tiles that tells, for any box of voxels, whether it meets one of them.
pub struct ChangedTiles {
    grid_size: [u32; 3],
    dims: [usize; 3],
    /// Changed tiles before each tile corner, ordered `[z][y][x]` over one more corner than tiles.
    sums: Vec<u32>,
}

impl ChangedTiles {
    /// The tiles at positions `changed` of [`LabelGrid::tiles`], as
    /// [`LabelGrid::update_tiles`] returns them.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when a position lies past the grid's tiles.
    pub fn new(grid: &LabelGrid, changed: &[u32]) -> Result<Self, StencilError> {
        let dims = grid.tile_dims().map(|d| d as usize);
        let [nx, ny, nz] = dims.map(|d| d + 1);
        let mut sums = vec![0u32; nx * ny * nz];
        for &tile in changed {
            let tile = tile as usize;
            if tile >= grid.tiles().len() {
                return Err(StencilError::invalid(
                    "changed tiles",
                    format!("{tile} of a grid with {} tiles", grid.tiles().len()),
                ));
            }
            let t = [tile % dims[0], tile / dims[0] % dims[1], tile / dims[0] / dims[1]];
            sums[((t[2] + 1) * ny + t[1] + 1) * nx + t[0] + 1] = 1;
        }
        for (stride, count) in [(1, nx), (nx, ny), (nx * ny, nz)] {
            for at in stride..sums.len() {
                if at / stride % count > 0 {
                    sums[at] += sums[at - stride];
                }
            }
        }
        Ok(Self { grid_size: grid.size(), dims, sums })
    }

    /// Size of the grid that the tiles belong to.
    pub(crate) fn grid_size(&self) -> [u32; 3] {
        self.grid_size
    }

    /// The first level, counted from 0, of a point's stencil whose boxes meet a changed tile: as
    /// they are nested, all further ones do too. [`StencilSpec::levels`] when none does.
    pub fn first_level(&self, spec: &StencilSpec, point: [u32; 3]) -> usize {
        (0..spec.levels()).find(|&level| self.meets(spec, level, point)).unwrap_or(spec.levels())
    }

    fn meets(&self, spec: &StencilSpec, level: usize, point: [u32; 3]) -> bool {
        let range = |a: usize| {
            let reach = i64::from(spec.cell_edge(level)) * spec.cells()[a] as i64 / 2;
            let tile = |v: i64| v.div_euclid(TILE as i64).clamp(0, self.dims[a] as i64) as usize;
            let p = i64::from(point[a]);
            [tile(p - reach), tile(p + reach + TILE as i64)]
        };
        let (x, y, z) = (range(0), range(1), range(2));
        let [nx, ny, _] = self.dims.map(|d| d + 1);
        let mut count = 0u32;
        for step in 0..8usize {
            let (i, j, k) = (step & 1, step >> 1 & 1, step >> 2);
            let sum = self.sums[(z[k] * ny + y[j]) * nx + x[i]];
            count =
                if step.count_ones() % 2 == 1 { count.wrapping_add(sum) } else { count.wrapping_sub(sum) };
        }
        count > 0
    }
}
