//! How a model is read.

use super::source::Source;
use super::{IccProfile, ImportLimits, LengthUnit, UpAxis};
use crate::MeshError;

/// How a model is read: limits, and what a file does not say itself.
///
/// End a literal with `..ImportOptions::default()`: fields will be added.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(default))]
pub struct ImportOptions {
    /// Bounds on what a model may ask for.
    pub limits: ImportLimits,
    /// Length of one unit of the file's coordinates; the file's own or its format's habit without it.
    pub unit: Option<LengthUnit>,
    /// The file's axis that points up; its format's habit without it.
    pub up: Option<UpAxis>,
    /// Colour, linear Rec.709 in 0..1, of whatever the file gives none: all of an STL, and what has no
    /// material in the others. White by default. (What has no material in a glTF is white.)
    pub color: [f32; 3],
    /// Keep how opaque the model is ([`Model::opacity`](crate::Model::opacity)); without it all of it is opaque, and
    /// [notes](crate::Model::notes) say where that leaves something out.
    pub opacity: bool,
    /// What the colours of textures are where a texture embeds no profile; sRGB without it. glTF says that they are sRGB,
    /// and takes none. Colours that a file holds itself are its format's affair.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub icc: Option<IccProfile>,
}

impl Default for ImportOptions {
    fn default() -> Self {
        Self {
            limits: ImportLimits::default(),
            unit: None,
            up: None,
            color: [1.0; 3],
            opacity: false,
            icc: None,
        }
    }
}

impl From<ImportLimits> for ImportOptions {
    fn from(limits: ImportLimits) -> Self {
        Self { limits, ..Self::default() }
    }
}

impl ImportOptions {
    pub(super) fn check(&self, source: &Source) -> Result<(), MeshError> {
        if self.color.iter().all(|c| (0.0..=1.0).contains(c)) {
            return Ok(());
        }
        Err(source.invalid(
            "ImportOptions::color",
            format!("{:?} is not within 0..1", self.color),
            "give a linear RGB colour",
        ))
    }
}
