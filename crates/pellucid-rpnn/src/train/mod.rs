//! Training from an addressable stream of samples, stopped and resumed bit for bit.
//!
//! | module | owns |
//! | --- | --- |
//! | [`settings`] | what a run does: [`TrainSettings`], the learning rate's schedule |
//! | [`trainer`] | the run's state and its steps: [`Trainer`] |
//! | [`engine`] | who computes outputs and gradients: [`Engine`] |
//! | [`augment`] | from raw stencils to mirrored network inputs |
//! | [`checkpoint`] | the state as a file |
//! | [`curve`] | loss and validation over the run, as CSV |
//! | [`score`](mod@score) | errors of predictions against labels: [`Score`] |

pub mod augment;
#[cfg(feature = "candle")]
mod candle;
pub mod checkpoint;
pub mod curve;
pub mod engine;
pub mod score;
pub mod settings;
pub mod trainer;

pub use curve::{Curve, CurvePoint};
pub use engine::Engine;
pub use score::Score;
pub use settings::TrainSettings;
pub use trainer::Trainer;

use crate::variant::FirstFlight;
#[cfg(doc)]
use crate::variant::Head;

/// The samples of a batch, to be filled in.
#[derive(Debug)]
pub struct Batch<'a> {
    /// Raw coefficients in 1/mm, `[sample][level][cell z][cell y][cell x][sigma_s, sigma_a]`.
    pub stencils: &'a mut [f32],
    /// First flights, one a sample: what [`Head::FirstFlight`] needs. Networks with the other head ignore them.
    pub flights: &'a mut [FirstFlight],
    /// Labels, one a sample.
    pub radiance: &'a mut [f32],
}

/// An endless stream of training samples of which any batch can be asked for.
pub trait SampleSource {
    /// Fills batch `index`. The same index gives the same samples.
    ///
    /// # Errors
    /// Whatever keeps the source from making the batch.
    fn batch(&mut self, index: u64, batch: Batch<'_>)
    -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}
