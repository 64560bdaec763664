//! glTF import through the public API.

mod color;
mod errors;
mod geometry;
mod glb;
#[cfg(feature = "meshopt")]
mod meshopt;
