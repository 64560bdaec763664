//! Labels are brought up to date exactly.

use std::sync::atomic::AtomicBool;

use pellucid_voxel::Control;

use super::{Case, Trial, Violation};
use crate::{Changed, PredictError, Predictor};

/// Exact tiles, [`Changed::Unknown`] and a predictor bound anew come to the same values; the first update takes all
/// labels whatever it is told, and so does the one after a failure.
///
/// # Errors
/// [`Violation`] where bytes differ.
pub fn updates(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "updates", predictor, case };
    let none = Control::none();
    let (second, copy_first) = case.changed(&case.labels, 1);
    let (third, from_second) = case.changed(&second, 2);
    let expected = [&case.labels, &second, &third]
        .map(|labels| trial.fresh(labels).and_then(|bound| trial.values(&*bound)));
    let [first_values, second_values, third_values] = expected;
    let (first_values, second_values, third_values) = (first_values?, second_values?, third_values?);

    let mut told = trial.bind()?;
    trial.worked("the first update", told.update(&case.labels, Changed::Tiles(&[]), &none))?;
    trial.same("a first update of no tiles", &first_values, &trial.values(&*told)?)?;
    let mut untold = trial.fresh(&case.labels)?;
    for (labels, tiles, values) in
        [(&second, &copy_first, &second_values), (&third, &from_second, &third_values)]
    {
        trial.worked("an update of tiles", told.update(labels, Changed::Tiles(tiles), &none))?;
        trial.same("told which tiles changed", values, &trial.values(&*told)?)?;
        trial.worked("an update of no tiles", told.update(labels, Changed::Tiles(&[]), &none))?;
        trial.same("told that nothing changed", values, &trial.values(&*told)?)?;
        trial.worked("an update", untold.update(labels, Changed::Unknown, &none))?;
        trial.same("told nothing", values, &trial.values(&*untold)?)?;
    }
    // Back again, and on after a failure that the caller's next word does not cover.
    trial.worked("an update", told.update(&case.labels, Changed::Unknown, &none))?;
    trial.same("back at the first labels", &first_values, &trial.values(&*told)?)?;
    let stop = AtomicBool::new(true);
    let stopped = told.update(&second, Changed::Tiles(&copy_first), &none.with_cancel(&stop));
    trial.ensure(
        matches!(stopped, Err(PredictError::Cancelled)),
        format!("a cancelled update gave {stopped:?}"),
    )?;
    let mut out = vec![0.0; case.points.len() * case.object.channels()];
    let result = told.predict(&case.points, super::DRAW, &mut out, &none);
    trial.ensure(result.is_err(), "it predicted after an update that failed")?;
    trial.worked("an update", told.update(&third, Changed::Tiles(&from_second), &none))?;
    trial.same("after a failed update", &third_values, &trial.values(&*told)?)
}
