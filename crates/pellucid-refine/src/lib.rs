//! Scattering-aware refinement of multi-material 3D prints.
//!
//! Light spreads through printing resin, so a texture printed as it is comes out blurred and pale. A refinement predicts
//! a print's appearance, compares it with the target and corrects the material arrangement below the surface, a few
//! times over (Sumin et al. 2019; Rittig et al. 2021, section 2.3).
//!
//! A [`Problem`] says what is refined towards what. A [`Strategy`], such as [`SurfaceFirst`], says how; a
//! [`Refinement`] steps it, saves it and resumes it, and [`refine`] is the whole loop. A [`Judge`] says how good any
//! labels are.
#![forbid(unsafe_code)]

mod difference;
mod error;
mod gamut_ink;
mod halftone;
mod ink;
mod judge;
mod layers;
pub mod packed;
mod problem;
mod refinement;
mod report;
mod saved;
mod settings;
mod smoothing;
mod strategy;
mod surface_first;

pub use error::RefineError;
pub use gamut_ink::GamutInk;
pub use ink::InkModel;
pub use judge::{
    ClassErrors, ColorClass, Effort, Errors, Evaluation, Judge, JudgeInput, Judged, Sharpness, StateErrors,
};
pub use layers::Layers;
pub use problem::Problem;
pub use refinement::{Refined, Refinement, refine};
pub use report::{IterationReport, RefineReport};
pub use saved::Saved;
pub use settings::RefineSettings;
pub use smoothing::SurfaceSmoother;
pub use strategy::{Cell, LayerMixtures, Mixtures, Planned, Seen, Setup, Strategy};
pub use surface_first::{SurfaceFirst, SurfaceFirstState};
