//! Whether surroundings lie within what a network was trained on.

use pellucid_rpnn::Provenance;

/// Coefficients that exceed the trained range by less are taken for equal.
const SLACK: f64 = 1.01;
/// Position of the point's own voxel within its stencil.
const CENTRE: usize = 2 * 67;

/// The coefficients that training held, with slack, 1/mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrainedRange {
    least: [f64; 2],
    most: [f32; 2],
}

impl TrainedRange {
    pub(super) fn new(provenance: &Provenance) -> Self {
        let ranges = [provenance.sigma_s_range, provenance.sigma_a_range];
        Self { least: ranges.map(|r| r[0] / SLACK), most: ranges.map(|r| (r[1] * SLACK) as f32) }
    }

    /// Whether a raw stencil, or its finest levels, holds coefficients that training did not: more than its largest
    /// anywhere, or less than its smallest in the point's own voxel. Elsewhere air makes means of any size below.
    pub(super) fn misses(&self, stencil: &[f32]) -> bool {
        let own = &stencil[CENTRE..CENTRE + 2];
        (0..2).any(|i| f64::from(own[i]) < self.least[i]) || self.exceeds(stencil)
    }

    /// Whether cells hold more than training's largest coefficients.
    pub(super) fn exceeds(&self, cells: &[f32]) -> bool {
        cells.chunks_exact(2).fold(false, |any, v| any | (v[0] > self.most[0]) | (v[1] > self.most[1]))
    }
}
