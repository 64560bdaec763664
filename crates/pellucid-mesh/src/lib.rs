//! Textured triangle meshes for multi-material 3D prints.
//!
//! | module | owns |
//! | --- | --- |
//! | [`import`] | model files (glTF, OBJ, 3MF, PLY, STL) into a [`Model`], within stated limits |
//! | [`model`] | the imported mesh: vertices, triangles, base colours |
//! | [`opacity`] | where a model is see-through |
//! | [`texture`] | linear-light texture look-up with wrap modes and mip chain |
//! | [`spectral_image`] | textures of reflectances by wavelength |
//! | [`placement`] | how large a model is printed, and where it lies in print space |
//! | [`placed`] | a model in print space, its mesh analysed once for what follows |
//! | [`solid_size`] | how large its solid is, before it is voxelised |
//! | [`mesh_report`] | what is wrong with a mesh: [`MeshReport`] |
//! | [`mesh_places`] | where that is: [`MeshPlaces`] |
//! | [`voxelise`](mod@voxelise) | solid voxels by generalised winding number |
//! | [`thickness`] | where a print is thin: [`ThicknessReport`] |
//! | [`target`] | the colour of each surface voxel |
//! | [`bake`](mod@bake) | a mesh with one new texture, on its own UV map or a new atlas |
//! | [`export`] | textured meshes as GLB, OBJ and 3MF |
//! | [`error`] | [`MeshError`] |
//!
//! Positions are metres in print axes: z is up, so glTF's `(x, y, z)` is `(x, -z, y)` here.
//! Colours are linear Rec.709.
#![forbid(unsafe_code)]

pub mod bake;
mod bvh;
mod digest;
mod edges;
pub mod error;
pub mod export;
mod geometry;
mod hull;
pub mod import;
pub mod mesh_places;
pub mod mesh_report;
pub mod model;
mod nearest;
mod nesting;
pub mod opacity;
pub mod placed;
pub mod placement;
#[cfg(test)]
mod shapes;
mod shell;
pub mod solid_size;
pub mod spectral_image;
pub mod target;
pub mod texture;
pub mod thickness;
mod topology;
pub mod voxelise;
mod weld;
mod winding;

pub use error::MeshError;
pub use import::{ImportLimits, ImportOptions, LengthUnit, ReadAs, UpAxis, import_path, import_slice};
pub use mesh_places::MeshPlaces;
pub use mesh_report::MeshReport;
pub use model::{BaseColor, Model, Note, Triangle, Vertex};
pub use opacity::Opacity;
pub use placed::PlacedMesh;
pub use placement::{Placement, Scale};
pub use solid_size::SolidSize;
pub use spectral_image::SpectralImage;
pub use target::surface_colors;
pub use texture::{Filter, Image, Mip, Sampler, Texture, Wrap};
pub use thickness::{ThicknessReport, ThinRegion};
pub use voxelise::{VoxeliseOptions, Voxelised, voxelise};

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
