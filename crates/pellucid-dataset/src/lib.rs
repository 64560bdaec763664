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
//! | [`blue_noise`] | thresholds of a refined print's halftone |
//! | [`volume`] | voxels |
//! | [`samples`] | labelled points of a volume: stencils and radiance |
//! | [`generate`](mod@generate) | files of labelled points: made in shards, resumed, verified |
//! | [`set_file`] | their format |
//! | [`set`] | such a set in memory |
//! | [`judge`](mod@judge) | errors of predictions on such a set, by family of shapes |
//! | [`stored`] | its volumes as the files hold them |
//! | [`stream`] | an endless stream of training batches |
#![forbid(unsafe_code)]

pub mod blue_noise;
mod draw;
pub mod error;
pub mod generate;
pub mod judge;
pub mod noise;
pub mod recipe;
pub mod samples;
pub mod set;
pub mod set_file;
pub mod shape;
pub mod stored;
pub mod stream;
pub mod texture;
pub mod volume;

pub use error::DatasetError;
pub use generate::{SetInfo, generate, info, verify};
pub use judge::{Judgement, ShapeScore, judge};
pub use recipe::{Recipe, ShapeClass, Split};
pub use samples::{Labels, STENCIL_VALUES, Sampler, Samples};
pub use set::LabelledSet;
pub use set_file::{SetHeader, Shard};
pub use stored::StoredVolumes;
pub use stream::{Stream, StreamOptions};
