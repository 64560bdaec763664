//! Mirror images and the eight octant views.
//!
//! Octant `o` has bit 0 set when it is mirrored along x, bit 1 along y, bit 2 along z. It holds
//! the cells from one corner of the level to the middle inclusive, so neighbours share the middle
//! rows; a mirrored axis is read from the far end. Index 0 of an octant's axis is the outermost
//! cell, the last index the cell of the point. Mirroring a descriptor along an axis exchanges
//! octants whose numbers differ in that axis' bit and leaves their content in place.

use crate::StencilSpec;

/// Number of octants.
pub const OCTANTS: usize = 8;

impl StencilSpec {
    /// Cells of an octant along `[x, y, z]`: 3 x 2 x 5 in the paper's stencil.
    pub fn octant_cells(&self) -> [usize; 3] {
        self.cells().map(|n| n / 2 + 1)
    }

    /// For each cell of octant `octant` in order `[z][y][x]`, its position within the level.
    ///
    /// ```
    /// let spec = pellucid_stencil::StencilSpec::paper();
    /// let (low, high) = (spec.octant_index(0), spec.octant_index(7));
    /// assert_eq!((low[0], high[0]), (0, 134)); // opposite corners
    /// assert_eq!((low[29], high[29]), (67, 67)); // both end at the point's cell
    /// ```
    pub fn octant_index(&self, octant: usize) -> Vec<usize> {
        let [nx, ny, nz] = self.octant_cells();
        let mut index = Vec::with_capacity(nx * ny * nz);
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    index.push(self.mirrored_index([x, y, z], octant));
                }
            }
        }
        index
    }

    /// Position within the level of `cell` mirrored along the axes whose bits are set in `axes`.
    pub fn mirrored_index(&self, cell: [usize; 3], axes: usize) -> usize {
        let n = self.cells();
        self.cell_index(std::array::from_fn(
            |a| if axes >> a & 1 == 1 { n[a] - 1 - cell[a] } else { cell[a] },
        ))
    }

    /// Copies levels ordered `[level][cell][feature]` into octant views ordered
    /// `[level][octant][cell][feature]`. Works for whole batches: the leading axes are free.
    ///
    /// # Panics
    /// When the slices do not hold the same whole number of levels.
    pub fn octant_views<T: Copy>(&self, features: usize, levels: &[T], views: &mut [T]) {
        let cells = self.cells_per_level();
        let index: Vec<usize> = (0..OCTANTS).flat_map(|o| self.octant_index(o)).collect();
        let (from, to) = (cells * features, index.len() * features);
        assert!(
            features > 0 && levels.len().is_multiple_of(from) && views.len() == levels.len() / from * to,
            "{} values do not make octant views of {}",
            views.len(),
            levels.len()
        );
        for (level, view) in levels.chunks_exact(from).zip(views.chunks_exact_mut(to)) {
            for (cell, &at) in view.chunks_exact_mut(features).zip(&index) {
                cell.copy_from_slice(&level[at * features..(at + 1) * features]);
            }
        }
    }

    /// Mirrors levels ordered `[level][cell][feature]` in place along the axes whose bits are set
    /// in `axes`. Works for whole batches: the leading axes are free.
    ///
    /// # Panics
    /// When `levels` is not a whole number of levels.
    pub fn mirror<T: Copy>(&self, features: usize, axes: usize, levels: &mut [T]) {
        let cells = self.cells_per_level();
        assert!(features > 0 && levels.len().is_multiple_of(cells * features), "needs whole levels");
        let [nx, ny, nz] = self.cells();
        for level in levels.chunks_exact_mut(cells * features) {
            for z in 0..nz {
                for y in 0..ny {
                    for x in 0..nx {
                        let (a, b) = (self.cell_index([x, y, z]), self.mirrored_index([x, y, z], axes));
                        if a < b {
                            let (low, high) = level.split_at_mut(b * features);
                            low[a * features..(a + 1) * features].swap_with_slice(&mut high[..features]);
                        }
                    }
                }
            }
        }
    }
}
