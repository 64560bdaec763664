//! What is refined towards what.

use pellucid_color::Viewing;
use pellucid_core::random::mix;
use pellucid_predict::Object;
use pellucid_voxel::{AIR, NearestSurface};
use rayon::prelude::*;

use crate::{InkModel, RefineError};

/// Most labels of an ink model.
pub(crate) const MAX_LABELS: usize = 16;

/// How a print should look in one viewing.
#[derive(Clone, Copy)]
pub struct Aim<'a> {
    /// How radiance becomes colour; as many channels as the object's materials.
    pub viewing: &'a Viewing,
    /// What each surface voxel should show and can, linear RGB relative to the print's white in this viewing.
    pub printable_target: &'a [[f32; 3]],
}

/// An object, what can be printed, and what it should look like. [`Refinement::new`](crate::Refinement::new) checks
/// that all of it fits together.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// Surface voxels, materials and optical boundary.
    pub object: &'a Object,
    /// The nearest surface voxel of each voxel, at least to the coloured depth.
    pub nearest: &'a NearestSurface,
    /// Printable colours and their mixtures.
    pub ink: &'a dyn InkModel,
    /// How radiance becomes colour; as many channels as the object's materials.
    pub viewing: &'a Viewing,
    /// The texture's colour at each surface voxel, linear RGB relative to the print's white.
    pub target: &'a [[f32; 3]],
    /// The target brought within reach of gamut and thickness, which the loop aims at.
    pub printable_target: &'a [[f32; 3]],
    /// What it should look like in further viewings; [`Descent`](crate::Descent) lowers the mean of the losses in all.
    pub further: &'a [Aim<'a>],
}

impl<'a> Problem<'a> {
    /// The aims in all viewings, the own one first.
    pub fn aims(&self) -> impl Iterator<Item = Aim<'a>> + use<'a> {
        let own = Aim { viewing: self.viewing, printable_target: self.printable_target };
        std::iter::once(own).chain(self.further.iter().copied())
    }

    /// Tells whether the parts fit together and the nearest-surface map reaches `coloured_depth_mm` deep.
    ///
    /// # Errors
    /// [`RefineError::Invalid`] naming the part that does not fit.
    pub fn check(&self, coloured_depth_mm: f64) -> Result<(), RefineError> {
        if self.nearest.frame() != self.object.frame() {
            return Err(RefineError::invalid("nearest", "lies in another frame than the object's surface"));
        }
        if self.nearest.depth_mm() < coloured_depth_mm {
            let depth = self.nearest.depth_mm();
            return Err(RefineError::invalid(
                "nearest",
                format!("reaches {depth} mm deep; build it to the coloured depth of {coloured_depth_mm} mm"),
            ));
        }
        check_colors(self.object, self.viewing, self.target, self.printable_target)?;
        for aim in self.further {
            check_list(self.object, "printable target of a further viewing", aim.printable_target)?;
            check_channels(self.object, aim.viewing)?;
        }
        let labels = self.ink.labels();
        let known = |l: &u8| *l != AIR && self.object.materials().get(*l).is_some();
        let distinct = labels.iter().enumerate().all(|(i, l)| !labels[..i].contains(l));
        if !(2..=MAX_LABELS).contains(&labels.len()) || !labels.iter().all(known) || !distinct {
            return Err(RefineError::invalid(
                "ink model",
                format!(
                    "labels {labels:?}; 2 to {MAX_LABELS} different ones of the material table are needed"
                ),
            ));
        }
        Ok(())
    }

    /// A digest of targets, viewing and inks: what the object's own identity leaves out.
    pub(crate) fn colors_digest(&self) -> u64 {
        let mut state = mix(self.target.len() as u64 + 1);
        let mut add = |bits: u32| state = mix(state.wrapping_add(0x9e37_79b9_7f4a_7c15) ^ u64::from(bits));
        self.target.iter().chain(self.printable_target).flatten().for_each(|v| add(v.to_bits()));
        self.further.iter().flat_map(|aim| aim.printable_target).flatten().for_each(|v| add(v.to_bits()));
        for aim in self.aims() {
            let mut radiance = vec![0.0; aim.viewing.channels()];
            for channel in 0..radiance.len() {
                radiance[channel] = 1.0;
                aim.viewing.relative_rgb(&radiance).iter().for_each(|v| add(v.to_bits()));
                radiance[channel] = 0.0;
            }
        }
        let labels = self.ink.labels();
        let mut fractions = vec![0.0; labels.len()];
        for (i, &label) in labels.iter().enumerate() {
            fractions[i] = 1.0;
            add(u32::from(label));
            self.ink.color(&fractions).iter().for_each(|v| add(v.to_bits()));
            fractions[i] = 0.0;
        }
        state
    }
}

/// Tells whether targets and viewing fit an object.
pub(crate) fn check_colors(
    object: &Object,
    viewing: &Viewing,
    target: &[[f32; 3]],
    printable_target: &[[f32; 3]],
) -> Result<(), RefineError> {
    check_list(object, "target", target)?;
    check_list(object, "printable target", printable_target)?;
    check_channels(object, viewing)
}

/// The colours that radiances, `[point][channel]`, show.
pub(crate) fn shown_in(viewing: &Viewing, radiance: &[f32]) -> Vec<[f32; 3]> {
    radiance.par_chunks_exact(viewing.channels()).map(|l| viewing.relative_rgb(l)).collect()
}

fn check_channels(object: &Object, viewing: &Viewing) -> Result<(), RefineError> {
    if viewing.channels() != object.channels() {
        return Err(RefineError::invalid(
            "viewing",
            format!("{} channels; the materials have {}", viewing.channels(), object.channels()),
        ));
    }
    Ok(())
}

/// Tells whether there is one finite colour a surface voxel.
pub(crate) fn check_list(object: &Object, field: &str, colors: &[[f32; 3]]) -> Result<(), RefineError> {
    let voxels = object.surface().len();
    if colors.len() != voxels {
        let found = colors.len();
        return Err(RefineError::invalid(field, format!("{found} colours for {voxels} surface voxels")));
    }
    if colors.iter().flatten().any(|v| !v.is_finite()) {
        return Err(RefineError::invalid(field, "a colour is not finite"));
    }
    Ok(())
}
