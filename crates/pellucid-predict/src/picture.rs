//! Colours for pictures out of few paths.

use pellucid_core::Control;
use pellucid_trace::{AssistOptions, Estimates, Tracer, Volume};
use pellucid_voxel::LabelGrid;

use crate::{MonteCarlo, Object, PredictError};

/// Takes most of the noise out of a value of every surface voxel, `[point][value]`, that two independent halves of few
/// paths gave: by regression on the materials below, patch by patch (see [`Tracer::assist`]). Values are radiances or
/// linear in them; `leading_channels[k]` is the channel whose coefficients explain value k. Where a predictor without
/// noise gives a `guess` of the values, only its error is sought. Biased: for pictures, not for figures.
///
/// # Errors
/// [`PredictError::Invalid`] when labels, halves and object do not fit together, [`PredictError::Cancelled`].
pub fn without_noise<const N: usize>(
    object: &Object,
    labels: &LabelGrid,
    leading_channels: [usize; N],
    halves: [&[[f32; N]]; 2],
    guess: Option<&[[f32; N]]>,
    control: &Control<'_>,
) -> Result<Vec<[f32; N]>, PredictError> {
    let volume = Volume::new(labels, object.surface(), control)?;
    let options = MonteCarlo::new(1)?.trace_options(object, 0)?;
    let tracer = Tracer::new(&volume, object.materials(), options)?;
    let mut values = vec![[0.0; N]; object.surface().len()];
    let (halves, guess) = (halves.map(|half| half.as_flattened()), guess.map(|guess| guess.as_flattened()));
    let estimates = Estimates { features_of: &leading_channels, halves, guess };
    let assist = AssistOptions::default();
    let out = values.as_flattened_mut();
    tracer.assist(&object.points(), &estimates, &assist, out, control)?;
    Ok(values)
}
