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

/// An endless stream of training samples of which any batch can be asked for.
pub trait SampleSource {
    /// Fills batch `index`: `stencils` with raw coefficients in 1/mm, `[sample][level][cell z][cell y][cell
    /// x][sigma_s, sigma_a]`, and `radiance` with one label a sample. The same index gives the same samples.
    ///
    /// # Errors
    /// Whatever keeps the source from making the batch.
    fn batch(
        &mut self,
        index: u64,
        stencils: &mut [f32],
        radiance: &mut [f32],
    ) -> Result<(), Box<dyn std::error::Error + Send + Sync>>;
}
