//! What cannot be done is said, and leaves no trace.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_voxel::{Control, Frame, LabelGrid};

use super::values::pool;
use super::{Case, DRAW, Trial, Violation};
use crate::{Changed, PredictError, Predictor};

/// A prediction stops when it was cancelled before it began, and at its next unit of work when it is cancelled from its
/// own progress report. What follows is as if nothing had been.
///
/// # Errors
/// [`Violation`] otherwise.
pub fn cancellation(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "cancellation", predictor, case };
    let all = case.object.points();
    let expected = trial.predict(&*trial.fresh(&case.labels)?, &all, DRAW)?;
    // Where it is stopped depends on the order of work; one thread has one order.
    pool(&trial, 1)?.install(|| {
        let mut bound = trial.bind()?;
        let stop = AtomicBool::new(true);
        let stopping = Control::none().with_cancel(&stop);
        let stopped = bound.update(&case.labels, Changed::Unknown, &stopping);
        trial.ensure(
            matches!(stopped, Err(PredictError::Cancelled)),
            format!("an update that was cancelled before it began gave {stopped:?}"),
        )?;
        trial.worked("update", bound.update(&case.labels, Changed::Unknown, &Control::none()))?;
        let mut out = vec![0.0; all.len() * case.object.channels()];
        let stopped = bound.predict(&all, DRAW, &mut out, &stopping);
        trial.ensure(
            matches!(stopped, Err(PredictError::Cancelled)),
            format!("a prediction that was cancelled before it began gave {stopped:?}"),
        )?;
        // From within: at the first report, and once half is done.
        for share in [u64::MAX, 2] {
            let stop = AtomicBool::new(false);
            let report = |done: u64, total: u64| {
                if done < total && done.saturating_mul(share) >= total {
                    stop.store(true, Ordering::Relaxed);
                }
            };
            let control = Control::none().with_cancel(&stop).with_progress(&report);
            let result = bound.predict(&all, DRAW, &mut out, &control);
            trial.ensure(
                !stop.load(Ordering::Relaxed) || matches!(result, Err(PredictError::Cancelled)),
                format!("a prediction that was cancelled on the way gave {result:?}"),
            )?;
        }
        let after = trial.predict(&*bound, &all, DRAW)?;
        trial.same("after cancelled predictions", &expected.0, &after.0)?;
        trial.ensure(expected.1.learned == after.1.learned, "cancelled predictions changed what is learned")
    })
}

/// Errors tell what is missing or wrong, and the predictor goes on as before.
///
/// # Errors
/// [`Violation`] otherwise.
pub fn errors(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    let trial = Trial { check: "errors", predictor, case };
    let none = Control::none();
    let channels = case.object.channels();
    let names = |what: &str, result: Result<(), PredictError>, words: &[&str]| match result {
        Err(PredictError::Invalid(fault)) => {
            let text = fault.to_string();
            trial.ensure(
                words.iter().all(|w| text.contains(w)),
                format!("{what}: the error {text:?} does not name {words:?}"),
            )
        }
        other => Err(trial.violation(format!("{what} gave {other:?}, not PredictError::Invalid"))),
    };
    let mut bound = trial.bind()?;
    let mut one = vec![0.0; channels];
    let early = bound.predict(&[0], DRAW, &mut one, &none).map(|_| ());
    names("predicting before an update", early, &["labels", "update"])?;

    trial.worked("update", bound.update(&case.labels, Changed::Unknown, &none))?;
    let expected = trial.values(&*bound)?;
    let mut long = vec![0.0; channels + 1];
    let length = bound.predict(&[0], DRAW, &mut long, &none).map(|_| ());
    names("an output of another length", length, &["output"])?;
    let past = case.object.surface().len() as u32;
    let point = bound.predict(&[past], DRAW, &mut one, &none).map(|_| ());
    names("a point past the surface", point, &["point", &past.to_string()])?;
    trial.same("after refused predictions", &expected, &trial.values(&*bound)?)?;

    let frame = case.object.frame();
    let shifted = frame.origin_mm().map(|v| v + 1.0);
    let moved =
        trial.worked("a frame", Frame::new(shifted, frame.pitch(), frame.size()).map_err(Into::into))?;
    names(
        "labels of another frame",
        bound.update(&LabelGrid::new(moved), Changed::Unknown, &none),
        &["labels", "frame"],
    )?;
    let materials = case.object.materials().len();
    if let Ok(unknown) = u8::try_from(materials + 1) {
        let mut labels = case.labels.clone();
        labels.set(case.object.surface().voxels()[0], unknown);
        names(
            "a label without a material",
            bound.update(&labels, Changed::Unknown, &none),
            &["label", &unknown.to_string()],
        )?;
    }
    trial.worked("an update after refused ones", bound.update(&case.labels, Changed::Tiles(&[]), &none))?;
    trial.same("after refused updates", &expected, &trial.values(&*bound)?)?;
    // Refusing is a predictor's right, but it must be the same word before and at binding.
    let (supports, binds) =
        (predictor.supports(&case.object).is_ok(), predictor.bind(Arc::clone(&case.object)).is_ok());
    trial.ensure(supports == binds, "supports and bind disagree")
}
