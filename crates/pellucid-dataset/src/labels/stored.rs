//! Labelled volumes as their files hold them: numbers, points and labels, no stencils.

use std::path::{Path, PathBuf};

use pellucid_stencil::FirstFlight;
use pellucid_voxel::{Control, Surface, SurfaceOptions};

use super::generate::{check_complete, sampler_of};
use super::half_stencils::HalfStencils;
use super::samples::Sampler;
use super::samples::digest;
use super::set_file::{self, Contents, Record, SetHeader, Shard};
use crate::DatasetError;

/// The volumes of a finished set, in ascending order. Their stencils and flights are made when they are asked for.
#[derive(Clone, Debug)]
pub struct StoredVolumes {
    header: SetHeader,
    sampler: Sampler,
    /// Each with the file it comes from.
    records: Vec<(PathBuf, Record)>,
}

impl StoredVolumes {
    /// Reads the file of the whole set, or those of all its shards in any order.
    ///
    /// # Errors
    /// [`DatasetError::Io`]; [`DatasetError::Invalid`] naming a file that is damaged, or when a shard is missing;
    /// [`DatasetError::Unsupported`] naming a file that does not belong to the others.
    pub fn load<P: AsRef<Path>>(paths: &[P]) -> Result<Self, DatasetError> {
        let mut files: Vec<(&Path, Contents)> = Vec::new();
        for path in paths.iter().map(AsRef::as_ref) {
            let there = set_file::read(path)?;
            check_complete(path, &there)?;
            files.push((path, there));
        }
        let Some((_, first)) = files.first() else {
            return Err(DatasetError::invalid("files", "needs at least one"));
        };
        let header = SetHeader { shard: Shard::WHOLE, ..first.header.clone() };
        let count = first.header.shard.count;
        for (path, there) in &files {
            let same = SetHeader { shard: Shard::WHOLE, ..there.header.clone() } == header;
            if !same || there.header.shard.count != count {
                let remedy = "give the files of one set";
                return Err(DatasetError::foreign(
                    path,
                    "recipe",
                    "it is of another set than the first file",
                    remedy,
                ));
            }
        }
        let mut shards: Vec<u32> = files.iter().map(|(_, there)| there.header.shard.index).collect();
        shards.sort_unstable();
        if !shards.iter().copied().eq(0..count) {
            return Err(DatasetError::invalid(
                "files",
                format!("parts {shards:?} of {count}; all are needed once"),
            ));
        }
        let mut records: Vec<(PathBuf, Record)> = files
            .into_iter()
            .flat_map(|(path, there)| there.records.into_iter().map(move |r| (path.to_owned(), r)))
            .collect();
        records.sort_by_key(|(_, record)| record.volume);
        Ok(Self { sampler: sampler_of(&header)?, header, records })
    }

    /// Recipe, split and materials.
    pub fn header(&self) -> &SetHeader {
        &self.header
    }

    /// Number of volumes.
    pub fn len(&self) -> usize {
        self.records.len()
    }

    /// True when there is no volume.
    pub fn is_empty(&self) -> bool {
        self.records.is_empty()
    }

    /// Labelled points and channels.
    pub fn samples(&self) -> u64 {
        self.records.iter().map(|(_, r)| r.radiance.len() as u64).sum()
    }

    pub(crate) fn sampler(&self) -> &Sampler {
        &self.sampler
    }

    /// The record at position `at`.
    pub(crate) fn record(&self, at: usize) -> &Record {
        &self.records[at].1
    }

    /// The stencils and first flights of a record's points, ordered as in [`Samples`](crate::Samples).
    ///
    /// # Errors
    /// [`DatasetError::Unsupported`] when this version makes another volume of the recipe;
    /// [`DatasetError::Cancelled`].
    pub(crate) fn inputs(
        &self,
        at: usize,
        control: &Control<'_>,
    ) -> Result<(HalfStencils, Vec<FirstFlight>), DatasetError> {
        let (path, record) = &self.records[at];
        let another = || {
            DatasetError::foreign(
                path,
                &format!("volume {}", record.volume),
                "this version makes another one of the recipe",
                "generate the set again",
            )
        };
        let grid = self.sampler.grid(record.volume)?;
        if digest(&grid) != record.digest {
            return Err(another());
        }
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), control)?;
        let point = |v: &[u16; 3]| surface.index_of(v.map(u32::from));
        let points = record.voxels.iter().map(point).collect::<Option<Vec<u32>>>().ok_or_else(another)?;
        self.sampler.inputs(record.volume, &grid, &surface, &points, control)
    }
}
