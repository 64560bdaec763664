//! What slices are written as, and how each container is written and read.
//!
//! | container | file | for | feature |
//! | --- | --- | --- | --- |
//! | [`Container::Png`] | `slices/slice_00000.png` and upwards | printers' voxel tools | always |
//! | [`Container::Gcvf`] | `slices.gcvf` | GrabCAD Print | `gcvf` |
//! | [`Container::Nrrd`] | `labels.nrrd` | volume viewers, research tools | `nrrd` |
//! | [`Container::Npy`] | `labels.npy` | NumPy | `npy` |
//!
//! Each has `manifest.json` beside it, by which [`crate::read_stack`] reads any of them back.

#[cfg(feature = "gcvf")]
pub mod gcvf;
#[cfg(feature = "npy")]
pub mod npy;
#[cfg(feature = "nrrd")]
pub mod nrrd;
pub(crate) mod png_stack;
#[cfg(any(feature = "nrrd", feature = "npy"))]
pub(crate) mod volume;
pub(crate) mod writer;

use pellucid_core::Fault;
use serde::{Deserialize, Serialize};

use crate::manifest::FILE_PATTERN;
use crate::{PrintTarget, RowOrder, SliceError};

/// What slices are written as. No cargo feature adds or removes one; a build without the container's feature says so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Container {
    /// One RGBA PNG a layer.
    #[default]
    Png,
    /// GrabCAD's voxel file: the PNGs and what describes them in one zip archive.
    Gcvf,
    /// The labels as one NRRD volume.
    Nrrd,
    /// The labels as one NumPy array.
    Npy,
}

impl Container {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Png, Self::Gcvf, Self::Nrrd, Self::Npy];

    /// The name on the command line and in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Gcvf => "gcvf",
            Self::Nrrd => "nrrd",
            Self::Npy => "npy",
        }
    }

    /// What [`crate::Manifest::files`] says: the file in the output folder, or the images' names, printf style.
    pub fn files(self) -> &'static str {
        match self {
            Self::Png => FILE_PATTERN,
            Self::Gcvf => "slices.gcvf",
            Self::Nrrd => "labels.nrrd",
            Self::Npy => "labels.npy",
        }
    }

    /// The container of a manifest's `files`.
    pub(crate) fn of_files(files: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|container| container.files() == files)
    }

    /// Whether it goes to a printer, whose demands then count: colours, and a least number of layers.
    pub(crate) fn is_for_printers(self) -> bool {
        matches!(self, Self::Png | Self::Gcvf)
    }

    /// Which end of the y axis comes first. Volumes keep the grid's own order.
    pub(crate) fn row_order(self, target: &PrintTarget) -> RowOrder {
        if self.is_for_printers() { target.row_order() } else { RowOrder::LowestYFirst }
    }

    /// Colour of empty space.
    pub(crate) fn background(self, target: &PrintTarget) -> [u8; 4] {
        let [r, g, b, alpha] = target.background();
        // The readers of a GCVF compare colours without alpha, and its public writers say 255.
        if self == Self::Gcvf { [r, g, b, 255] } else { [r, g, b, alpha] }
    }

    /// Tells before any work whether this build can write the container for a target.
    ///
    /// # Errors
    /// [`SliceError::Unsupported`] without the cargo feature, or for a pitch that the container cannot state.
    ///
    /// ```
    /// use pellucid_slice::{Container, PrintTarget};
    /// assert!(Container::Png.check(&PrintTarget::j750()).is_ok());
    /// assert_eq!(Container::Npy.check(&PrintTarget::j750()).is_ok(), cfg!(feature = "npy"));
    /// ```
    #[cfg_attr(not(feature = "gcvf"), allow(unused_variables))]
    pub fn check(self, target: &PrintTarget) -> Result<(), SliceError> {
        match self {
            #[cfg(feature = "gcvf")]
            Self::Gcvf => gcvf::Resolution::of(target).map(drop),
            _ if self.is_built() => Ok(()),
            _ => Err(self.missing()),
        }
    }

    fn is_built(self) -> bool {
        match self {
            Self::Png => true,
            Self::Gcvf => cfg!(feature = "gcvf"),
            Self::Nrrd => cfg!(feature = "nrrd"),
            Self::Npy => cfg!(feature = "npy"),
        }
    }

    /// The error of a build without the container.
    pub(crate) fn missing(self) -> SliceError {
        let name = self.name();
        let fault = Fault::new(format!("container {name}"), "this build has none of that")
            .remedy(format!("build with the cargo feature {name}"));
        SliceError::Unsupported(fault)
    }
}
