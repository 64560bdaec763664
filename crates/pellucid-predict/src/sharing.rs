//! How neighbouring points share what the network makes of their surroundings.

use crate::PredictError;

/// Which work of the network neighbouring points share; the study `sharing` measures what it costs in accuracy.
///
/// A network with an exact first flight is run for points some way apart, and the others take its outputs between them:
/// what follows the first collision varies slowly over the surface, and every point's own first flight is exact. A
/// network that gives radiance itself is run for every point.
///
/// Wherever it is run, what it makes of the coarse levels of the stencil can be taken between points still farther
/// apart, since coarse cells hardly differ between neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct Sharing {
    /// About how far apart in mm the points are for which a network with an exact first flight is run; 0 runs it for
    /// every point.
    pub spacing_mm: f64,
    /// Finest levels that every point it is run for has for itself, 1 to 9; 9 shares none.
    pub fine_levels: usize,
    /// About how far apart in mm the points are for which the other levels are read.
    pub coarse_mm: f64,
}

impl Default for Sharing {
    /// Every 0.25 mm; three levels of their own, the coarser ones every 0.75 mm.
    fn default() -> Self {
        Self { spacing_mm: 0.25, fine_levels: 3, coarse_mm: 0.75 }
    }
}

impl Sharing {
    /// Checks the documented ranges.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] otherwise.
    pub fn check(self) -> Result<(), PredictError> {
        for (field, value) in [("spacing_mm", self.spacing_mm), ("coarse_mm", self.coarse_mm)] {
            if !(0.0..=10.0).contains(&value) {
                return Err(PredictError::invalid(
                    format!("sharing, {field}"),
                    format!("{value}; 0 to 10 are possible"),
                ));
            }
        }
        if !(1..=9).contains(&self.fine_levels) {
            return Err(PredictError::invalid(
                "sharing, fine_levels",
                format!("{}; 1 to 9 are possible", self.fine_levels),
            ));
        }
        Ok(())
    }

    /// Whether some levels are shared.
    #[cfg(feature = "rpnn")]
    pub(crate) fn shares_levels(self) -> bool {
        self.fine_levels < 9
    }
}
