//! The models, one module each.

mod bone;
mod octostar;
mod plane;
mod showcase;
mod tubes;
mod vase_handle;
mod vase_hollow;
mod wedge;

use crate::Model;
use crate::vec3::{V3, add};

/// Every model, in the order of the paper's section 5.
pub fn all() -> Vec<Model> {
    let mut models = vec![
        wedge::model(),
        showcase::model(),
        octostar::model(),
        bone::model(),
        vase_handle::model(),
        vase_hollow::model(),
        tubes::model(),
        plane::model(),
    ];
    for model in &mut models {
        stand(model);
    }
    models
}

/// Moves a model so that it stands on z = 0 around the z axis.
fn stand(model: &mut Model) {
    let (lo, hi) = model.part.bounds();
    let shift: V3 = [-(lo[0] + hi[0]) / 2.0, -(lo[1] + hi[1]) / 2.0, -lo[2]];
    model.part.positions.iter_mut().for_each(|p| *p = add(*p, shift));
}
