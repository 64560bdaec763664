//! The labels that a bound predictor holds, and what of them an update changes.

use pellucid_core::Control;
use pellucid_voxel::{LabelGrid, Tile};
use rayon::prelude::*;

use crate::{Changed, PredictError};

/// A copy of the labels of the last update.
#[derive(Default)]
pub(crate) struct KeptLabels {
    grid: Option<LabelGrid>,
    /// Whether the last update succeeded.
    current: bool,
}

/// What a predictor's tables must take in.
pub(crate) enum Update<'a> {
    /// All labels.
    All,
    /// The labels of these tiles, ascending.
    Tiles(&'a [u32]),
}

impl KeptLabels {
    /// The labels, where the last update succeeded.
    pub(crate) fn current(&self) -> Option<&LabelGrid> {
        self.grid.as_ref().filter(|_| self.current)
    }

    /// What a failed update leaves: no labels until the next one.
    pub(crate) fn forget(&mut self) {
        self.current = false;
    }

    /// Has `apply` take in what changed, and then keeps `labels`. The frame must be that of the labels before.
    pub(crate) fn update(
        &mut self,
        labels: &LabelGrid,
        changed: Changed<'_>,
        control: &Control<'_>,
        apply: impl FnOnce(Update<'_>) -> Result<(), PredictError>,
    ) -> Result<(), PredictError> {
        let was_current = std::mem::take(&mut self.current);
        control.check()?;
        let found;
        let tiles = match (&self.grid, changed) {
            (Some(_), Changed::Tiles(tiles)) if was_current && tiles.is_sorted() => tiles,
            (Some(before), _) => {
                found = differing(before, labels);
                &found
            }
            (None, _) => {
                apply(Update::All)?;
                self.grid = Some(labels.clone());
                self.current = true;
                return Ok(());
            }
        };
        // A table of mostly new tiles is made faster than mended.
        let most = 2 * tiles.len() > labels.tiles().len();
        apply(if most { Update::All } else { Update::Tiles(tiles) })?;
        let place = |[x, y, z]: [u32; 3]| {
            let [nx, ny, _] = labels.tile_dims();
            (z * ny + y) * nx + x
        };
        if let Some(grid) = &mut self.grid {
            grid.update_tiles(|at, _| {
                tiles.binary_search(&place(at)).is_ok().then(|| labels.tile(at).clone())
            });
        }
        self.current = true;
        Ok(())
    }
}

/// The tiles that are not stored alike, ascending.
fn differing(a: &LabelGrid, b: &LabelGrid) -> Vec<u32> {
    let same = |a: &Tile, b: &Tile| match (a, b) {
        (Tile::Constant(a), Tile::Constant(b)) => a == b,
        (Tile::Dense(a), Tile::Dense(b)) => a == b,
        _ => false,
    };
    let tiles = a.tiles().par_iter().zip(b.tiles()).enumerate();
    tiles.filter(|(_, (a, b))| !same(a, b)).map(|(i, _)| i as u32).collect()
}
