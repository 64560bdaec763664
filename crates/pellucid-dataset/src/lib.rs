//! Procedural volumes for training and judging appearance predictors (Rittig et al. 2021, section 4.1).
//!
//! Everything follows from a [`Recipe`] and its seed, so a volume is stored as its number.
//!
//! | module | owns |
//! | --- | --- |
//! | [`recipe`] | what a set consists of, and the draw of each volume |
//! | [`shape`] | the solids, as signed distances |
//! | [`texture`] | material arrangements: patterns, mixtures, halftone |
//! | [`noise`] | the noise they are made of |
//! | [`volume`] | voxels |
#![forbid(unsafe_code)]

pub mod error;
pub mod noise;
pub mod recipe;
pub mod shape;
pub mod texture;
pub mod volume;

pub use error::DatasetError;
pub use recipe::{Recipe, ShapeClass, Split};
