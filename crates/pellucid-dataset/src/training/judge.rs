//! A network's errors on labelled sets.

use crate::{Judgement, LabelledSet};
use pellucid_core::Control;
use pellucid_rpnn::{Inference, Precision, RpnnError, TrainedNetwork};

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
    network: &TrainedNetwork,
    precision: Precision,
    set: &LabelledSet,
    control: &Control<'_>,
) -> Result<Judgement, TrainingError> {
    let recipe = &set.header().recipe;
    network.provenance.check(recipe.pitch.mm(), recipe.refractive_index).map_err(|error| match error {
        RpnnError::Unsupported(fault) => {
            TrainingError::Unsupported(fault.remedy("generate a set of what the network was trained for"))
        }
        other => other.into(),
    })?;
    let mut inference = Inference::new(&network.weights, network.provenance.form, precision)?;
    let predicted = set.predictions(CHUNK, control, |stencils, flights, out| {
        Ok::<_, TrainingError>(inference.radiance(stencils, flights, out)?)
    })?;
    Ok(Judgement::of(set, &predicted)?)
}
