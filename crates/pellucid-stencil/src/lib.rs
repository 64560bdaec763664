//! The hierarchical descriptor of a surface point.
//!
//! The network that predicts a point's radiance sees the volume only through this descriptor
//! (Rittig, Sumin et al. 2021, section 4.2): box means of scattering and absorption over cells
//! that double in size from level to level. Here every box is centred on the centre of the
//! point's voxel and summed exactly, so the descriptor of a mirrored volume is the mirror image
//! of the descriptor, bit for bit.
//!
//! | module | owns |
//! | --- | --- |
//! | [`spec`] | cells, levels and scale: [`StencilSpec`] |
//! | [`coefficients`] | from material counts to features of channels: [`Coefficients`] |
//! | [`extract`] | batches of points: [`Stencils`] |
//! | [`changed`] | which stencils a change of tiles touches: [`ChangedTiles`] |
//! | [`flight`] | the exact first flight: [`FirstFlights`] |
//! | [`octants`] | mirror images and octant views |
//! | [`adjoint`] | gradients of descriptors carried back to voxels: [`scatter`] |
//!
//! Layout: `[point][channel][level][cell z][cell y][cell x][feature]`, features sigma_s, sigma_a
//! in 1/mm and optionally occupancy.
#![deny(unsafe_code)]

pub mod adjoint;
mod axis;
pub mod changed;
pub mod coefficients;
pub mod error;
pub mod extract;
pub mod flight;
mod kernel;
mod lattice;
mod levels;
pub mod octants;
pub mod spec;
mod window;

pub use adjoint::{Region, Scatter, scatter};
pub use changed::ChangedTiles;
pub use coefficients::{Coefficients, Features};
pub use error::StencilError;
pub use extract::Stencils;
pub use flight::{FLIGHT_BINS, FLIGHT_DEPTHS_MM, FirstFlight, FirstFlights};
pub use octants::OCTANTS;
pub use pellucid_core::InstructionSet;
pub use pellucid_voxel::near_order;
pub use spec::{LevelScale, StencilSpec};

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
