//! Errors of predictions on a labelled set.

use std::error::Error;

use pellucid_core::{ErrorStats, NoisyScore};
use pellucid_stencil::FirstFlight;
use pellucid_voxel::Control;

use super::set::LabelledSet;
use crate::{DatasetError, ShapeClass};

/// Samples that are predicted at a time.
const CHUNK: usize = 512;

/// Errors in linear radiance of some samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Errors {
    /// Root mean square error and bias (prediction less label), the labels' own noise taken out.
    pub score: NoisyScore,
    /// Distribution of the absolute differences, the labels' noise included.
    pub absolute: ErrorStats,
}

/// Errors of a predictor on a set, and on parts of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// All samples.
    pub whole: Errors,
    /// Those of each shape family that the set holds, in the order in which the families first occur in the split.
    pub classes: Vec<(ShapeClass, Errors)>,
    /// Those of each channel.
    pub channels: Vec<Errors>,
}

/// Predicts a set and compares with its labels. `predict` takes stencils ordered
/// `[sample][level][z][y][x][sigma_s, sigma_a]` in 1/mm, [`STENCIL_VALUES`](crate::STENCIL_VALUES) a sample, with
/// the samples' first flights, and writes a radiance a sample; a network's [`radiance`] does. Progress counts samples.
///
/// [`radiance`]: https://docs.rs/pellucid-rpnn/latest/pellucid_rpnn/struct.Inference.html#method.radiance
///
/// # Errors
/// [`DatasetError::Predictor`] with what `predict` says; [`DatasetError::Cancelled`]; [`DatasetError::Invalid`] when
/// a prediction is not finite.
pub fn judge(
    set: &LabelledSet,
    mut predict: impl FnMut(&[f32], &[FirstFlight], &mut [f32]) -> Result<(), Box<dyn Error + Send + Sync>>,
    control: &Control<'_>,
) -> Result<Judgement, DatasetError> {
    let predicted = set.predictions(CHUNK, control, |stencils, flights, out| {
        predict(stencils, flights, out).map_err(DatasetError::Predictor)
    })?;
    Judgement::of(set, &predicted)
}

impl Judgement {
    /// Compares predictions of a set, a value a sample, with its labels.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] when there is another number of predictions, none at all, or one that is not finite.
    pub fn of(set: &LabelledSet, predicted: &[f32]) -> Result<Self, DatasetError> {
        if predicted.len() != set.len() || set.is_empty() {
            let reason = format!(
                "{} for {} samples; one each, of one at least, is needed",
                predicted.len(),
                set.len()
            );
            return Err(DatasetError::invalid("predictions", reason));
        }
        if let Some(i) = predicted.iter().position(|v| !v.is_finite()) {
            return Err(DatasetError::invalid("predictions", format!("{} for sample {i}", predicted[i])));
        }
        let mut classes: Vec<ShapeClass> = Vec::new();
        for volume in 0..set.volumes() {
            let class = set.class(volume * set.per_volume());
            if !classes.contains(&class) {
                classes.push(class);
            }
        }
        let errors = |wanted: &dyn Fn(usize) -> bool| Errors::of(set, predicted, wanted);
        Ok(Self {
            whole: errors(&|_| true),
            classes: classes.into_iter().map(|class| (class, errors(&|i| set.class(i) == class))).collect(),
            channels: (0..set.channels()).map(|c| errors(&|i| set.channel(i) == c)).collect(),
        })
    }
}

impl Errors {
    fn of(set: &LabelledSet, predicted: &[f32], wanted: &dyn Fn(usize) -> bool) -> Self {
        let mut score = NoisyScore::default();
        let mut sizes = Vec::new();
        for i in (0..set.len()).filter(|&i| wanted(i)) {
            let difference = f64::from(predicted[i]) - f64::from(set.radiance()[i]);
            score.add_difference(difference, f64::from(set.std_error()[i]).powi(2));
            sizes.push(difference.abs() as f32);
        }
        Self { score, absolute: ErrorStats::of(sizes) }
    }
}
