//! The fourth artefact: what fresh paths say of the labels before and after, and what they look like.

use pellucid_core::Control;
use pellucid_predict::Predictor;
use pellucid_proof::{Picture, View, Visibility};
use pellucid_refine::{Evaluation, Judge, Judgement, PredictionError};
use pellucid_voxel::LabelGrid;

use crate::job::{Aimed, Refined};
use crate::stage::Stage;
use crate::workspace::JUDGED;
use crate::{Monitor, PrintError, PrintJob, Workspace, predictors};

/// Judged labels.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Judged {
    /// Errors before and after.
    pub evaluation: Evaluation,
    /// How far the network alone is off on the labels to print; absent with the path tracer, whose only error is
    /// noise.
    pub prediction: Option<PredictionError>,
    /// Appearance in each view of the proof.
    pub views: Vec<ProofView>,
}

/// What one view of the proof shows; colours are media-relative linear RGB.
#[derive(Clone, Debug)]
pub struct ProofView {
    /// The view's name.
    pub name: String,
    /// Target, unrefined and refined appearance.
    pub pictures: [Picture; 3],
}
