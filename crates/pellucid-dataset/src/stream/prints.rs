//! Volumes that the caller brings, among those of a recipe: prints as refinement leaves them.

use std::sync::Arc;

use pellucid_voxel::{LabelGrid, MaterialTable};
use rand_core::Rng;

use crate::volume::noise::unit;
use crate::{DatasetError, Recipe};

/// Purpose of the random numbers that choose a print.
const CHOICE: u64 = 8;

/// Prints to train on, and how often. Networks meet refined labels in the loop, so training should too.
#[derive(Clone, Debug)]
pub struct Prints {
    share: f64,
    grids: Arc<Vec<LabelGrid>>,
}

impl Prints {
    /// None.
    pub fn none() -> Self {
        Self { share: 0.0, grids: Arc::default() }
    }

    /// Takes a print instead of a volume of the recipe for a part `share` of the volumes, 0 to 1.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] when the share is out of range or positive without a print.
    pub fn new(grids: Vec<LabelGrid>, share: f64) -> Result<Self, DatasetError> {
        if !(0.0..=1.0).contains(&share) {
            return Err(DatasetError::invalid(
                "share of prints",
                format!("{share}; it must lie within 0 to 1"),
            ));
        }
        if share > 0.0 && grids.is_empty() {
            return Err(DatasetError::invalid("prints", "there are none to take a share of"));
        }
        Ok(Self { share, grids: Arc::new(grids) })
    }

    /// Number of prints.
    pub fn len(&self) -> usize {
        self.grids.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.grids.is_empty()
    }

    /// Checks that the prints have a recipe's pitch and materials, and surface.
    pub(super) fn check(&self, recipe: &Recipe, materials: &MaterialTable) -> Result<(), DatasetError> {
        for (i, grid) in self.grids.iter().enumerate() {
            let invalid = |reason: String| Err(DatasetError::invalid(format!("print {i}"), reason));
            let (own, asked) = (grid.frame().pitch().mm(), recipe.pitch.mm());
            if own.iter().zip(asked).any(|(a, b)| (a / b - 1.0).abs() > 0.01) {
                return invalid(format!("has voxels of {own:?} mm, the recipe of {asked:?}"));
            }
            let histogram = grid.histogram();
            match histogram.iter().rposition(|&n| n > 0) {
                Some(label) if label > materials.len() => {
                    return invalid(format!("holds label {label} of {} materials", materials.len()));
                }
                Some(0) | None => return invalid("is all air".into()),
                Some(_) => {}
            }
        }
        Ok(())
    }

    /// The print that takes the place of volume `i`, if one does.
    pub(super) fn instead_of(&self, seed: u64, i: u64) -> Option<&LabelGrid> {
        let mut rng = crate::recipe::draw::rng(seed, CHOICE, i);
        let chosen = unit(rng.next_u64()) < self.share;
        chosen.then(|| &self.grids[(rng.next_u64() % self.grids.len() as u64) as usize])
    }
}
