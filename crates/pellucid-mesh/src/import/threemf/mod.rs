//! 3MF, the 3D Manufacturing Format: a zip package of XML models and textures.
//!
//! Read: objects of triangles, components and build items with their transforms, the unit, models in
//! other parts of the package (production extension), base materials, and of the materials extension
//! colour groups, textures, composite materials (the mean of their shares) and multi-properties.
//! Colours are sRGB, as the format says, and blended in linear light.
//!
//! Left out with a note: objects that are support or otherwise no part of the model, opacity
//! (unless [`ImportOptions::opacity`](crate::ImportOptions::opacity) asks for it), the
//! painting of slicers (which keep it in attributes of their own), beam lattices where they are not
//! required. Of multi-properties one texture shows, and a texture mixed over others hides them.
//!
//! Refused: extensions that a package requires and that are not read, encrypted parts, document type
//! definitions, part names that leave the package. What a part takes unpacked counts against
//! [`ImportLimits::file_bytes`](crate::ImportLimits::file_bytes) before and while it is unpacked.

mod build;
mod matrix;
mod package;
mod paint;
mod part;
mod resources;
mod xml;

use super::LengthUnit;
use super::source::Source;
use crate::{MeshError, Model};
use build::Build;
use package::Package;

/// The remedy where only the program that wrote the file can help.
const REEXPORT: &str = "the file is damaged or no valid 3MF; export it again";

/// Reads a model.
pub(super) fn read(source: &Source, bytes: &[u8]) -> Result<Model, MeshError> {
    let package = Package::open(source, bytes)?;
    let root = package.root()?;
    let mut build = Build::new(source, &package, &root)?;
    build.place_all()?;
    build.finish()
}

/// The unit of a model's attribute.
fn unit(name: &str) -> Option<LengthUnit> {
    Some(match name {
        "micron" => LengthUnit::Micrometre,
        "millimeter" => LengthUnit::Millimetre,
        "centimeter" => LengthUnit::Centimetre,
        "inch" => LengthUnit::Inch,
        "foot" => LengthUnit::Foot,
        "meter" => LengthUnit::Metre,
        _ => return None,
    })
}
