//! Soft proofs: what each surface voxel will look like, as pictures from fixed directions and as a page for browsers.
//!
//! Pictures are flat: a pixel shows the colour of the surface voxel behind it and nothing else, so that colours can
//! be read off. Views are orthographic.
//!
//! | type or function | what it is |
//! | --- | --- |
//! | [`View`] | a direction to look from |
//! | [`Visibility`] | which surface voxel each ray of a picture sees |
//! | [`Picture`] | linear colours and coverage |
//! | [`SrgbImage`] | eight bits, to look at and to write as PNG |
//! | [`contact_sheet`] | pictures side by side on mid grey |
//! | [`false_color`] | a quantity as a colour |
//! | [`Proof`] | states of a print and its errors in every view, and their files |
//! | [`SurfaceMesh`] | a mesh of the surface voxels, for viewers |
//! | `page` (feature `html`) | the proof as one page: views, slices, figures |
//! | `glb` (feature `glb`) | what the print looks like as a glTF model |
//! | `write_exr` (feature `exr`) | linear pictures as the layers of one file |
//!
//! ```
//! use pellucid_proof::{View, Visibility, contact_sheet};
//! use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions, Tile};
//!
//! let frame = Frame::new([0.0; 3], Pitch::j750(), [24, 12, 36])?;
//! let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
//! let none = Control::none();
//! let surface = Surface::extract(&grid, &SurfaceOptions::default(), &none)?;
//! let view = View::new("front", 25.0, 20.0)?;
//! let seen = Visibility::trace(&grid, &surface, &view, 64, &none)?;
//! let colors = vec![[0.8, 0.4, 0.1]; surface.len()];
//! let picture = seen.shade(&colors, &none)?;
//! let sheet = contact_sheet(&[vec![picture.clone(), picture]], &none)?;
//! let mut png = Vec::new();
//! sheet.encode_png(&mut png)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod contact_sheet;
mod error;
#[cfg(feature = "exr")]
mod exr;
mod false_color;
#[cfg(feature = "glb")]
pub mod glb;
#[cfg(feature = "html")]
pub mod page;
mod picture;
mod png;
mod proof;
mod srgb_image;
mod surface_mesh;
mod values;
mod view;
mod visibility;

#[cfg(feature = "exr")]
pub use crate::exr::write_exr;
pub use contact_sheet::contact_sheet;
pub use error::ProofError;
pub use false_color::false_color;
pub use picture::Picture;
pub use proof::{ERROR_SCALE, Proof};
pub use srgb_image::SrgbImage;
pub use surface_mesh::SurfaceMesh;
pub use view::View;
pub use visibility::{EDGE_RANGE, Visibility};

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
