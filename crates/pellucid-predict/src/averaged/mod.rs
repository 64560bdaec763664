//! Few paths a pass, averaged over passes, with a fast predictor to tell what changed between them.

mod bound;
mod errors;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use crate::pair::{self, Pair};
use crate::{BoundPredictor, Capabilities, Identity, Object, PredictError, Predictor};

/// Predicts by `fast` and takes out its error at every point by itself: the mean of what `unbiased` found there in this
/// pass and in those before it. Put the other way round, the unbiased predictor's values are averaged over the passes of a
/// refinement, and `fast` tells how the materials have changed since; its own error cancels but for what the changes
/// changed of it.
///
/// A mean of the values alone lags behind changes, and steps by it overshoot. This one follows, and its noise is that of
/// many more paths than a pass traces; but it is nearly the same from one pass to the next, and does not average out over
/// steps as that of independent passes does. Two draws of a pass differ by the newest measurement alone, which is less than
/// the noise. Values of dark points may lie below 0.
///
/// Values are a function of object, labels, what was absorbed, point and draw: the first prediction with a draw measures
/// the error at every point of the surface, whichever it asks for, so few points cost as much as all. A pass
/// [`Learned`](crate::Learned) the errors it measured; absorbed, they count on with a weight that fades by 1 -
/// [`Averaged::newest`] a pass. The gradient is that of `fast`, where it has one.
#[derive(Clone, Debug)]
pub struct Averaged<F, U> {
    fast: F,
    unbiased: U,
    newest: f64,
}

impl<F: Predictor, U: Predictor> Averaged<F, U> {
    /// A predictor of two, which may be boxed. `newest`, above 0 to 1, is the least share that the newest pass has in the
    /// mean. While there are few, its share is 2 / (n + 1) of n passes: weights rise with their number, since the first
    /// steps of a refinement change most.
    ///
    /// # Errors
    /// [`PredictError::Invalid`] for a share out of range.
    pub fn new(fast: F, unbiased: U, newest: f64) -> Result<Self, PredictError> {
        if !(newest > 0.0 && newest <= 1.0) {
            return Err(PredictError::invalid("newest", format!("{newest}; above 0 to 1 are possible")));
        }
        Ok(Self { fast, unbiased, newest })
    }

    /// The least share of the newest pass.
    pub fn newest(&self) -> f64 {
        self.newest
    }
}

impl<F: Predictor, U: Predictor> Predictor for Averaged<F, U> {
    /// The names of both, `rpnn~mc`; their settings follow their names, as in `mc.spp`.
    fn identity(&self) -> Identity {
        pair::identity(&self.fast, '~', &self.unbiased).with("newest", self.newest)
    }

    fn supports(&self, object: &Object) -> Result<Capabilities, PredictError> {
        let fast = self.fast.supports(object)?;
        let random = fast.random | self.unbiased.supports(object)?.random;
        let own = Capabilities::new(random);
        Ok(if fast.gradient { own.with_gradient() } else { own })
    }

    fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
        let pair = Pair::new(object, &self.fast, &self.unbiased)?;
        Ok(Box::new(bound::BoundAveraged::new(pair, self.newest, self.identity().name)))
    }
}
