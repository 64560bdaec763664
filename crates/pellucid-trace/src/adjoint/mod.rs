//! The derivative of radiance by the amounts of materials in voxels.
//!
//! Given weights r of radiances L, [`Tracer::pullback`] estimates the derivative of sum(r L) by the volume fraction f
//! of each material in each voxel. A mixture has the sums of its parts' coefficients:
//! sigma_a = sum(f sigma_a\[m\]), and light scatters with density sum(f sigma_s\[m\] p\[m\]), p\[m\] being the
//! material's phase function.
//!
//! # The estimator
//! L is the integral over paths X, from the surface point until they leave, of the contribution
//! F(X) = exp(-tau) · prod(sigma_s p) · prod(R or 1 - R): transmittance along the path, densities of its
//! scatterings, reflections and the exit. With l(v) the millimetres flown in voxel v and n(v) the scatterings there,
//!
//! d ln F / d sigma_a(v) = -l(v),   d ln F / d sigma_s(v) = n(v) / sigma_s(v) - l(v),
//!
//! and by the amount of material m each scattering in v, at a cosine c, counts
//! sigma_s\[m\] p\[m\](c) / (sigma_s(v) p(c)), which for one phase function is the sum of the two rows above with
//! weights sigma_a\[m\] and sigma_s\[m\]. Reflections do not depend on the materials. So with paths drawn by whatever
//! means with weights T = F / density, dL = E\[T · d ln F\]: the derivative follows the paths of the radiance.
//! Null collisions are not part of X: the tracer's own weights already integrate over them (their densities marginalise
//! to exp(-tau)), so nothing here divides by majorant less extinction, and materials whose extinction *is* the majorant
//! are no special case. Russian roulette belongs to T. Every path is addressed by its numbers: it is walked once for T
//! and, if that is not 0, again with the same numbers, adding to the voxels it passes (path replay: Vicini, Speierer
//! and Jakob 2021; derivatives of media by null collisions: Nimier-David, Müller, Keller and Jakob 2022).
//!
//! * **Length.** A stretch flown within one voxel adds its length there. Farther from air, where a flight crosses
//!   voxels in one step, a uniformly random point of it takes its whole length: the expectation is the same.
//! * **Baseline.** With w the throughput so far, w (n / sigma_s - l) has expectation 0 at every voxel, as scatterings
//!   come at the rate sigma_s per unit throughput. Subtracting b w from T in the scattering's row changes no
//!   expectation if b does not depend on the path. b is the mean T of the *other* paths walked together where that is
//!   above 0.6, else 0. Where T is nearly the same for all paths it is mostly noise that the baseline takes away; dark
//!   objects would only lose time, since with it absorbed paths must be walked again too.
//! * **Paths.** A point and channel gets floor(p |r| / mean |r| + u) paths, each of weight sign(r) mean |r| / p, where
//!   p is [`AdjointOptions::paths`] and u uniform: large weights get the paths, zeros none. The mean is over all values
//!   of the call, so that the derivative is linear in r in expectation only.
//!
//! # Bias and variance
//! Unbiased for the volume's voxels but for: lengths and counts are summed in units of 2^-24 mm (rounding, below
//! 1e-7 of what a path adds); a scattering where sigma_s is 0 never happens, so that the gain from the *first*
//! scatterer in a clear voxel is missing there, and its attenuation is not (materials below 1e-6 per mm count as
//! clear); and the cut of endless paths that all radiances have. The relative variance of a voxel's derivative by
//! absorption is about 1/N for N paths through it; that by scattering adds E\[(T - b w)²\] n / sigma_s², which grows
//! as 1/sigma_s: where sigma_s\[m\] / sigma_s(v) is large, so is the noise.
//!
//! # Pooling
//! With l and n counted as above, the row of scattering, D(v) = T (n / sigma_s(v) - l), is the effect of a thin scatterer
//! put into v. It hardly depends on v's own material, but its noise does, as 1/sigma_s(v): among few white voxels the
//! many of a clear ink decide. So with [`AdjointOptions::pooled`] every voxel of a box of 4 x 4 x 4 gets
//! sum(sigma_s D) / sum(sigma_s) over the box, the mean that Poisson counts weigh least noisily, in which a scattering
//! counts the same wherever it was. Voxels without scatterers get it too. The part by absorption stays as it is.
//!
//! The paths are independent of those of [`Tracer::radiance`] with the same iteration: r may depend on the latter.

mod cells;
mod paths;
mod phases;
mod pullback;

pub(crate) use cells::Cells;
pub(crate) use phases::Phases;

use crate::TraceError;
#[cfg(doc)]
use crate::Tracer;

/// How a derivative is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdjointOptions {
    /// Mean number of paths per point and channel, above 0 and at most 2^20; need not be whole.
    pub paths: f32,
    /// Averages the part by scattering over boxes of 4 x 4 x 4 voxels: less noise, and a derivative that is as smooth
    /// as the boxes are large. See [Pooling](self#pooling).
    pub pooled: bool,
}

impl Default for AdjointOptions {
    fn default() -> Self {
        Self { paths: 2.0, pooled: false }
    }
}

impl AdjointOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for a number of paths out of range.
    pub fn check(&self) -> Result<(), TraceError> {
        if self.paths > 0.0 && self.paths <= (1 << 20) as f32 {
            return Ok(());
        }
        Err(TraceError::invalid(
            "paths of the derivative",
            format!("{} must lie above 0 and be at most 2^20", self.paths),
        ))
    }
}

/// Receives derivatives by the amount of a material in a voxel.
pub trait Derivatives {
    /// Adds to the derivative by the volume fraction of `label` in `voxel`, a solid one. Called once a channel, voxel
    /// and material at most, channel by channel, in an order that depends on the volume alone.
    fn add(&mut self, voxel: [u32; 3], label: u8, derivative: f32);

    /// Adds to the derivatives by every material of the table in some thousands of voxels, none twice: `derivatives` is
    /// `[voxel][material]`, labels 1 and up. The tracer calls this, which unless overridden calls [`Derivatives::add`]
    /// for each.
    fn add_rows(&mut self, voxels: &[[u32; 3]], derivatives: &[f32]) {
        let Some(materials) = derivatives.len().checked_div(voxels.len()) else { return };
        for (voxel, row) in voxels.iter().zip(derivatives.chunks_exact(materials.max(1))) {
            (1..=u8::MAX).zip(row).for_each(|(label, &derivative)| self.add(*voxel, label, derivative));
        }
    }

    /// The voxels that derivatives are wanted for, from the first `[x, y, z]` to before the last; all where `None`.
    fn region(&self) -> Option<[[u32; 3]; 2]> {
        None
    }

    /// Whether derivatives are wanted for any voxel from `first` to before `end`, a box of 4 x 4 x 4 voxels or part
    /// of one. Boxes that are not wanted take no memory and no time; others take 1 KiB while a derivative is estimated.
    fn wants(&self, first: [u32; 3], end: [u32; 3]) -> bool {
        let _ = (first, end);
        true
    }
}
