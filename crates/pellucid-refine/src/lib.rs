//! Scattering-aware refinement of multi-material 3D prints.
//!
//! Light spreads through printing resin, so a texture printed as it is comes out blurred and pale.
//! The refinement predicts a print's appearance, compares it with the target and corrects the
//! material arrangement below the surface, a few times over (Sumin et al. 2019; Rittig et al.
//! 2021, section 2.3).
//!
//! | module | owns |
//! | --- | --- |
//! | [`refine`](mod@refine) | the loop: [`refine()`], its input and observer |
//! | [`predictor`] | the trait that a path tracer or a network implements |
//! | [`ink`] | the trait of a colour model, and its adapter to `pellucid-color` |
//! | [`mask`] | the three-dimensional blue-noise threshold mask |
//! | [`settings`], [`report`], [`error`] | settings, results, errors |
//!
//! Conventions: lengths are millimetres; colours are linear Rec.709 relative to the print's white;
//! radiances are absolute.
#![forbid(unsafe_code)]

mod demand;
pub mod error;
pub mod gamut_ink;
mod halftone;
pub mod ink;
mod layers;
pub mod mask;
mod metrics;
pub mod predictor;
pub mod refinement;
pub mod report;
pub mod settings;
mod smoothing;

pub use error::{PredictError, RefineError};
pub use gamut_ink::GamutInk;
pub use ink::InkModel;
pub use mask::BlueNoiseMask;
pub use predictor::{AppearancePredictor, Scene};
pub use refinement::{RefineInput, Refined, refine};
pub use report::{ErrorStats, IterationReport, RefineReport};
pub use settings::RefineSettings;
