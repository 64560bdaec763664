//! What every predictor must hold, as a suite that tests run.
//!
//! [`check`] runs all of it; each part is a function of its own. They are given a [`Case`]: an object of one's own, or
//! one of [`Case::planted`].
//!
//! ```
//! # #[cfg(feature = "mc")] {
//! use pellucid_predict::MonteCarlo;
//! use pellucid_predict::conformance::{self, Case};
//!
//! let case = Case::planted(1).unwrap();
//! conformance::repetition(&MonteCarlo::new(1).unwrap(), &case).unwrap();
//! # }
//! ```

mod case;
mod errors;
mod gradients;
mod learning;
mod updates;
mod values;

use std::sync::Arc;

use pellucid_voxel::{Control, LabelGrid};

use crate::{BoundPredictor, Changed, Diagnostics, Draw, Pass, PredictError, Predictor};

pub use case::Case;
pub use errors::{cancellation, errors};
pub use gradients::gradients;
pub use learning::learning;
pub use updates::updates;
pub use values::{draws, effort, order, repetition, shards, threads};

/// How a predictor breaks its contract.
#[derive(Debug, thiserror::Error)]
#[error("{check}: {finding}")]
#[non_exhaustive]
pub struct Violation {
    /// The check that found it.
    pub check: &'static str,
    /// What was found.
    pub finding: String,
    /// The predictor's error, where it failed and should not have.
    #[source]
    pub source: Option<PredictError>,
}

/// Runs every check.
///
/// # Errors
/// The first [`Violation`].
pub fn check(predictor: &dyn Predictor, case: &Case) -> Result<(), Violation> {
    repetition(predictor, case)?;
    shards(predictor, case)?;
    threads(predictor, case)?;
    order(predictor, case)?;
    draws(predictor, case)?;
    effort(predictor, case)?;
    updates(predictor, case)?;
    cancellation(predictor, case)?;
    errors(predictor, case)?;
    gradients(predictor, case)?;
    learning(predictor, case)
}

/// The draw of checks that need only one.
const DRAW: Draw = Draw::new(0x5eed, Pass::Loop(2));

/// One check on one case.
struct Trial<'a> {
    check: &'static str,
    predictor: &'a dyn Predictor,
    case: &'a Case,
}

type Bound = Box<dyn BoundPredictor>;

impl Trial<'_> {
    fn violation(&self, finding: impl Into<String>) -> Violation {
        Violation { check: self.check, finding: finding.into(), source: None }
    }

    fn ensure(&self, holds: bool, finding: impl Into<String>) -> Result<(), Violation> {
        if holds { Ok(()) } else { Err(self.violation(finding)) }
    }

    /// The value of what should have worked.
    fn worked<T>(&self, what: &str, result: Result<T, PredictError>) -> Result<T, Violation> {
        result.map_err(|error| Violation {
            check: self.check,
            finding: format!("{what} failed"),
            source: Some(error),
        })
    }

    fn same(&self, what: &str, a: &[f32], b: &[f32]) -> Result<(), Violation> {
        let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        if bits(a) == bits(b) {
            return Ok(());
        }
        let differing = a.iter().zip(b).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        let first = a.iter().zip(b).position(|(a, b)| a.to_bits() != b.to_bits());
        Err(self.violation(format!("{what}: {differing} of {} values differ, first {first:?}", a.len())))
    }

    fn bind(&self) -> Result<Bound, Violation> {
        self.worked("bind", self.predictor.bind(Arc::clone(&self.case.object)))
    }

    /// Freshly bound, with these labels.
    fn fresh(&self, labels: &LabelGrid) -> Result<Bound, Violation> {
        let mut bound = self.bind()?;
        self.worked("update", bound.update(labels, Changed::Unknown, &Control::none()))?;
        Ok(bound)
    }

    fn predict(
        &self,
        bound: &dyn BoundPredictor,
        points: &[u32],
        draw: Draw,
    ) -> Result<(Vec<f32>, Diagnostics), Violation> {
        // What was there must not matter.
        let mut out = vec![f32::NAN; points.len() * self.case.object.channels()];
        let seen = self.worked("predict", bound.predict(points, draw, &mut out, &Control::none()))?;
        match out.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.violation(format!("value {i} is {}", out[i]))),
            None => Ok((out, seen)),
        }
    }

    /// Values at the case's points for one draw.
    fn values(&self, bound: &dyn BoundPredictor) -> Result<Vec<f32>, Violation> {
        Ok(self.predict(bound, &self.case.points, DRAW)?.0)
    }
}
