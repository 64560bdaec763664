//! Finished sets in memory.

use std::path::Path;
use std::sync::atomic::AtomicU64;

use pellucid_core::Cancelled;
use pellucid_stencil::FirstFlight;
use pellucid_voxel::Control;
use rayon::prelude::*;

use super::generate::sampler_of;
use super::half_stencils::{HalfStencils, STENCIL_VALUES};
use super::samples::Labelling;
use super::set_file::{Record, SetHeader};
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
    flights: Vec<FirstFlight>,
    radiance: Vec<f32>,
    std_error: Vec<f32>,
}

impl LabelledSet {
    /// Reads a set from the file of the whole, or from those of all its shards in any order, and extracts its
    /// stencils and flights anew. Progress counts volumes.
    ///
    /// # Errors
    /// [`DatasetError::Io`]; [`DatasetError::Invalid`] naming a file that is damaged, or when a shard is missing;
    /// [`DatasetError::Unsupported`] naming a file that does not belong to the others or comes from a version whose
    /// volumes were different; [`DatasetError::Cancelled`].
    pub fn load<P: AsRef<Path>>(paths: &[P], control: &Control<'_>) -> Result<Self, DatasetError> {
        let stored = StoredVolumes::load(paths)?;
        let samples = stored.samples();
        check_samples("files", samples)?;
        let mut set = Self::empty(stored.header(), samples);
        let split = set.header.split()?.clone();
        for at in 0..stored.len() {
            control.report(at as u64, stored.len() as u64);
            control.check()?;
            let record = stored.record(at);
            let (stencils, flights) = stored.inputs(at, &control.silent())?;
            set.stencils.extend(&stencils);
            set.flights.extend(flights);
            set.volumes.push(record.volume);
            set.classes.push(set.header.recipe.class(&split, record.volume));
            set.voxels.extend(&record.voxels);
            set.radiance.extend(&record.radiance);
            set.std_error.extend(&record.std_error);
        }
        Ok(set)
    }

    /// Labels the points of a header's shard in memory: what [`generate`](crate::generate()) and [`LabelledSet::load`] give
    /// by way of a file. Progress counts volumes.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] for a header out of range or a set of more than a million samples;
    /// [`DatasetError::Cancelled`]; others as [`Sampler::samples`](crate::Sampler::samples).
    pub fn label(header: &SetHeader, control: &Control<'_>) -> Result<Self, DatasetError> {
        header.check()?;
        let split = header.split()?;
        // Counted before anything is held: a recipe may claim any number.
        let points = header.shard.count_of(split) * u64::from(split.points);
        check_samples("split", points.saturating_mul(header.materials.channels() as u64))?;
        let volumes: Vec<u32> = header.shard.volumes(split).collect();
        let sampler = sampler_of(header)?;
        let done = AtomicU64::new(0);
        let made = volumes
            .par_iter()
            .map(|&volume| {
                let made = sampler.samples(volume, split.points, Labelling::of(split), &control.silent())?;
                control.advance(&done, 1, volumes.len() as u64);
                Ok(made)
            })
            .collect::<Result<Vec<_>, DatasetError>>()?;
        let mut set = Self::empty(header, 0);
        for (volume, samples) in volumes.into_iter().zip(made) {
            let record = Record::new(volume, &samples)?;
            set.volumes.push(volume);
            set.classes.push(header.recipe.class(split, volume));
            set.voxels.extend(&record.voxels);
            set.stencils.extend(&samples.stencils);
            set.flights.extend(&samples.flights);
            set.radiance.extend(&record.radiance);
            set.std_error.extend(&record.std_error);
        }
        Ok(set)
    }

    /// A set of no samples, with room for the stencils of some.
    fn empty(header: &SetHeader, samples: u64) -> Self {
        Self {
            header: header.clone(),
            volumes: Vec::new(),
            classes: Vec::new(),
            voxels: Vec::new(),
            stencils: HalfStencils::with_capacity(samples as usize),
            flights: Vec::new(),
            radiance: Vec::new(),
            std_error: Vec::new(),
        }
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

    /// First flight of each sample.
    pub fn flights(&self) -> &[FirstFlight] {
        &self.flights
    }

    /// Predicts every sample: `predict` is given the stencils of `at_a_time` samples (at least 1; fewer at the end),
    /// ordered as [`LabelledSet::stencils`] says, and their first flights, and fills in one radiance each. Progress counts samples.
    ///
    /// # Errors
    /// What `predict` returns, and [`Cancelled`].
    pub fn predictions<E: From<Cancelled>>(
        &self,
        at_a_time: usize,
        control: &Control<'_>,
        mut predict: impl FnMut(&[f32], &[FirstFlight], &mut [f32]) -> Result<(), E>,
    ) -> Result<Vec<f32>, E> {
        let at_a_time = at_a_time.clamp(1, self.len().max(1));
        let mut predicted = vec![0.0; self.len()];
        let mut stencils = vec![0.0; at_a_time * STENCIL_VALUES];
        for (chunk, out) in predicted.chunks_mut(at_a_time).enumerate() {
            control.check()?;
            let first = chunk * at_a_time;
            let stencils = &mut stencils[..out.len() * STENCIL_VALUES];
            self.stencils(first, stencils);
            predict(stencils, &self.flights[first..first + out.len()], out)?;
            control.report((first + out.len()) as u64, self.len() as u64);
        }
        Ok(predicted)
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

fn check_samples(field: &str, samples: u64) -> Result<(), DatasetError> {
    if samples > MAX_SAMPLES {
        return Err(DatasetError::invalid(field, format!("{samples} samples; at most {MAX_SAMPLES}")));
    }
    Ok(())
}
