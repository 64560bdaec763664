//! The path tracer as a predictor.

use pellucid_refine::{AppearancePredictor, PredictError, Scene};
use pellucid_trace::{TraceError, TraceOptions, Tracer, Volume};
use pellucid_voxel::Control;

/// Predicts by unbiased path tracing with [`TraceOptions::spp`] paths a point and channel.
///
/// Every iteration draws fresh paths, so that the errors of a refinement's iterations average out.
pub struct MonteCarlo {
    options: TraceOptions,
    volume: Option<Volume>,
}

impl MonteCarlo {
    /// A predictor with these options.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] when they are out of range.
    pub fn new(options: TraceOptions) -> Result<Self, TraceError> {
        options.check()?;
        Ok(Self { options, volume: None })
    }
}

impl AppearancePredictor for MonteCarlo {
    fn name(&self) -> &str {
        "mc"
    }

    fn predict(
        &mut self,
        scene: &Scene<'_>,
        points: &[u32],
        iteration: u32,
        out: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), PredictError> {
        let silent = control.silent();
        // Between iterations only materials change; another shape or frame needs a new volume.
        let kept = self.volume.take().filter(|v| v.len() == scene.surface.len());
        let volume = match kept {
            Some(mut volume) => match volume.set_labels(scene.grid, &silent) {
                Ok(()) => volume,
                Err(TraceError::Cancelled) => return Err(PredictError::Cancelled),
                Err(_) => Volume::new(scene.grid, scene.surface, &silent).map_err(failed)?,
            },
            None => Volume::new(scene.grid, scene.surface, &silent).map_err(failed)?,
        };
        let volume = self.volume.insert(volume);
        let tracer = Tracer::new(volume, scene.materials, self.options).map_err(failed)?;
        tracer.radiance(points, iteration, out, control).map_err(failed)
    }
}

fn failed(error: TraceError) -> PredictError {
    match error {
        TraceError::Cancelled => PredictError::Cancelled,
        other => PredictError::failed("mc", other),
    }
}
