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

/// Forgets what could not be taken, since a target out of reach must not wind the residual up or it would go on pushing
/// the colours that can still be reached; then adds the gain's share of the shortfall.
pub(crate) fn advance(residual: &mut [[f32; 3]], setup: &Setup<'_>, seen: &Seen<'_>, gain: f32) {
    let seen = seen.smoothed.par_iter().zip(seen.overflow).zip(setup.problem.printable_target);
    residual.par_iter_mut().zip(seen).for_each(|(residual, ((&smoothed, overflow), &target))| {
        let (target, smoothed) = (encode(target), encode(smoothed));
        for c in 0..3 {
            let shortfall = target[c] - smoothed[c];
            residual[c] = (residual[c] - overflow[c]) + gain * shortfall;
        }
    });
}
