//! The geometry of the descriptor.

use crate::StencilError;

/// What the values of a level are multiplied by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LevelScale {
    /// Coefficients in 1/mm at every level.
    Raw,
    /// Level `k` times `2^(k - 1 - gamma)`: coefficients of the level shrunk to the size of the
    /// first (paper section 4.3), kept in range by `2^-gamma` (section 4.4 has gamma 6).
    Isometric {
        /// Within 0..=32.
        gamma: u32,
    },
}

/// The cells of the descriptor: `levels` boxes of `cells` cells, all centred on the centre of the
/// point's voxel. A cell of level `k` (1-based) is `2^(k-1)` voxels long on every axis and holds
/// the mean over its box; for `k > 1` its faces cut voxels in half.
///
/// Cells of a level are ordered `[z][y][x]`, x fastest.
///
/// ```
/// use pellucid_stencil::StencilSpec;
/// let spec = StencilSpec::paper();
/// assert_eq!((spec.cells(), spec.levels()), ([5, 3, 9], 9));
/// assert_eq!(spec.cells_per_level(), 135);
/// assert_eq!(spec.cell_index([2, 1, 4]), 67); // the cell around the point
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StencilSpec {
    cells: [usize; 3],
    levels: usize,
    scale: LevelScale,
}

impl StencilSpec {
    /// Most cells along one axis.
    pub const MAX_CELLS: usize = 31;
    /// Most levels: counts in eighths of a voxel stay below 2^28, so that their products with f32
    /// coefficients are exact in f64.
    pub const MAX_LEVELS: usize = 9;

    /// Checks and builds a spec with [`LevelScale::Raw`].
    ///
    /// # Errors
    /// [`StencilError::Invalid`] when a cell number is even or 0 or there is no level,
    /// [`StencilError::Unsupported`] past the limits above.
    pub fn new(cells: [usize; 3], levels: usize) -> Result<Self, StencilError> {
        if cells.iter().any(|n| n % 2 == 0) {
            return Err(StencilError::invalid(
                "cells",
                format!("{cells:?}; an odd number an axis centres the stencil on its point"),
            ));
        }
        if levels == 0 {
            return Err(StencilError::invalid("levels", "needs at least one"));
        }
        if cells.iter().any(|&n| n > Self::MAX_CELLS) || levels > Self::MAX_LEVELS {
            return Err(StencilError::unsupported(
                "stencil",
                format!(
                    "{levels} levels of {cells:?} cells; at most {} levels of {} cells an axis",
                    Self::MAX_LEVELS,
                    Self::MAX_CELLS
                ),
            ));
        }
        Ok(Self { cells, levels, scale: LevelScale::Raw })
    }

    /// The method's stencil: 9 levels of 5 x 3 x 9 cells (paper section 4.2), raw coefficients.
    pub const fn paper() -> Self {
        Self { cells: [5, 3, 9], levels: 9, scale: LevelScale::Raw }
    }

    /// The same cells with another scale.
    ///
    /// # Errors
    /// [`StencilError::Invalid`] for a gamma over 32.
    pub fn with_scale(self, scale: LevelScale) -> Result<Self, StencilError> {
        match scale {
            LevelScale::Isometric { gamma } if gamma > 32 => {
                Err(StencilError::invalid("gamma", format!("{gamma} must lie within 0 to 32")))
            }
            _ => Ok(Self { scale, ..self }),
        }
    }

    /// Cells along `[x, y, z]`, each odd.
    pub const fn cells(&self) -> [usize; 3] {
        self.cells
    }

    /// Number of levels.
    pub const fn levels(&self) -> usize {
        self.levels
    }

    /// What the values of a level are multiplied by.
    pub fn scale(&self) -> LevelScale {
        self.scale
    }

    /// Cells of one level.
    pub const fn cells_per_level(&self) -> usize {
        self.cells[0] * self.cells[1] * self.cells[2]
    }

    /// Cells of all levels.
    pub const fn cells_in_all(&self) -> usize {
        self.levels * self.cells_per_level()
    }

    /// Position of a cell `[x, y, z]` within its level.
    pub fn cell_index(&self, cell: [usize; 3]) -> usize {
        (cell[2] * self.cells[1] + cell[1]) * self.cells[0] + cell[0]
    }

    /// Voxels along a cell's edge at `level`, counted from 0.
    pub fn cell_edge(&self, level: usize) -> u32 {
        1 << level
    }

    /// Eighths of a voxel in a cell at `level`, counted from 0: the largest value of a count.
    pub fn full_count(&self, level: usize) -> u32 {
        8 << (3 * level)
    }

    /// The factor from a sum over eighths of a voxel to the value at `level`, counted from 0: a
    /// power of two.
    pub fn level_factor(&self, level: usize) -> f64 {
        let isometric = match self.scale {
            LevelScale::Raw => 0,
            LevelScale::Isometric { gamma } => level as i32 - gamma as i32,
        };
        f64::powi(2.0, isometric - 3 - 3 * level as i32)
    }
}
