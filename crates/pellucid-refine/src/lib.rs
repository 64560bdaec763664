//! Scattering-aware refinement of multi-material 3D prints.
//!
//! Light spreads through printing resin, so a texture printed as it is comes out blurred and pale. A refinement predicts
//! a print's appearance, compares it with the target and corrects the material arrangement below the surface, a few
//! times over (Sumin et al. 2019; Rittig et al. 2021, section 2.3).
//!
//! A [`Problem`] says what is refined towards what. A [`Strategy`], such as [`SurfaceFirst`], says how; a
//! [`Refinement`] steps it, saves it and resumes it, and [`refine`] is the whole loop. A [`Judge`] says how good any
//! labels are.
//!
//! An ink model and a predictor of one's own, which sees a voxel and the one below it, and a refinement with them:
//! ```
//! # use std::sync::Arc;
//! # use pellucid_color::{MediaWhite, Viewing};
//! # use pellucid_predict::{BoundPredictor, Changed, Diagnostics, Draw, Object, PredictError};
//! # use pellucid_refine::{InkModel, Problem, RefineSettings, SurfaceFirst, refine};
//! # use pellucid_voxel::*;
//! struct Grey; // black (label 4) and white (5), in proportion
//! impl InkModel for Grey {
//!     fn labels(&self) -> &[u8] { &[4, 5] }
//!     fn fractions(&self, rgb: [f32; 3], out: &mut [f32]) -> [f32; 3] {
//!         out[1] = rgb[1].clamp(0.0, 1.0);
//!         out[0] = 1.0 - out[1];
//!         self.color(out)
//!     }
//!     fn color(&self, fractions: &[f32]) -> [f32; 3] { [fractions[1]; 3] }
//! }
//! struct Two(Arc<Object>, LabelGrid);
//! impl BoundPredictor for Two {
//!     fn update(&mut self, labels: &LabelGrid, _: Changed<'_>, _: &Control<'_>) -> Result<(), PredictError> {
//!         self.1 = labels.clone();
//!         Ok(())
//!     }
//!     fn predict(&self, points: &[u32], _: Draw, out: &mut [f32], _: &Control<'_>) -> Result<Diagnostics, PredictError> {
//!         for (&p, out) in points.iter().zip(out.chunks_exact_mut(3)) {
//!             let [x, y, z] = self.0.surface().voxels()[p as usize].map(i64::from);
//!             out.fill([z, z - 1].iter().map(|&z| if self.1.at([x, y, z]) == 4 { 0.0 } else { 0.4 }).sum());
//!         }
//!         Ok(Diagnostics::default())
//!     }
//! }
//! # let frame = Frame::new([0.0; 3], Pitch::new([0.05; 3])?, [24, 24, 24])?;
//! # let mut labels = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
//! # let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none())?;
//! # let nearest = NearestSurface::build(&labels, &surface, 0.4, &Control::none())?;
//! # let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5)?);
//! let viewing = Viewing::rgb(MediaWhite::new([0.8; 3])?);
//! let target = vec![[0.5; 3]; object.surface().len()];
//! let problem = Problem {
//!     object: &object, nearest: &nearest, ink: &Grey, viewing: &viewing, target: &target, printable_target: &target,
//!     further: &[],
//! };
//! let settings = RefineSettings { iterations: Some(2), coloured_depth_mm: 0.4, ..RefineSettings::default() };
//! let mut bound = Two(object.clone(), labels.clone());
//! let refined = refine(&mut labels, problem, SurfaceFirst::default(), settings, &mut bound, &Control::none())?;
//! assert_eq!(refined.report.iterations.len(), 3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod descent;
mod difference;
mod error;
mod gamut_ink;
mod halftone;
mod ink;
mod judge;
mod layers;
mod low_pass;
pub mod packed;
mod problem;
mod refinement;
mod report;
mod residual;
mod saved;
mod settings;
mod smoothing;
mod strategy;
mod surface_color;
mod surface_first;
mod viewed;

pub use descent::{Descent, DescentState, DescentTools, StepRule};
pub use error::RefineError;
pub use gamut_ink::GamutInk;
pub use ink::InkModel;
pub use judge::{
    ClassErrors, ColorClass, Effort, ErrorShares, Errors, Evaluation, Judge, JudgeInput, Judged, MeanColor,
    Sharpness, StateErrors,
};
pub use layers::Layers;
pub use problem::{Aim, Problem};
pub use refinement::{Refined, Refinement, refine};
pub use report::{IterationReport, RefineReport};
pub use saved::Saved;
pub use settings::RefineSettings;
pub use smoothing::SurfaceSmoother;
pub use strategy::{Cell, LayerMixtures, Mixtures, Moved, Planned, Seen, Setup, Strategy};
pub use surface_color::{SurfaceColor, SurfaceColorState};
pub use surface_first::{SurfaceFirst, SurfaceFirstState};
pub use viewed::Viewed;

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
