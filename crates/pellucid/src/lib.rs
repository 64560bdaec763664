//! Scattering-aware preparation of full-colour 3D prints.
//!
//! Resins are translucent: light spreads inside a print and blurs its texture. This library turns a textured
//! model into voxel slices whose printed appearance, after that, comes as close to the texture as the
//! materials allow (Rittig et al. 2021; Sumin et al. 2019).
//!
//! # The tour
//! 1. [`mesh`] imports glTF and decides which voxels are solid.
//! 2. [`voxel`] holds labels, surface voxels and distance maps.
//! 3. [`color`] knows which colours the materials can mix.
//! 4. [`trace`] predicts radiance by path tracing; [`predictor`] adapts it to
//! 5. [`refine`], the loop that rearranges materials until prediction and target agree.
//! 6. [`slice`](mod@slice) writes what the printer reads, [`proof`] what it will look like.
//!
//! [`PrintJob`] does all of it. Each step is a cargo feature; `job`, the default, is all of them.
#![forbid(unsafe_code)]

pub use pellucid_voxel as voxel;

#[cfg(feature = "color")]
pub use pellucid_color as color;
#[cfg(feature = "dataset")]
pub use pellucid_dataset as dataset;
#[cfg(feature = "mesh")]
pub use pellucid_mesh as mesh;
#[cfg(feature = "proof")]
pub use pellucid_proof as proof;
#[cfg(feature = "refine")]
pub use pellucid_refine as refine;
#[cfg(feature = "rpnn")]
pub use pellucid_rpnn as rpnn;
#[cfg(feature = "slice")]
pub use pellucid_slice as slice;
#[cfg(feature = "stencil")]
pub use pellucid_stencil as stencil;
#[cfg(feature = "trace")]
pub use pellucid_trace as trace;

#[cfg(feature = "job")]
mod clock;
#[cfg(feature = "job")]
pub mod error;
#[cfg(feature = "job")]
mod evaluate;
#[cfg(feature = "job")]
pub mod job;
#[cfg(feature = "job")]
mod output;
#[cfg(any(feature = "mc", feature = "rpnn"))]
pub mod predictor;
#[cfg(feature = "job")]
pub mod report;
#[cfg(feature = "job")]
pub mod settings;
#[cfg(feature = "job")]
pub mod stage;
#[cfg(all(feature = "rpnn", feature = "dataset"))]
pub mod training;

#[cfg(feature = "job")]
pub use error::PrintError;
#[cfg(feature = "job")]
pub use job::{Prepared, PrintJob, ProofView};
#[cfg(feature = "job")]
pub use report::Report;
#[cfg(feature = "job")]
pub use settings::{PredictorKind, PrintSettings};
