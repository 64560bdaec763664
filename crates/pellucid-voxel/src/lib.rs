//! Voxel volumes of multi-material prints.
//!
//! | module | owns |
//! | --- | --- |
//! | [`pitch`] | voxel edge lengths and the frame that places a grid in millimetres |
//! | [`material`] | scattering and absorption coefficients of the print materials |
//! | [`grid`] | the sparse tiled [`LabelGrid`]: one material label a voxel; dense arrays and bytes from and to it |
//! | [`surface`] | surface voxels, their outward normals and their positions in the list |
//! | [`nearest`] | the nearest surface voxel of every solid voxel to a depth |
//! | [`near_order`] | an order of voxels that keeps neighbours together |
//! | [`sat`] | exact summed-area tables over material counts: [`CountSat`] |
//! | [`thickness`] | how thick the solid is at each surface voxel |
//!
//! Conventions: lengths are millimetres, coefficients 1/mm. Arrays are ordered `[z][y][x]`
//! with x fastest; coordinates are written `[x, y, z]`. Label 0 is air.
#![forbid(unsafe_code)]

pub mod channels;
mod eigen;
mod envelope;
pub mod error;
pub mod grid;
#[cfg(feature = "serde")]
mod json;
pub mod material;
pub mod nearest;
mod nearest_block;
mod normal_window;
mod normals;
mod occupancy;
mod order;
pub mod pitch;
pub mod sat;
pub mod surface;
mod surface_index;
pub mod thickness;

pub use channels::Channels;
pub use error::VoxelError;
pub use grid::{AIR, LabelGrid, TILE, TILE_VOXELS, Tile};
pub use material::{Material, MaterialTable};
pub use nearest::NearestSurface;
pub use order::{near_key, near_order};
pub use pellucid_core::{Cancelled, Control, Progress};
pub use pitch::{Frame, Pitch};
pub use sat::{CountSat, SatMemory};
pub use surface::{Surface, SurfaceOptions};
pub use thickness::local_thickness_mm;
