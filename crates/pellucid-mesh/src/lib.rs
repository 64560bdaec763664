//! Textured triangle meshes for multi-material 3D prints.
//!
//! | module | owns |
//! | --- | --- |
//! | [`import`] | glTF 2.0 files into a [`Model`], within stated limits |
//! | [`model`] | the imported mesh: vertices, triangles, base colours |
//! | [`texture`] | linear-light texture look-up with wrap modes and mip chain |
//! | [`repair`] | what is wrong with a mesh: [`MeshReport`] |
//! | [`voxelise`](mod@voxelise) | solid voxels by generalised winding number |
//! | [`thickness`] | where a print is thin: [`ThicknessReport`] |
//! | [`target`] | the colour of each surface voxel |
//! | [`error`] | [`MeshError`] |
//!
//! Positions are metres in print axes: z is up, so glTF's `(x, y, z)` is `(x, -z, y)` here.
//! Colours are linear Rec.709.
#![forbid(unsafe_code)]

mod bvh;
mod digest;
pub mod error;
mod geometry;
pub mod import;
pub mod model;
pub mod repair;
#[cfg(test)]
mod shapes;
pub mod target;
pub mod texture;
pub mod thickness;
mod topology;
pub mod voxelise;
mod weld;
mod winding;

pub use error::MeshError;
pub use import::{ImportLimits, import_path, import_slice};
pub use model::{BaseColor, Model, Note, Triangle, Vertex};
pub use repair::MeshReport;
pub use target::surface_colors;
pub use texture::{Filter, Image, Mip, Sampler, Texture, Wrap};
pub use thickness::{ThicknessReport, ThinRegion};
pub use voxelise::{Placement, Scale, VoxeliseOptions, Voxelised, voxelise};
