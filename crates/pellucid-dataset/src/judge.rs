//! Errors of predictions on a labelled set.

use pellucid_core::{ErrorStats, NoisyScore};
use serde::{Deserialize, Serialize};

use crate::{DatasetError, LabelledSet, ShapeClass};

/// Errors in linear radiance over some samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Score {
    /// Number of samples.
    pub samples: u64,
    /// Root of the mean squared difference from the labels, the labels' own noise taken out.
    pub rmse: f64,
    /// The same with the labels' noise.
    pub raw_rmse: f64,
    /// Mean of prediction less label.
    pub bias: f64,
    /// 95 % quantile of the absolute difference, the labels' noise included.
    pub p95: f64,
}

/// A [`Score`] of one family of shapes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShapeScore {
    /// The family.
    pub shape: ShapeClass,
    /// Its samples' errors.
    #[serde(flatten)]
    pub score: Score,
}

/// Errors of predictions on a labelled set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Judgement {
    /// The recipe's name.
    pub recipe: String,
    /// The split's name.
    pub split: String,
    /// Over all samples.
    pub all: Score,
    /// By family of shapes, in the order of [`ShapeClass::ALL`]; families without samples are left out.
    pub by_shape: Vec<ShapeScore>,
}

/// Compares one predicted radiance a sample, in the set's order, with the labels.
///
/// # Errors
/// [`DatasetError::Invalid`] for another number of predictions than samples, none, or one that is not finite.
pub fn judge(set: &LabelledSet, predicted: &[f32]) -> Result<Judgement, DatasetError> {
    if predicted.len() != set.len() || set.is_empty() {
        return Err(DatasetError::invalid(
            "predictions",
            format!("{} for {} samples; one each, of one at least, is needed", predicted.len(), set.len()),
        ));
    }
    if let Some(at) = predicted.iter().position(|v| !v.is_finite()) {
        return Err(DatasetError::invalid("predictions", format!("that of sample {at} is not finite")));
    }
    let header = set.header();
    let by_shape = ShapeClass::ALL.iter().filter_map(|&shape| {
        let samples: Vec<usize> = (0..set.len()).filter(|&i| set.class(i) == shape).collect();
        (!samples.is_empty()).then(|| ShapeScore { shape, score: score(set, predicted, samples.into_iter()) })
    });
    Ok(Judgement {
        recipe: header.recipe.name.clone(),
        split: header.split.clone(),
        all: score(set, predicted, 0..set.len()),
        by_shape: by_shape.collect(),
    })
}

