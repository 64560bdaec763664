//! Networks as prints use them: points share what the network makes of the coarse levels.

use std::ops::Range;

use pellucid::dataset::LabelledSet;
use pellucid::predictor::{Rpnn, Sharing};
use pellucid::refine::{AppearancePredictor, Scene};
use pellucid::rpnn::transform::LevelOrder;
use pellucid::rpnn::variant::LEVELS;
use pellucid::stencil::near_order;
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface};
use pellucid_benches::study::stopwatch::time;

use super::scores::{NOT_ON_SURFACE, TIMED_POINTS};
use super::{Candidate, Error};

/// Whether prints let neighbours share coarse levels of a network.
pub fn shares(candidate: &Candidate) -> bool {
    candidate.provenance.form.order == LevelOrder::CoarseToFine
}

/// The name of a network in tables, as prints use it.
pub fn name_in_use(candidate: &Candidate) -> String {
    match shares(candidate) {
        true => format!("{}, coarse levels shared", candidate.name),
        false => candidate.name.clone(),
    }
}

/// What sharing is.
pub fn description() -> String {
    let Sharing { fine_levels, block } = Sharing::default();
    format!(
        "the points of a block of {block} x {block} x {block} voxels share what the network makes of the {} coarsest \
         levels",
        LEVELS - fine_levels
    )
}

fn predictor(candidate: &Candidate) -> Rpnn {
    Rpnn::new(candidate.weights.clone(), candidate.provenance.clone(), candidate.precision)
}

/// Radiance of surface points, `[point][channel]`, as prints use the network.
pub fn predict(
    candidate: &Candidate,
    grid: &LabelGrid,
    surface: &Surface,
    materials: &MaterialTable,
    points: &[u32],
    control: &Control<'_>,
) -> Result<Vec<f32>, Error> {
    let mut out = vec![0.0; points.len() * materials.channels()];
    predictor(candidate).predict(&Scene { grid, surface, materials }, points, 0, &mut out, control)?;
    Ok(out)
}

/// Predictions of a network whose points share coarse levels.
pub struct Shared {
    pub predicted: Vec<f32>,
    /// Processor seconds a sample of neighbouring surface points.
    pub sample_seconds: f64,
}

impl Shared {
    /// Predicts a volume's samples; a point's value does not depend on the others, but its time does, and
    /// is measured on neighbours when `timed`.
    pub fn volume(
        &mut self,
        candidate: &Candidate,
        grid: &LabelGrid,
        surface: &Surface,
        materials: &MaterialTable,
        set: &LabelledSet,
        samples: Range<usize>,
        timed: bool,
        control: &Control<'_>,
    ) -> Result<(), Error> {
        let scene = Scene { grid, surface, materials };
        let points = samples
            .clone()
            .step_by(set.channels())
            .map(|i| surface.index_of(set.voxel(i)).ok_or(NOT_ON_SURFACE))
            .collect::<Result<Vec<u32>, _>>()?;
        let mut network = predictor(candidate);
        network.predict(&scene, &points, 0, &mut self.predicted[samples], control)?;
        if timed {
            let order = near_order(surface.voxels());
            let near = &order[..order.len().min(TIMED_POINTS)];
            let mut out = vec![0.0; near.len() * set.channels()];
            let (_, spent) = time(|| {
                // The table is there already: no label changed.
                network.tiles_changed(&[]);
                network.predict(&scene, near, 0, &mut out, control)
            })?;
            self.sample_seconds = spent / out.len() as f64;
        }
        Ok(())
    }
}
