//! A network's errors on labelled sets.

use pellucid_core::{Control, Fault};
use pellucid_dataset::{Judgement, LabelledSet, Recipe, judge};
use pellucid_rpnn::file::Provenance;
use pellucid_rpnn::{Inference, Precision, Weights};

use super::TrainingError;

/// Samples predicted at a time: 40 MB of stencils.
const CHUNK: usize = 4096;

/// Predicts a labelled set with a network and compares with the labels. Progress counts samples.
///
/// Sets of other densities than the network was trained on are judged too: that is what they are for.
///
/// # Errors
/// [`TrainingError::Unsupported`] for a set of another pitch or refractive index than the network was trained for;
/// [`TrainingError::Rpnn`], [`TrainingError::Dataset`], [`TrainingError::Cancelled`].
pub fn judge_network(
    weights: &Weights,
    provenance: &Provenance,
    precision: Precision,
    set: &LabelledSet,
    control: &Control<'_>,
) -> Result<Judgement, TrainingError> {
    check_trained_for(provenance, &set.header().recipe)?;
    let mut inference = Inference::new(weights, provenance.form, precision)?;
    let predicted = set.predictions(CHUNK, control, |stencils, out| {
        Ok::<_, TrainingError>(inference.radiance(stencils, out)?)
    })?;
    Ok(judge(set, &predicted)?)
}

fn check_trained_for(provenance: &Provenance, recipe: &Recipe) -> Result<(), TrainingError> {
    let unsupported = |subject: &str, reason: String| {
        let fault = Fault::new(subject, reason);
        Err(TrainingError::Unsupported(fault.remedy("generate a set of what the network was trained for")))
    };
    let (index, trained) = (recipe.refractive_index, provenance.refractive_index);
    if (index - trained).abs() > 1e-3 {
        return unsupported("refractive index", format!("{index}; the network was trained for {trained}"));
    }
    let (pitch, trained) = (recipe.pitch.mm(), provenance.pitch_mm);
    if pitch.iter().zip(trained).any(|(a, b)| (a / b - 1.0).abs() > 0.01) {
        return unsupported("pitch", format!("{pitch:?} mm; the network was trained for {trained:?} mm"));
    }
    Ok(())
}