fn score(set: &LabelledSet, predicted: &[f32], samples: impl Iterator<Item = usize>) -> Score {
    let mut errors = NoisyScore::default();
    let mut absolute = Vec::new();
    for i in samples {
        let difference = f64::from(predicted[i]) - f64::from(set.radiance()[i]);
        errors.add_difference(difference, f64::from(set.std_error()[i]).powi(2));
        absolute.push(difference.abs() as f32);
    }
    Score {
        samples: errors.count(),
        rmse: errors.rmse(),
        raw_rmse: errors.raw_rmse(),
        bias: errors.bias(),
        p95: ErrorStats::of(absolute).p95,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Recipe, SetHeader, Shard, Split};
    use pellucid_core::{Cancelled, Control, Domain, random};
    use pellucid_voxel::{MaterialTable, Pitch};
    use std::sync::atomic::AtomicBool;

    /// Two families of small solids, labelled with few paths.
    fn header() -> SetHeader {
        let split = Split {
            name: "test".into(),
            volumes: 6,
            points: 9,
            spp: 16,
            std_error: None,
            shapes: vec![(ShapeClass::Sphere, 1.0), (ShapeClass::Cube, 1.0)],
            density: 1.0,
        };
        let recipe = Recipe {
            name: "judged".into(),
            seed: 4,
            pitch: Pitch::new([0.08, 0.09, 0.06]).unwrap(),
            size_mm: [1.0, 1.5],
            large_mm: 2.0,
            large_share: 0.0,
            refractive_index: 1.5,
            splits: vec![split],
        };
        SetHeader { recipe, split: "test".into(), materials: MaterialTable::cmykw(), shard: Shard::WHOLE }
    }

    #[test]
    fn a_set_labelled_in_memory_is_the_one_of_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let none = Control::none();
        let path = crate::generate(folder.path(), &header(), &none).unwrap();
        assert_eq!(LabelledSet::label(&header(), &none).unwrap(), LabelledSet::load(&[path], &none).unwrap());
        let stop = AtomicBool::new(true);
        let error = LabelledSet::label(&header(), &none.with_cancel(&stop)).unwrap_err();
        assert!(matches!(error, DatasetError::Cancelled));
    }

    #[test]
    fn planted_errors_are_found_by_shape() {
        let set = LabelledSet::label(&header(), &Control::none()).unwrap();
        let sphere = |i: usize| set.class(i) == ShapeClass::Sphere;
        assert!((0..set.len()).any(sphere) && !(0..set.len()).all(sphere), "both families are drawn");
        // Labels of known noise about which predictions are off by as much, and by a bias that the shape sets.
        let predicted: Vec<f32> = (0..set.len())
            .map(|i| {
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                set.radiance()[i] + sign * set.std_error()[i] + if sphere(i) { 0.5 } else { -0.25 }
            })
            .collect();
        let judgement = judge(&set, &predicted).unwrap();
        assert_eq!(judgement.by_shape.iter().map(|s| s.score.samples).sum::<u64>(), set.len() as u64);
        assert_eq!(judgement.all.samples, set.len() as u64);
        for ShapeScore { shape, score } in &judgement.by_shape {
            let planted = if *shape == ShapeClass::Sphere { 0.5 } else { -0.25 };
            let of = |i: &usize| set.class(*i) == *shape;
            let samples: Vec<usize> = (0..set.len()).filter(of).collect();
            let mean =
                |f: &dyn Fn(usize) -> f64| samples.iter().map(|&i| f(i)).sum::<f64>() / samples.len() as f64;
            let difference = |i: usize| f64::from(predicted[i]) - f64::from(set.radiance()[i]);
            let noise = mean(&|i| f64::from(set.std_error()[i]).powi(2));
            let squares = mean(&|i| difference(i).powi(2));
            assert!((score.bias - mean(&difference)).abs() < 1e-12);
            assert!((score.rmse - (squares - noise).sqrt()).abs() < 1e-12);
            assert!((score.raw_rmse - squares.sqrt()).abs() < 1e-12 && score.raw_rmse > score.rmse);
            assert!((score.bias - planted).abs() < 0.1 && (score.rmse - planted.abs()).abs() < 0.1);
            assert!(score.p95 >= score.rmse);
        }
    }

    #[test]
    fn predictions_are_asked_for_in_order() {
        let set = LabelledSet::label(&header(), &Control::none()).unwrap();
        let mut seen = 0;
        let predicted = set
            .predictions(7, &Control::none(), |stencils, out| {
                let mut own = vec![0.0; stencils.len()];
                set.stencils(seen, &mut own);
                assert_eq!(own, stencils);
                for (k, out) in out.iter_mut().enumerate() {
                    *out = random::uniform(1, Domain::new("p"), (seen + k) as u64, 0) as f32;
                }
                seen += out.len();
                Ok::<_, Cancelled>(())
            })
            .unwrap();
        assert_eq!(seen, set.len());
        let wanted = |i: usize| random::uniform(1, Domain::new("p"), i as u64, 0) as f32;
        assert!(predicted.iter().enumerate().all(|(i, &v)| v == wanted(i)));
    }

    #[test]
    fn predictions_that_do_not_fit_are_refused() {
        let set = LabelledSet::label(&header(), &Control::none()).unwrap();
        let mut predicted = vec![0.5; set.len()];
        assert!(matches!(judge(&set, &predicted[1..]), Err(DatasetError::Invalid { .. })));
        predicted[3] = f32::NAN;
        assert!(judge(&set, &predicted).unwrap_err().to_string().contains("sample 3"));
    }
}
