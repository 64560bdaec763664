//! What strategies after Sumin et al. 2019 accumulate: a colour residual a surface voxel, in cube roots of linear RGB, which
//! are about equal steps for the eye.

use rayon::prelude::*;

use crate::{RefineError, Seen, Setup};

/// Cube roots of linear RGB.
pub(crate) fn encode(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| v.max(0.0).cbrt())
}

/// Back from [`encode`].
pub(crate) fn decode(rgb: [f32; 3]) -> [f32; 3] {
    rgb.map(|v| v.max(0.0).powi(3))
}

/// Tells whether residuals that were stored are finite and as many as there are surface voxels.
pub(crate) fn check(setup: &Setup<'_>, residual: &[[f32; 3]]) -> Result<(), RefineError> {
    let (found, voxels) = (residual.len(), setup.points.len());
    if found != voxels {
        let reason = format!("{found} residuals for {voxels} surface voxels");
        return Err(RefineError::invalid("checkpoint", reason));
    }
    if residual.iter().flatten().any(|v| !v.is_finite()) {
        return Err(RefineError::invalid("checkpoint", "a residual is not finite"));
    }
    Ok(())
}

/// Residuals that have forgotten what could not be taken, since a target out of reach must not wind them up or they would
/// go on pushing the colours that can still be reached; with the gain's share of the shortfall added.
pub(crate) fn advanced(
    residual: &[[f32; 3]],
    setup: &Setup<'_>,
    seen: &Seen<'_>,
    gain: f32,
) -> Vec<[f32; 3]> {
    let seen = seen.smoothed.par_iter().zip(seen.overflow).zip(setup.problem.printable_target);
    let advanced = residual.par_iter().zip(seen).map(|(residual, ((&smoothed, overflow), &target))| {
        let (target, smoothed) = (encode(target), encode(smoothed));
        std::array::from_fn(|c| (residual[c] - overflow[c]) + gain * (target[c] - smoothed[c]))
    });
    advanced.collect()
}
