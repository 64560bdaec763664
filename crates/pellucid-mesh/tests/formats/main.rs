//! Import of the formats beside glTF through the public API.
#![cfg(all(feature = "obj", feature = "ply", feature = "stl", feature = "3mf"))]

mod clear;
#[path = "../common/mod.rs"]
mod common;
mod conformance;
#[allow(dead_code, reason = "the writer is shared with the tests of glTF")]
#[path = "../import/glb.rs"]
mod glb;
mod mutants;
mod obj;
mod ply;
mod refused;
mod scene;
mod stl;
mod threemf;
#[cfg(feature = "webp")]
mod webp;
