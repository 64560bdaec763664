//! Predictors of the appearance of translucent prints.
//!
//! [`Predictor`] says how appearance is predicted; bound to an [`Object`] it becomes a [`BoundPredictor`], which holds
//! the tables and volumes of that one object and predicts the radiance of its surface points.
//!
//! | predictor | feature | what it is |
//! | --- | --- | --- |
//! | `MonteCarlo` | `mc` | unbiased path tracing, with the noise of its paths |
//! | `Network` | `rpnn` (`weights` for trained ones) | the appearance network, without noise, with errors of its own |
//! | `CandleNetwork` | `candle` (`cuda`, `metal`) | the same network in candle, on any of its devices |
//! | [`Shared`] | - | another one, whose work the members of a team share out |
//! | [`Corrected`] | - | a fast one whose error an unbiased one finds at some of the points, and which is taken out |
//! | [`Averaged`] | - | an unbiased one averaged over the passes of a loop; a fast one tells what changed in between |
//!
//! Feature `conformance` has the suite that all of them pass and one's own should, `serde` serialises identities,
//! settings and what was learned.
//!
//! A predictor of one's own: how bright the material of a point's own voxel is.
//!
//! ```
//! use std::sync::Arc;
//! use pellucid_predict::*;
//! use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};
//!
//! /// The albedo of each point's own material.
//! struct Albedo;
//!
//! struct BoundAlbedo {
//!     object: Arc<Object>,
//!     /// The label of each point; `None` until labels came.
//!     labels: Option<Vec<u8>>,
//! }
//!
//! impl Predictor for Albedo {
//!     fn identity(&self) -> Identity {
//!         Identity::new("albedo", InstructionSet::Portable, true)
//!     }
//!
//!     fn supports(&self, _: &Object) -> Result<Capabilities, PredictError> {
//!         Ok(Capabilities::new(false))
//!     }
//!
//!     fn bind(&self, object: Arc<Object>) -> Result<Box<dyn BoundPredictor>, PredictError> {
//!         Ok(Box::new(BoundAlbedo { object, labels: None }))
//!     }
//! }
//!
//! impl BoundPredictor for BoundAlbedo {
//!     fn update(
//!         &mut self,
//!         labels: &LabelGrid,
//!         _: Changed<'_>,
//!         control: &Control<'_>,
//!     ) -> Result<(), PredictError> {
//!         self.labels = None;
//!         self.object.check_labels(labels)?;
//!         control.check()?;
//!         let own: Vec<u8> = self.object.surface().voxels().iter().map(|v| labels.get(*v)).collect();
//!         match own.iter().find(|&&label| self.object.materials().get(label).is_none()) {
//!             Some(label) => Err(PredictError::invalid("labels", format!("label {label} has no material"))),
//!             None => {
//!                 self.labels = Some(own);
//!                 Ok(())
//!             }
//!         }
//!     }
//!
//!     fn predict(
//!         &self,
//!         points: &[u32],
//!         _: Draw,
//!         out: &mut [f32],
//!         control: &Control<'_>,
//!     ) -> Result<Diagnostics, PredictError> {
//!         let labels = self.labels.as_ref().ok_or_else(PredictError::before_update)?;
//!         self.object.check_points(points, out.len())?;
//!         control.check()?;
//!         let channels = self.object.channels();
//!         for (values, &point) in out.chunks_exact_mut(channels).zip(points) {
//!             for (channel, value) in values.iter_mut().enumerate() {
//!                 *value = self.object.materials().albedo(labels[point as usize], channel) as f32;
//!             }
//!         }
//!         Ok(Diagnostics::default())
//!     }
//! }
//!
//! let frame = Frame::new([0.0; 3], Pitch::j750(), [16; 3]).unwrap();
//! let labels = LabelGrid::from_tiles(frame, |_| Tile::Constant(5)); // a block of white
//! let control = Control::none();
//! let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control).unwrap();
//! let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5).unwrap());
//! let mut bound = Albedo.bind(Arc::clone(&object)).unwrap();
//! bound.update(&labels, Changed::Unknown, &control).unwrap();
//! let (radiance, _) = predict_all(&*bound, &object, Draw::new(0, Pass::Proof), &control).unwrap();
//! assert!(radiance.iter().all(|&l| l > 0.99));
//! # #[cfg(feature = "conformance")]
//! conformance::check(&Albedo, &conformance::Case::planted(3).unwrap()).unwrap();
//! ```
#![forbid(unsafe_code)]

mod averaged;
#[cfg(feature = "conformance")]
pub mod conformance;
mod corrected;
mod device;
pub mod error;
pub mod identity;
#[cfg(feature = "rpnn")]
mod labels;
#[cfg(feature = "mc")]
mod monte_carlo;
#[cfg(feature = "rpnn")]
mod network;
pub mod object;
mod pair;
#[cfg(feature = "mc")]
mod picture;
pub mod predictor;
mod shared;
mod sharing;
mod with_gradient;

pub use averaged::Averaged;
pub use corrected::{Corrected, Correction};
pub use device::NetworkDevice;
pub use error::PredictError;
pub use identity::{Identity, WeightsIdentity};
#[cfg(feature = "mc")]
pub use monte_carlo::MonteCarlo;
#[cfg(feature = "candle")]
pub use network::CandleNetwork;
#[cfg(feature = "rpnn")]
pub use network::Network;
pub use object::{Object, ObjectId};
pub use pellucid_core::InstructionSet;
#[cfg(feature = "mc")]
pub use picture::without_noise;
pub use predictor::{
    BoundPredictor, Capabilities, Changed, Diagnostics, Draw, Learned, MaterialGradient, Pass, Predictor,
    predict_all,
};
pub use shared::Shared;
pub use sharing::Sharing;
pub use with_gradient::WithGradient;

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
