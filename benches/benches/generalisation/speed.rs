//! Processor time of training and prediction.

use pellucid::dataset::{LabelledSet, Sampler};
use pellucid::rpnn::train::Trainer;
use pellucid::rpnn::{Inference, Variant};
use pellucid::trace::Boundary;
use pellucid::voxel::Control;
use pellucid_benches::appearance::stencil_seconds;
use pellucid_benches::study::stopwatch::time;

use super::Error;
use super::finished::Finished;
use super::plan::Plan;
use super::training::Replay;

/// Samples that are predicted at a time.
const SAMPLES: usize = 512;

/// Times of one architecture, whatever its weights.
pub struct Speed {
    pub variant: Variant,
    /// A training step of 256 samples, in ms.
    pub step_ms: f64,
    /// The network on one sample, in microseconds, without its stencil.
    pub sample_us: f64,
}

/// Times all architectures on the samples of a set; and the microseconds that the stencil of a sample takes.
pub fn measure(plan: &Plan, set: &LabelledSet, control: &Control<'_>) -> Result<(Vec<Speed>, f64), Error> {
    let mut speeds = Vec::new();
    for variant in Variant::ALL {
        let settings = plan.settings(plan.groups[0], variant);
        let mut source = Replay::of_set(set, settings.batch);
        let mut trainer = Trainer::new(settings.clone())?;
        let (_, step) = time(|| trainer.step(&mut source))?;
        let mut inference = Inference::new(trainer.weights(), settings.form, Finished::PRECISION)?;
        let mut out = vec![0.0; SAMPLES.min(set.len())];
        let mut stencils = vec![0.0; out.len() * pellucid::dataset::STENCIL_VALUES];
        set.stencils(0, &mut stencils);
        let flights = &set.flights()[..out.len()];
        let (_, spent) = time(|| inference.radiance(&stencils, flights, &mut out))?;
        speeds.push(Speed { variant, step_ms: 1e3 * step, sample_us: 1e6 * spent / out.len() as f64 });
    }
    let header = set.header();
    let boundary = Boundary::with_index(header.recipe.refractive_index)?;
    let sampler = Sampler::new(&header.recipe, &header.split, &header.materials, boundary)?;
    Ok((speeds, 1e6 * stencil_seconds(&sampler, set.volume(0), control)?))
}
