//! Scattering-aware preparation of full-colour 3D prints.
//!
//! Resins are translucent: light spreads inside a print and blurs its texture. This library turns a textured
//! model into voxel slices whose printed appearance, after that, comes as close to the texture as the
//! materials allow (Rittig et al. 2021; Sumin et al. 2019).
//!
//! # The whole job
//! [`PrintJob`] makes four artefacts, each of which a tool may keep, inspect or replace: [`Placed`](job::Placed)
//! (which voxels are solid, and their texture), [`Aimed`](job::Aimed) (what each surface voxel should show),
//! [`Refined`](job::Refined) (the labels to print) and [`Judged`](job::Judged) (what fresh paths say of them).
//!
//! ```
//! # #[cfg(feature = "job")] {
//! use pellucid::voxel::{Frame, LabelGrid};
//! use pellucid::{Monitor, PrintJob, PrintSettings, Workspace};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut settings = PrintSettings { spp: Some(2), ..PrintSettings::default() };
//! settings.refine.iterations = Some(1);
//! let job = PrintJob::new(settings)?;
//! // Half a millimetre of a tool's own voxels; `prepare` takes a model of `mesh::import_path` instead.
//! let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [12, 6, 18])?;
//! let block = LabelGrid::from_fn(frame, |_| 1);
//! let color = |[x, _, _]: [u32; 3]| if x < 6 { [0.8, 0.2, 0.1] } else { [0.9, 0.9, 0.8] };
//! let prepared = job.prepare_volume("block", &block, color, &Workspace::none(), &Monitor::silent())?;
//! assert!(prepared.judged.evaluation.refined.voxel.printable.mean.is_finite());
//! # Ok(()) }
//! # main().unwrap() }
//! ```
//!
//! Before that, [`PrintJob::preview`] shows within seconds what a model would look like without refinement, and where its
//! colours are out of reach and its parts too thin.
//!
//! # The tour
//! | module | what it is for | feature |
//! | --- | --- | --- |
//! | [`core`](mod@core) | progress, cancellation, error texts, whole files | always |
//! | [`voxel`] | label grids, surfaces, distance maps, summed-area tables | always; `ndarray` for its arrays |
//! | `halftone` | blue-noise masks | `refine` |
//! | `mesh` | import (glTF; other formats by features) and voxelisation | `mesh`; `obj`, `ply`, `stl`, `3mf`, `webp`, `meshopt`, `icc`, `spectral` |
//! | `color` | colour spaces, mixtures, gamuts, from radiance to colour | `color` |
//! | `calibration` | charts to print, and files of what their measurements say | `calibration` |
//! | `stencil` | the hierarchical descriptor that the network sees | `stencil` |
//! | `rpnn` | the network, its trainer and weights | `rpnn`, `weights`, `candle` |
//! | `trace` | the volumetric path tracer | `trace` |
//! | `predict` | one interface over tracer and network | `predict`, `mc`, `rpnn` |
//! | `refine` | the loop that rearranges materials, and the judge | `refine` |
//! | `slice` | print targets and slices | `slice`; `gcvf`, `nrrd`, `npy` for those containers |
//! | `proof` | pictures of the print, a page and a model to look at | `proof`; `html` for the page, `glb` for the model |
//! | `dataset` | procedural volumes and labelled samples | `dataset` |
//! | `training` | training runs, and a network's errors on labelled sets | `training` |
//!
//! `job`, the default, is what [`PrintJob`] needs, with the path tracer as predictor. `weights` adds the network.
//! Features only add: no feature changes what another one does, or a default.
#![forbid(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

pub use pellucid_core as core;
pub use pellucid_voxel as voxel;

#[cfg(feature = "color")]
pub use pellucid_color as color;
#[cfg(feature = "dataset")]
pub use pellucid_dataset as dataset;
#[cfg(feature = "training")]
pub use pellucid_dataset::training;
#[cfg(feature = "refine")]
pub use pellucid_halftone as halftone;
#[cfg(feature = "mesh")]
pub use pellucid_mesh as mesh;
#[cfg(feature = "predict")]
pub use pellucid_predict as predict;
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

#[cfg(feature = "calibration")]
pub mod calibration;
#[cfg(feature = "job")]
pub mod choice;
#[cfg(feature = "job")]
pub mod error;
#[cfg(feature = "job")]
mod error_histogram;
#[cfg(feature = "job")]
pub mod job;
#[cfg(feature = "job")]
mod memory;
#[cfg(feature = "job")]
mod monitor;
#[cfg(feature = "job")]
mod network_weights;
#[cfg(feature = "job")]
mod picture_error;
#[cfg(feature = "job")]
mod predictors;
#[cfg(feature = "job")]
pub mod record;
#[cfg(feature = "job")]
pub mod report;
#[cfg(feature = "job")]
mod resins;
#[cfg(feature = "job")]
pub mod settings;
#[cfg(feature = "job")]
pub mod stage;
#[cfg(feature = "job")]
mod workspace;

#[cfg(feature = "job")]
pub use choice::{Choice, Trial};
#[cfg(feature = "job")]
pub use error::PrintError;
#[cfg(feature = "job")]
pub use job::{Prepared, PrintJob};
#[cfg(feature = "job")]
pub use memory::MemoryNeed;
#[cfg(feature = "job")]
pub use monitor::Monitor;
#[cfg(feature = "job")]
pub use network_weights::NetworkWeights;
#[cfg(feature = "job")]
pub use record::{ModelRecord, Record};
#[cfg(feature = "job")]
pub use report::Report;
#[cfg(feature = "job")]
pub use settings::{GradientKind, PredictorKind, PrintSettings, StrategyKind};
#[cfg(feature = "job")]
pub use workspace::Workspace;

/// The README's example, compiled and run by the tests.
#[cfg(all(doctest, feature = "job"))]
#[doc = include_str!("../README.md")]
struct Readme;
