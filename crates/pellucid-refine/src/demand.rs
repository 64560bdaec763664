//! The state of a refinement: how much colour each surface voxel asks of the material below it.

use rayon::prelude::*;

use crate::density;
use crate::layers::DepthLayers;
use crate::table::{DemandTable, Mixture};

/// Most depth layers.
pub(crate) const MAX_LAYERS: usize = 64;

/// One density budget per surface voxel and colour, and the rule that spreads it over depth.
///
/// The state is the budget only: twelve bytes a surface voxel. The layers' demands follow from it
/// surface first: each layer asks for `compression` times the budget's density until the layers'
/// weighted densities add up to the budget; what a layer's printable mixture cannot hold moves to
/// the next. Compression 1 is extrusion of the target colour through the whole depth.
#[derive(Clone, Debug)]
pub(crate) struct Demand {
    pub budget: Vec<[f32; 3]>,
    pub compression: f32,
}

impl Demand {
    /// The extrusion of target colours (media-relative linear RGB).
    pub fn extrusion(aim: &[[f32; 3]]) -> Self {
        let budget = aim.par_iter().map(|c| c.map(|v| density::of(v).max(0.0))).collect();
        Self { budget, compression: 1.0 }
    }
}

/// Fills `out` with the mixtures of the first `out.len()` layers for a budget and returns what of
/// the budget they do not hold.
pub(crate) fn fill(
    table: &DemandTable,
    layers: &DepthLayers,
    budget: [f32; 3],
    compression: f32,
    out: &mut [Mixture],
) -> [f32; 3] {
    let mut rest = budget;
    let dense = budget.map(|b| b * compression);
    for (mixture, weight) in out.iter_mut().zip(layers.weights()) {
        let wanted = std::array::from_fn(|c| dense[c].min(rest[c] / weight[c]).clamp(0.0, density::MAX));
        *mixture = table.mixture(wanted);
        for c in 0..3 {
            rest[c] -= weight[c] * mixture.density[c];
        }
    }
    rest
}

/// Adds `change` to the budgets. What is below zero (lighter than white) or more than the
/// available layers can hold is dropped, so that targets out of reach do not wind up.
pub(crate) fn advance(
    demand: &mut Demand,
    table: &DemandTable,
    layers: &DepthLayers,
    available: &[u8],
    change: &[[f32; 3]],
) {
    let compression = demand.compression;
    demand.budget.par_iter_mut().zip(change).zip(available).for_each(|((budget, change), &count)| {
        let wanted: [f32; 3] = std::array::from_fn(|c| (budget[c] + change[c]).max(0.0));
        let mut mixtures = [Mixture::default(); MAX_LAYERS];
        let rest = fill(table, layers, wanted, compression, &mut mixtures[..usize::from(count)]);
        *budget = std::array::from_fn(|c| wanted[c] - rest[c].clamp(0.0, wanted[c]));
    });
}
