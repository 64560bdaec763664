//! Colour for translucent prints: spaces and differences, exact reflectance of plane-parallel
//! layers, and the tables between material mixtures and colours.
//!
//! | module | owns |
//! | --- | --- |
//! | [`plane_parallel`] | deterministic radiance of half-spaces, slabs and layer stacks |
//!
//! Conventions: RGB is linear Rec.709 under D65 with media white at 1 unless a name says
//! otherwise; lengths are millimetres and coefficients 1/mm.
#![forbid(unsafe_code)]

pub mod error;
pub mod plane_parallel;

pub use error::ColorError;
