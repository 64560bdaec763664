//! Finished sets in memory.

use std::path::Path;

use pellucid_voxel::Control;

use super::half_stencils::HalfStencils;
use super::set_file::SetHeader;
use super::stored::StoredVolumes;
use crate::{DatasetError, ShapeClass};

/// Most samples held: 4.9 GB.
const MAX_SAMPLES: u64 = 1_000_000;

/// A labelled set: validation, test, or one of the hard cases. A sample is one point in one channel; samples
/// are ordered `[volume][point][channel]`.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelledSet {
    header: SetHeader,
    volumes: Vec<u32>,
    classes: Vec<ShapeClass>,
    voxels: Vec<[u16; 3]>,
    stencils: HalfStencils,
    radiance: Vec<f32>,
    std_error: Vec<f32>,
}

impl LabelledSet {
    /// Reads a set from the file of the whole, or from those of all its shards in any order, and extracts its
    /// stencils anew. Progress counts volumes.
    ///
    /// # Errors
    /// [`DatasetError::Io`]; [`DatasetError::Invalid`] naming a file that is damaged, or when a shard is missing;
    /// [`DatasetError::Unsupported`] naming a file that does not belong to the others or comes from a version whose
    /// volumes were different; [`DatasetError::Cancelled`].
    pub fn load<P: AsRef<Path>>(paths: &[P], control: &Control<'_>) -> Result<Self, DatasetError> {
        let stored = StoredVolumes::load(paths)?;
        let samples = stored.samples();
        if samples > MAX_SAMPLES {
            return Err(DatasetError::invalid("files", format!("{samples} samples; at most {MAX_SAMPLES}")));
        }
        let header = stored.header();
        let split = header.split()?;
        let mut set = Self {
            volumes: Vec::new(),
            classes: Vec::new(),
            voxels: Vec::new(),
            stencils: HalfStencils::with_capacity(samples as usize),
            radiance: Vec::new(),
            std_error: Vec::new(),
            header: header.clone(),
        };
        for at in 0..stored.len() {
            control.report(at as u64, stored.len() as u64);
            control.check()?;
            let record = stored.record(at);
            set.stencils.extend(&stored.stencils(at, &control.silent())?);
            set.volumes.push(record.volume);
            set.classes.push(header.recipe.class(split, record.volume));
            set.voxels.extend(&record.voxels);
            set.radiance.extend(&record.radiance);
            set.std_error.extend(&record.std_error);
        }
        Ok(set)
    }

    /// Recipe, split and materials.
    pub fn header(&self) -> &SetHeader {
        &self.header
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.radiance.len()
    }

    /// True when there is no sample.
    pub fn is_empty(&self) -> bool {
        self.radiance.is_empty()
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.header.materials.channels()
    }

    /// Radiance of each sample, within 0..=1.
    pub fn radiance(&self) -> &[f32] {
        &self.radiance
    }

    /// Standard error of each sample's radiance.
    pub fn std_error(&self) -> &[f32] {
        &self.std_error
    }

    /// Channel of a sample.
    pub fn channel(&self, sample: usize) -> usize {
        sample % self.channels()
    }

    /// Number of a sample's volume in the split.
    ///
    /// # Panics
    /// When `sample` is not below [`LabelledSet::len`]; so do the others that take one.
    pub fn volume(&self, sample: usize) -> u32 {
        self.volumes[sample / self.per_volume()]
    }

    /// Shape family of a sample's volume.
    pub fn class(&self, sample: usize) -> ShapeClass {
        self.classes[sample / self.per_volume()]
    }

    /// A sample's voxel `[x, y, z]` in the grid that [`Sampler::grid`](crate::Sampler::grid) makes of its volume.
    pub fn voxel(&self, sample: usize) -> [u32; 3] {
        self.voxels[sample / self.channels()].map(u32::from)
    }

    /// Writes the stencils of samples `first..` to `out`, [`STENCIL_VALUES`](crate::STENCIL_VALUES) a sample, ordered
    /// `[sample][level][z][y][x][sigma_s, sigma_a]` in 1/mm.
    ///
    /// # Panics
    /// When `out` is no whole number of stencils or reaches past the last one.
    pub fn stencils(&self, first: usize, out: &mut [f32]) {
        self.stencils.write(first, out);
    }

    /// Number of volumes.
    pub(crate) fn volumes(&self) -> usize {
        self.volumes.len()
    }

    /// Samples of a volume.
    pub(crate) fn per_volume(&self) -> usize {
        self.radiance.len() / self.volumes.len()
    }
}
