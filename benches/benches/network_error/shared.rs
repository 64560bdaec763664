//! Networks as prints use them: points share what the network makes of the coarse levels.

use std::sync::Arc;

use pellucid::predict::{BoundPredictor, Changed, Draw, Network, Object, Pass, Predictor, Sharing};
use pellucid::rpnn::transform::LevelOrder;
use pellucid::rpnn::variant::LEVELS;
use pellucid::stencil::near_order;
use pellucid::voxel::{Control, LabelGrid};
use pellucid_benches::appearance::TIMED_POINTS;
use pellucid_benches::study::stopwatch::time;

use super::{Candidate, Error};

/// The network has no random error: any numbers do.
const DRAW: Draw = Draw::new(0, Pass::Proof);

/// Whether prints let neighbours share coarse levels of a network.
pub fn shares(candidate: &Candidate) -> bool {
    candidate.trained.provenance.form.order == LevelOrder::CoarseToFine
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
    let Sharing { fine_levels, coarse_mm, .. } = Sharing::default();
    format!(
        "points take what the network makes of the {} coarsest levels between places {coarse_mm} mm apart",
        LEVELS - fine_levels
    )
}

fn bound(
    candidate: &Candidate,
    grid: &LabelGrid,
    object: &Arc<Object>,
    control: &Control<'_>,
) -> Result<Box<dyn BoundPredictor>, Error> {
    let network = Network::new(Arc::clone(&candidate.trained), candidate.precision);
    let mut bound = network.bind(Arc::clone(object))?;
    bound.update(grid, Changed::Unknown, control)?;
    Ok(bound)
}

/// Radiance of surface points, `[point][channel]`, as prints use the network.
pub fn predict(
    candidate: &Candidate,
    grid: &LabelGrid,
    object: &Arc<Object>,
    points: &[u32],
    control: &Control<'_>,
) -> Result<Vec<f32>, Error> {
    let mut out = vec![0.0; points.len() * object.channels()];
    bound(candidate, grid, object, control)?.predict(points, DRAW, &mut out, control)?;
    Ok(out)
}

/// Processor seconds that a sample of neighbouring surface points takes: a point's value does not depend on the others,
/// but its time does.
pub fn sample_seconds(
    candidate: &Candidate,
    grid: &LabelGrid,
    object: &Arc<Object>,
    control: &Control<'_>,
) -> Result<f64, Error> {
    let bound = bound(candidate, grid, object, control)?;
    let order = near_order(object.surface().voxels());
    let near = &order[..order.len().min(TIMED_POINTS)];
    let mut out = vec![0.0; near.len() * object.channels()];
    let (_, spent) = time(|| bound.predict(near, DRAW, &mut out, control))?;
    Ok(spent / out.len() as f64)
}
