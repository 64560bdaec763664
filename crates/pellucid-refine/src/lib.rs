//! Scattering-aware refinement of multi-material 3D prints.
//!
//! Light spreads through printing resin, so a texture printed as it is comes out blurred and pale.
//! The refinement predicts a print's appearance, compares it with the target and corrects the
//! material arrangement below the surface, a few times over (Sumin et al. 2019; Rittig et al.
//! 2021, section 2.3).
#![forbid(unsafe_code)]

mod demand;
pub mod error;
pub mod gamut_ink;
mod halftone;
pub mod ink;
mod layers;
mod mask;
pub mod predictor;
pub mod refinement;
pub mod report;
pub mod settings;
mod smoothing;

pub use error::RefineError;
pub use gamut_ink::GamutInk;
pub use ink::InkModel;
pub use mask::BlueNoiseMask;
pub use pellucid_predict::PredictError;
pub use predictor::{AppearancePredictor, Scene};
pub use refinement::{RefineInput, Refined, refine};
pub use report::{ErrorStats, IterationReport, RefineReport};
pub use settings::RefineSettings;
