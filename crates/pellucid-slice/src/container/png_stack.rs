//! One PNG a layer in a folder.

use std::fs;
use std::path::{Path, PathBuf};

use pellucid_core::FileError;
use pellucid_voxel::Control;

use super::writer::LayerWriter;
use crate::SliceError;
use crate::encode::LayerFormat;
use crate::manifest::{self, Manifest};

/// A stack that is being written.
pub(crate) struct PngStack {
    dir: PathBuf,
    format: LayerFormat,
}

impl PngStack {
    /// Makes the folder of the images.
    pub fn begin(dir: &Path, manifest: &Manifest) -> Result<Self, SliceError> {
        let slices = dir.join("slices");
        fs::create_dir_all(&slices).map_err(FileError::at("create", &slices))?;
        Ok(Self { dir: dir.to_owned(), format: LayerFormat::of(manifest) })
    }
}

impl LayerWriter for PngStack {
    // Files need no order, so each is on the disk once it is encoded.
    type Layer = ();

    fn encode(&self, layer: u32, labels: &[u8], control: &Control<'_>) -> Result<(), SliceError> {
        self.format.write(labels, &manifest::slice_path(&self.dir, layer), control)
    }

    fn write(&mut self, (): ()) -> Result<(), SliceError> {
        Ok(())
    }

    fn finish(self, _: &Control<'_>) -> Result<(), SliceError> {
        Ok(())
    }
}
