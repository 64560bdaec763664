//! Colour for translucent prints: spaces and differences, exact reflectance of plane-parallel
//! layers, and the tables between material mixtures and colours.
//!
//! | module | owns |
//! | --- | --- |
//! | [`space`] | sRGB transfer, linear Rec.709, XYZ, Lab, LCh, Oklab |
//! | [`delta_e`] | CIEDE2000 |
//! | [`spectrum`] | spectra of any bands to XYZ and RGB, under illuminants and for observers |
//! | [`upsampling`] | the smooth reflectance that a colour may have |
//! | [`constancy`] | how colours and pairs of them change from one viewing to another |
//! | [`plane_parallel`] | deterministic radiance of half-spaces, slabs and layer stacks |
//! | `calibration` | materials from measured patches (feature `calibration`) |
//! | [`ReflectanceCurve`] | half-space radiance as a fast function of albedo |
//! | [`mixture`] | volume fractions to colour, its exact inverse, and the inverse as a table |
//! | [`gamut`] | printable colours of thick and thin parts |
//! | [`Viewing`] | radiance of any channels to colour, and back |
//! | [`intent`] | media white, rendering intents, black point |
//!
//! Conventions: RGB is linear Rec.709 under D65 with media white at 1 unless a name says
//! otherwise; lengths are millimetres and coefficients 1/mm.
#![forbid(unsafe_code)]

#[cfg(feature = "calibration")]
pub mod calibration;
pub mod constancy;
mod cube;
mod curve;
pub mod delta_e;
mod error;
pub mod gamut;
pub mod intent;
pub mod mixture;
pub mod plane_parallel;
pub mod space;
pub mod spectrum;
pub mod upsampling;
mod viewing;

pub use curve::ReflectanceCurve;
pub use delta_e::delta_e_2000;
pub use error::ColorError;
pub use gamut::{Gamut, GamutReport, Mapped, ThicknessGamut};
pub use intent::{MediaWhite, Rendering, RenderingIntent};
pub use mixture::inverse::MatchOptions;
pub use mixture::{Fractions, MixtureModel};
pub use pellucid_core::ErrorStats;
pub use space::{Lab, Lch, Oklab, Xyz};
pub use viewing::Viewing;

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
