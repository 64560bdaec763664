//! Textured triangle meshes for multi-material 3D prints.
//!
//! | module | owns |
//! | --- | --- |
//! | [`model`] | the imported mesh: vertices, triangles, base colours |
//! | [`texture`] | linear-light texture look-up with wrap modes and mip chain |
//! | [`error`] | [`MeshError`] |
//!
//! Positions are metres in print axes: z is up, so glTF's `(x, y, z)` is `(x, -z, y)` here.
//! Colours are linear Rec.709.
#![forbid(unsafe_code)]

pub mod error;
pub mod model;
pub mod texture;

pub use error::MeshError;
pub use model::{BaseColor, Model, Note, Triangle, Vertex};
pub use texture::{Filter, Mip, Sampler, Texture, Wrap};
