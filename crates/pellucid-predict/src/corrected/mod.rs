//! A fast predictor whose error is measured by another one on the way, and taken out.

mod bound;
mod field;
mod moments;
mod quadratic;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::pair::{self, Pair};
use crate::{BoundPredictor, Capabilities, Identity, Object, PredictError, Predictor};

/// How an error is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Correction {
    /// One in so many points is predicted by both, drawn anew in each pass; at least 1.
    pub one_in: u32,
    /// Standard deviation in mm of the Gaussian within which a point's neighbours tell its error, 0.01 to 100.
    pub radius_mm: f64,
    /// Weight that measurements keep from one pass to the next, 0 to below 1.
    pub memory: f64,
}

impl Default for Correction {
    /// One point in four, 0.2 mm, 0.7: some 200 measurements tell the error of a point in a print of 27 um layers.
    fn default() -> Self {
        Self { one_in: 4, radius_mm: 0.2, memory: 0.7 }
    }
}

/// Predicts by `fast` and takes out the error that `unbiased` finds at some of the points, the anchors: what is common
/// to all points of a brightness in a channel, by a quadratic, and of the rest what is common to neighbours. Put the
/// other way round, `fast` is a control variate of few, smoothed paths.
///
/// The loop of a refinement goes where its predictor errs in its favour. A network's error on an object that is unlike
/// its training is smooth in space and brightness, so few paths find it; its details have no noise. The corrected value
/// is unbiased as far as those two smoothings reach.
///
/// The draw chooses the anchors among all points of the surface. Values are a function of object, labels, what was
/// absorbed, point and draw: the first prediction with a draw measures the error at every anchor, whichever points it
/// asks for, so few points cost about as much as all; further predictions with that draw use what it found. A pass
/// [`Learned`](crate::Learned) its anchors' errors; absorbed, they count on in later passes with the weight
/// [`Correction::memory`]. A surface that has no anchor is not corrected.
///
/// Where `fast` has a gradient, that is the gradient of both: how the correction depends on the labels is left out.
///
/// [`Corrected::fast`] can be bound by itself, to compare.
#[derive(Clone, Debug)]
pub struct Corrected<F, U> {
    fast: F,
    unbiased: U,
    settings: Correction,
}

impl<F: Predictor, U: Predictor> Corrected<F, U> {
    /// A predictor of two, which may be boxed.
    ///
    /// # Errors
    /// [`PredictError`] naming the setting that is out of range.
    pub fn new(fast: F, unbiased: U, settings: Correction) -> Result<Self, PredictError> {
        let fine = settings.one_in >= 1
            && (0.01..=100.0).contains(&settings.radius_mm)
            && (0.0..1.0).contains(&settings.memory);
        if !fine {
            return Err(PredictError::invalid(
                "correction",
                format!("{settings:?}; one in 1 or more, 0.01 to 100 mm, memory from 0 to below 1"),
            ));
        }
        Ok(Self { fast, unbiased, settings })
    }

    /// The predictor that is corrected.
    pub fn fast(&self) -> &F {
        &self.fast
    }

    /// The predictor that finds the error.
    pub fn unbiased(&self) -> &U {
        &self.unbiased
    }

    /// How the error is measured.
    pub fn settings(&self) -> Correction {
        self.settings
    }
}

impl<F: Predictor, U: Predictor> Predictor for Corrected<F, U> {
    /// The names of both, `rpnn+mc`; their settings follow their names, as in `mc.spp`.
    fn identity(&self) -> Identity {
        pair::identity(&self.fast, '+', &self.unbiased)
            .with("one_in", self.settings.one_in)
            .with("radius_mm", self.settings.radius_mm)
            .with("memory", self.settings.memory)
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        let fast = self.fast.supports(object)?;
        self.unbiased.supports(object)?;
        // Another draw has other anchors.
        let own = Capabilities::new(true);
        Ok(if fast.gradient { own.with_gradient() } else { own })
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        let pair = Pair::new(object, &self.fast, &self.unbiased)?;
        Ok(Box::new(bound::BoundCorrected::new(pair, self.settings, self.identity().name)))
    }
}
