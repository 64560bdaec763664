//! One object with its materials: predicted by the networks, traced as reference.

use std::sync::Arc;

use pellucid::color::Viewing;
use pellucid::predict::{Changed, Draw, Network, Object, Pass, Predictor};
use pellucid::trace::{Boundary, ErrorTarget, TraceOptions, Tracer, Volume};
use pellucid::voxel::{Control, LabelGrid};

use super::Error;
use super::finished::Finished;

/// The networks have no random error: any numbers do.
const DRAW: Draw = Draw::new(0, Pass::Proof);
/// Seed of the reference's paths.
const SEED: u64 = 11;

/// An object to predict.
pub struct Case {
    pub name: String,
    pub object: Arc<Object>,
    pub labels: LabelGrid,
    /// From radiance to colour.
    pub viewing: Viewing,
}

impl Case {
    /// Radiance of surface points by a network, `[point][channel]`.
    pub fn predicted(
        &self,
        network: &Finished,
        points: &[u32],
        control: &Control<'_>,
    ) -> Result<Vec<f32>, Error> {
        let predictor = Network::new(Arc::clone(network.network()?), Finished::PRECISION);
        let mut bound = predictor.bind(Arc::clone(&self.object))?;
        bound.update(&self.labels, Changed::Unknown, control)?;
        let mut out = vec![0.0; points.len() * self.object.channels()];
        bound.predict(points, DRAW, &mut out, control)?;
        Ok(out)
    }

    /// Radiance of surface points by a fixed number of paths, `[point][channel]`.
    pub fn traced(&self, points: &[u32], spp: u32, control: &Control<'_>) -> Result<Vec<f32>, Error> {
        let mut out = vec![0.0; points.len() * self.object.channels()];
        self.trace(spp, control, |tracer| Ok(tracer.radiance(points, 0, &mut out, control)?))?;
        Ok(out)
    }

    /// Radiance of surface points to a standard error, and the errors, both `[point][channel]`.
    pub fn reference(
        &self,
        points: &[u32],
        std_error: f32,
        control: &Control<'_>,
    ) -> Result<(Vec<f32>, Vec<f32>), Error> {
        let mut radiance = vec![0.0; points.len() * self.object.channels()];
        let mut errors = radiance.clone();
        let target = ErrorTarget { std_error, max_spp: 1 << 16 };
        self.trace(1, control, |tracer| {
            tracer.radiance_to(points, 1, target, &mut radiance, &mut errors, control)?;
            Ok(())
        })?;
        Ok((radiance, errors))
    }

    fn trace(
        &self,
        spp: u32,
        control: &Control<'_>,
        work: impl FnOnce(&Tracer<'_>) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let boundary = Boundary::with_index(self.object.refractive_index())?;
        let volume = Volume::new(&self.labels, self.object.surface(), control)?;
        let options = TraceOptions { spp, seed: SEED, boundary, ..TraceOptions::default() };
        work(&Tracer::new(&volume, self.object.materials(), options)?)
    }
}
