//! What the judge reports.

use pellucid_core::ErrorStats;
use serde::{Deserialize, Serialize};

use super::{ColorClass, ErrorShares, MeanColor};

/// CIEDE2000 errors of what is shown; the first four in JSON are those to the printable target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Errors {
    /// To the printable target.
    #[serde(flatten)]
    pub printable: ErrorStats,
    /// To the target as given, not mapped to what can be printed.
    pub raw: ErrorStats,
    /// Mean CIEDE2000 that the remaining Monte Carlo noise makes by itself: half the mean difference of the two halves
    /// of the passes. Contained in per-voxel errors; taken out of smoothed ones.
    pub noise: f64,
}

/// Errors and mean colours of the surface voxels whose target is of one class of colours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ClassErrors {
    /// The class.
    pub class: ColorClass,
    /// Share of the surface voxels, 0 to 1.
    pub share: f64,
    /// Mean CIEDE2000 to the printable target at 0.1 mm.
    pub mean: f64,
    /// Its 95 % quantile.
    pub p95: f64,
    /// Mean CIEDE2000 to the target as given at 0.1 mm.
    pub raw: f64,
    /// Mean colour of the target as given, at 0.2 mm.
    #[serde(default)]
    pub target: MeanColor,
    /// Mean colour of the printable target, at 0.2 mm.
    #[serde(default)]
    pub printable: MeanColor,
    /// Mean colour of what is shown, at 0.2 mm. What noise adds to chroma is taken out: its energy across the hue, as
    /// from errors. Of neutrals some of it stays.
    #[serde(default)]
    pub shown: MeanColor,
}

/// How much of the target's local contrast is shown: L\* at 0.1 mm less its mean over about 1 mm of surface, where the
/// target's is at least [`Sharpness::LEAST_CONTRAST`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Sharpness {
    /// Regression slope, through zero, of the shown contrast on the printable target's: 1 is all of it, less is blurred.
    /// `None` where the target has no edges.
    pub slope: Option<f64>,
    /// The same on the target as given.
    pub raw: Option<f64>,
    /// Share of the surface voxels at edges of the printable target, 0 to 1.
    pub edges: f64,
}

impl Sharpness {
    /// Contrast in L\* from which a place counts as an edge.
    pub const LEAST_CONTRAST: f32 = 3.0;
}

/// How well some labels show their target.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct StateErrors {
    /// Of single surface voxels, a random few.
    pub voxel: Errors,
    /// Of all, prediction and target alike smoothed by a Gaussian of 0.045 mm over the surface.
    pub at_0_045_mm: Errors,
    /// By 0.1 mm: about what a print's jetting and a viewer at 300 mm blur.
    pub at_0_1_mm: Errors,
    /// By 0.2 mm.
    pub at_0_2_mm: Errors,
    /// Contrast across the target's edges.
    pub sharpness: Sharpness,
    /// Errors at 0.1 mm by the target's colour; classes without voxels are left out.
    #[serde(rename = "colour_classes")]
    pub color_classes: Vec<ClassErrors>,
    /// Where the error at 0.1 mm to the target as given sits.
    #[serde(default)]
    pub shares: ErrorShares,
    /// Surface voxels in `voxel`.
    pub points: u64,
    /// Predictions of each of them.
    pub point_passes: u32,
    /// Predictions of every surface voxel.
    pub surface_passes: u32,
    /// Paths traced in all.
    pub paths: u64,
}

/// Before and after.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// The halftone before the first correction.
    pub unrefined: StateErrors,
    /// The labels to print.
    pub refined: StateErrors,
}

impl Evaluation {
    /// Share of the mean per-voxel error that refining took away; 0 where there was none.
    pub fn reduction(&self) -> f64 {
        match self.unrefined.voxel.printable.mean {
            0.0 => 0.0,
            before => 1.0 - self.refined.voxel.printable.mean / before,
        }
    }
}
