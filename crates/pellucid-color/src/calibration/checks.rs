//! What measurements must not do: contradict each other, or leave a material's colour open.

use super::fit::lab_of;
use super::result::{MaterialFit, PatchFit};
use super::{FitOptions, Measurements};
use crate::ColorError;
use crate::delta_e::delta_e_2000;

/// Most patches that an error names.
const MOST_NAMED: usize = 5;

/// Patches of the same stack must look alike.
pub(super) fn repeated_patches_agree(
    measurements: &Measurements,
    options: &FitOptions,
) -> Result<(), ColorError> {
    let rows = options.illuminant.rows_for(measurements.channels())?;
    let list = measurements.list();
    for (i, a) in list.iter().enumerate() {
        for b in list[..i].iter().filter(|b| b.patch.stack == a.patch.stack) {
            let apart = delta_e_2000(lab_of(&rows, &a.radiance), lab_of(&rows, &b.radiance));
            if apart > options.most_delta_e {
                let reason = format!(
                    "patches {:?} and {:?} contradict each other: both are {}, and they are dE {apart:.1} apart; measure \
                     them again, or leave one out by emptying its values",
                    b.patch.id, a.patch.id, a.patch.stack
                );
                return Err(ColorError::invalid("measurements", reason));
            }
        }
    }
    Ok(())
}

/// What was fitted must be met.
pub(super) fn patches_agree(patches: &[PatchFit], options: &FitOptions) -> Result<(), ColorError> {
    let mut off: Vec<&PatchFit> =
        patches.iter().filter(|p| !p.check && p.delta_e > options.most_delta_e).collect();
    if off.is_empty() {
        return Ok(());
    }
    off.sort_by(|a, b| b.delta_e.total_cmp(&a.delta_e));
    let named: Vec<String> = off
        .iter()
        .take(MOST_NAMED)
        .map(|p| format!("{:?} ({}) by dE {:.1}", p.id, p.stack, p.delta_e))
        .collect();
    let reason = format!(
        "contradictory: no coefficients show what {} of {} patches do; off are {}{}; look for swapped or misread patches \
         and for other thicknesses, and measure again, or leave them out by emptying their values",
        off.len(),
        patches.iter().filter(|p| !p.check).count(),
        named.join(", "),
        if off.len() > MOST_NAMED { " and more" } else { "" }
    );
    Err(ColorError::invalid("measurements", reason))
}

/// Coefficients may stay open, the colours of thin and thick layers may not.
pub(super) fn colours_are_known(fits: &[MaterialFit], options: &FitOptions) -> Result<(), ColorError> {
    let Some(open) = fits.iter().find(|fit| fit.color_error > options.most_delta_e) else { return Ok(()) };
    let reason = format!(
        "too few to fit {:?}: the colour of its layers stays open by dE {:.1}; measure more thicknesses of it, over \
         white and over black",
        open.name, open.color_error
    );
    Err(ColorError::invalid("measurements", reason))
}
