//! Three-dimensional halftoning: from volume fractions to one material a voxel.
//!
//! A refinement thresholds fractions with a [`BlueNoiseMask`], which is local, parallel and the same for any order of
//! work: [`Thresholds`] turns a mixture into cumulative shares and a voxel's threshold into a label.
//! [`RankedNoise`] is a mask made in a moment, for training data.
//! [`diffuse_errors`] is the classical serial alternative, to compare with, by the neighbours that a [`Spread`] names.
#![forbid(unsafe_code)]

mod diffusion;
mod mask;
mod ranked_noise;
mod thresholds;

pub use diffusion::{Spread, diffuse_errors};
pub use mask::BlueNoiseMask;
pub use ranked_noise::RankedNoise;
pub use thresholds::Thresholds;

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
