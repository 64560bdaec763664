//! Voxel volumes of multi-material prints.
//!
//! | item | is |
//! | --- | --- |
//! | [`Pitch`], [`Frame`] | voxel edge lengths, and what places a grid in millimetres |
//! | [`Channels`], [`MaterialTable`] | what channels stand for; scattering and absorption of the print materials |
//! | [`MeasuredSpectra`] | materials measured at any wavelengths, and as bands |
//! | [`LabelGrid`] | one material label a voxel in sparse tiles; from and to functions, dense arrays and bytes |
//! | [`Surface`] | surface voxels, their outward normals and their positions in the list |
//! | [`NearestSurface`] | the nearest surface voxel of every solid voxel to a depth |
//! | [`local_thickness_mm`] | how thick the solid is at each surface voxel |
//! | [`internal_reflectance`] | reflection at the inside of the surface |
//! | [`CountSat`] | exact summed-area tables over material counts |
//! | [`near_order`] | an order of voxels that keeps neighbours together |
//!
//! Conventions: lengths are millimetres, coefficients 1/mm. Arrays are ordered `[z][y][x]`
//! with x fastest; coordinates are written `[x, y, z]`. Label 0 is air.
#![forbid(unsafe_code)]

mod anisotropy;
mod channels;
mod eigen;
mod envelope;
mod error;
mod fresnel;
mod grid;
#[cfg(feature = "serde")]
mod json;
mod material;
mod measured;
mod nearest;
mod nearest_block;
mod normal_window;
mod normals;
mod occupancy;
mod order;
mod pitch;
#[doc(hidden)]
pub mod sat;
mod section;
mod surface;
mod surface_count;
mod surface_index;
mod surface_list;
mod thickness;

pub use anisotropy::Anisotropy;
pub use channels::Channels;
pub use error::VoxelError;
pub use fresnel::internal_reflectance;
pub use grid::{AIR, LabelGrid, TILE, TILE_VOXELS, Tile};
pub use material::{Material, MaterialTable};
pub use measured::{MeasuredSpectra, WIDEST_GAP_NM, band_weights};
pub use nearest::NearestSurface;
pub use order::{near_key, near_order};
pub use pellucid_core::{Cancelled, Control, Progress};
pub use pitch::{Frame, Pitch};
pub use sat::{CountSat, SatMemory};
pub use surface::{Surface, SurfaceOptions};
pub use thickness::local_thickness_mm;

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
