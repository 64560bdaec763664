//! The radiance-predicting neural network (RPNN) of Rittig et al. 2021, section 4.3: from a stencil of
//! scattering and absorption coefficients around a surface voxel to the radiance seen there.
//!
//! | module | owns |
//! | --- | --- |
//! | [`variant`] | the four architectures, their layers and parameter counts |
//! | [`weights`] | parameters as one flat vector, their initialisation |
//! | [`file`](mod@file) | weights as safetensors files that say what they were trained for |
//! | [`transform`] | from raw stencils to the network's input |
//! | [`network`] | forward and backward passes on packed matrix products |
//! | [`inference`] | radiance of raw stencils, any number of them |
//! | [`input_gradients`] | derivatives of outputs by raw stencils |
//! | `shipped` | trained weights carried in the library (feature `weights`) |
//! | [`adamw`] | the optimiser |
//! | [`train`] | training runs |
//! | `candle` | the network in candle, on any device (feature `candle`) |
//!
//! One sample is one surface point in one channel: a stencil of 9 levels x 135 cells x 2 features
//! (sigma_s, sigma_a; 1/mm), cells ordered `[z][y][x]` over 9 x 3 x 5.
#![deny(unsafe_code)]

pub mod adamw;
mod block;
#[cfg(feature = "candle")]
pub mod candle;
pub mod error;
pub mod file;
pub mod inference;
pub mod input_gradients;
mod kernel;
mod layers;
pub mod network;
mod precision;
#[cfg(feature = "weights")]
mod shipped;
pub mod train;
pub mod transform;
pub mod variant;
pub mod weights;

pub use error::RpnnError;
pub use file::{Provenance, TrainedNetwork};
pub use inference::Inference;
pub use input_gradients::InputGradients;
pub use network::Network;
pub use pellucid_core::InstructionSet;
pub use precision::Precision;
#[cfg(feature = "weights")]
pub use shipped::{SHIPPED, shipped};
pub use variant::Variant;
pub use weights::Weights;

/// The README's example, compiled and run by the tests.
#[cfg(all(doctest, feature = "weights"))]
#[doc = include_str!("../README.md")]
struct Readme;
