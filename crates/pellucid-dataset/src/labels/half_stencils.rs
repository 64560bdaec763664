//! Stencils in half precision: what is kept of a sample.

use half::f16;
use half::slice::HalfFloatSliceExt;
use pellucid_stencil::StencilSpec;

/// Values of one sample's stencil: 9 levels of 9 x 3 x 5 cells (z, y, x) of sigma_s and sigma_a.
pub const STENCIL_VALUES: usize = 2 * StencilSpec::paper().cells_in_all();

/// Stencils ordered `[sample][level][z][y][x][sigma_s, sigma_a]` in 1/mm, each value rounded to IEEE's half
/// precision (11 significant bits).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HalfStencils(Vec<f16>);

impl HalfStencils {
    /// Zeros for a number of samples.
    pub(crate) fn zeros(samples: usize) -> Self {
        Self(vec![f16::ZERO; samples * STENCIL_VALUES])
    }

    /// None yet, with room for some.
    pub(crate) fn with_capacity(samples: usize) -> Self {
        Self(Vec::with_capacity(samples * STENCIL_VALUES))
    }

    pub(crate) fn extend(&mut self, other: &Self) {
        self.0.extend_from_slice(&other.0);
    }

    /// Rounds whole stencils into place, from sample `first` on.
    pub(crate) fn set(&mut self, first: usize, values: &[f32]) {
        self.0[first * STENCIL_VALUES..][..values.len()].convert_from_f32_slice(values);
    }

    pub(crate) fn values_mut(&mut self) -> &mut [f16] {
        &mut self.0
    }

    pub(crate) fn values(&self) -> &[f16] {
        &self.0
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.0.len() / STENCIL_VALUES
    }

    /// True when there is no sample.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Writes the stencils of samples `first..` to `out`, [`STENCIL_VALUES`] a sample.
    ///
    /// # Panics
    /// When `out` is no whole number of stencils or reaches past the last one.
    pub fn write(&self, first: usize, out: &mut [f32]) {
        assert!(out.len().is_multiple_of(STENCIL_VALUES), "whole stencils");
        self.0[first * STENCIL_VALUES..][..out.len()].convert_to_f32_slice(out);
    }

    /// All stencils as f32.
    pub fn to_f32(&self) -> Vec<f32> {
        let mut out = vec![0.0; self.0.len()];
        self.write(0, &mut out);
        out
    }
}
