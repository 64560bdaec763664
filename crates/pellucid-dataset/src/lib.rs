//! Procedural volumes for training and judging appearance predictors (Rittig et al. 2021, section 4.1).
//!
//! Everything follows from a [`Recipe`] and its seed, so a volume is stored as its number.
//!
//! | module | owns |
//! | --- | --- |
//! | [`recipe`] | what a set consists of, and the draw of each volume |
//! | [`volume`] | the voxels of a volume: solid, material arrangement, halftone |
//! | [`labels`] | labelled points of volumes, files of them, and judging predictions by them |
//! | `training` | runs of the network's trainer, and its errors on sets (feature `training`) |
//! | [`stream`] | an endless stream of training batches |
//!
//! A set is made, read and judged by:
//! ```
//! use pellucid_dataset::{LabelledSet, Recipe, SetHeader, Shard, generate, judge};
//! use pellucid_voxel::{Control, MaterialTable};
//! let recipe: Recipe = serde_json::from_str(
//!     r#"{"name": "tiny", "seed": 1, "pitch": [0.0423, 0.0847, 0.027], "size_mm": [1.0, 1.5], "large_mm": 1.5,
//!     "large_share": 0.0, "refractive_index": 1.5, "splits": [{"name": "test", "volumes": 2, "points": 8,
//!     "spp": 32, "shapes": [["cube", 1.0], ["sphere", 1.0]], "density": 1.0}]}"#,
//! )?;
//! let header =
//!     SetHeader { recipe, split: "test".into(), materials: MaterialTable::cmykw(), shard: Shard::WHOLE };
//! let folder = tempfile::tempdir()?;
//! let file = generate(folder.path(), &header, &Control::none())?;
//! let set = LabelledSet::load(&[file], &Control::none())?;
//! // A predictor that sees nothing.
//! use pellucid_stencil::FirstFlight;
//! let grey = |_: &[f32], _: &[FirstFlight], radiance: &mut [f32]| {
//!     radiance.fill(0.5);
//!     Ok(())
//! };
//! let judgement = judge(&set, grey, &Control::none())?;
//! assert_eq!(judgement.whole.score.count(), 2 * 8 * 3);
//! assert!(judgement.whole.score.rmse() > 0.05);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod error;
pub mod labels;
pub mod recipe;
pub mod stream;
#[cfg(feature = "training")]
pub mod training;
pub mod volume;

pub use error::DatasetError;
pub use labels::{
    Errors, HalfStencils, Judgement, LabelledSet, Labelling, STENCIL_VALUES, Sampler, Samples, SetHeader,
    SetInfo, Shard, StoredVolumes, generate, info, join, judge, verify,
};
pub use recipe::{Halftone, Neighbours, OtherInks, Pale, Recipe, ShapeClass, Split};
pub use stream::{Prints, Stream, StreamOptions};

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
