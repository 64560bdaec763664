//! Optical density: the scale in which demands add up.
//!
//! Absorption multiplies reflectance, so the logarithm of reflectance adds over layers, roughly.
//! A small offset keeps the density of black finite and its noise bounded.

/// Reflectance added before the logarithm.
const OFFSET: f32 = 0.03;

/// Largest density: of reflectance 0.
pub(crate) const MAX: f32 = 3.536_117;

/// Density of a media-relative reflectance: 0 at 1, negative above, [`MAX`] at 0 and below.
pub(crate) fn of(reflectance: f32) -> f32 {
    ((1.0 + OFFSET) / (reflectance.max(0.0) + OFFSET)).ln()
}

/// Media-relative reflectance of a density.
pub(crate) fn reflectance(density: f32) -> f32 {
    ((1.0 + OFFSET) * (-density).exp() - OFFSET).max(0.0)
}

/// Density by which `seen` falls short of `wanted` (positive when it is too light).
///
/// Equals the difference of densities to second order, but is linear in a small error of `seen`,
/// so that unbiased noise stays nearly unbiased.
pub(crate) fn shortfall(wanted: f32, seen: f32) -> f32 {
    2.0 * (seen - wanted) / (seen.max(0.0) + wanted.max(0.0) + 2.0 * OFFSET)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn density_and_reflectance_invert_each_other() {
        for r in [0.0f32, 0.01, 0.2, 0.7, 1.0, 1.2] {
            assert!((reflectance(of(r)) - r).abs() < 1e-5, "{r}");
        }
        assert!(of(1.0).abs() < 1e-6);
        assert!((of(0.0) - MAX).abs() < 1e-5);
    }

    #[test]
    fn shortfall_is_a_difference_of_densities() {
        for (wanted, seen) in [(0.5f32, 0.52f32), (0.1, 0.09), (0.9, 1.0)] {
            let exact = of(wanted) - of(seen);
            assert!((shortfall(wanted, seen) - exact).abs() < 0.02 * exact.abs());
        }
        assert!(shortfall(0.3, 0.4) > 0.0 && shortfall(0.4, 0.3) < 0.0);
    }
}
