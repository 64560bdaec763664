//! Print targets and slice export for multi-material inkjet printers.
//!
//! | module | owns |
//! | --- | --- |
//! | [`target`] | what a printer accepts: pitch, build space, limits, palette, image row order |
//! | [`profile`] | printers by name, and as JSON |
//! | [`check`](mod@check) | whether a printer can hold what is to be printed |
//! | [`export`](mod@export) | a label grid as slices and a manifest |
//! | [`container`] | what slices are written as: a PNG stack, GCVF, NRRD, NPY |
//! | [`manifest`] | `manifest.json`, everything another tool needs to use the slices |
//! | [`recorded`] | settings of other programs inside a manifest |
//! | [`read`] | the way back: slices as a label grid |
//! | [`images`], [`image_list`] | stacks of other tools' images as label grids |
//! | [`coupon`](mod@coupon) | a test print that shows whether the printer mirrors |
//!
//! Layer 0 is the bottom, z grows upwards, x grows along an image row. [`RowOrder`] says which end
//! of y comes first; the built-in profile makes an image viewer show a layer as seen from above.
//!
//! ```
//! use pellucid_slice::{ExportSettings, PrintTarget, export, read_stack};
//! use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let target = PrintTarget::j750();
//! let mut grid = LabelGrid::new(Frame::new([0.0; 3], target.pitch(), [50, 20, 40])?);
//! grid.set([10, 5, 39], 3);
//! # let temp = tempfile::tempdir()?;
//! # let out = temp.path().join("print");
//! let settings = ExportSettings { seed: 7, ..Default::default() };
//! let manifest = export(&grid, &MaterialTable::cmykw(), &target, &settings, &out, &Control::none())?;
//! assert_eq!((manifest.layers, manifest.materials[0].name.as_str()), (40, "yellow"));
//! assert!(out.join("slices/slice_00039.png").exists());
//! let (back, _) = read_stack(&out, &Control::none())?;
//! assert!(back == grid);
//! # Ok(())
//! # }
//! ```
#![forbid(unsafe_code)]

pub mod check;
pub mod container;
pub mod coupon;
mod decode;
mod encode;
pub mod error;
pub mod export;
mod export_settings;
pub mod image_list;
pub mod images;
mod json;
pub mod manifest;
pub mod profile;
pub mod read;
pub mod recorded;
mod slab;
pub mod target;

pub use check::{check, check_extent, check_materials};
pub use container::Container;
pub use coupon::coupon;
pub use error::SliceError;
pub use export::{export, own_files, write_stack};
pub use export_settings::ExportSettings;
pub use image_list::list_images;
pub use images::{ImageStack, read_images};
pub use manifest::{Manifest, ManifestMaterial};
pub use read::read_stack;
pub use recorded::Recorded;
pub use target::{PrintTarget, RowOrder};

/// The README's example, compiled and run by the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
