//! Materials from measured patches: scattering and absorption of every resin and channel.
//!
//! A chart has thin layers of each resin over white and over black ([`Stack`]). Their measured colours
//! ([`Measurements`]: spectra, XYZ, L\*a\*b\* or RGB, in CSV or CGATS) are turned into the radiance that is simulated
//! ([`Geometry`]), and [`fit`] finds the coefficients that show them, with the exact model of plane-parallel layers.
//! Refractive index and mean cosine are given: layers hardly tell them apart from scattering.
//!
//! Three channels are broad: a resin's R, G and B do not follow the law of a single wavelength exactly, so spectra fit
//! better.

mod checks;
mod fit;
mod geometry;
mod least_squares;
mod measurements;
mod model;
mod plan;
mod quantity;
mod result;
mod stack;
mod stage;
mod table;

pub use fit::{FitOptions, fit};
pub use geometry::Geometry;
pub use measurements::{Measurement, Measurements, Patch, ReadOptions};
pub use quantity::Quantity;
pub use result::{Calibration, Coefficient, MaterialFit, PatchFit};
pub use stack::{Stack, StackLayer};

#[cfg(test)]
mod tests;
