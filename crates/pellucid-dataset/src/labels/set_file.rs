//! Files of labelled points: a JSON header and one record of fixed size a volume.
//!
//! ```text
//! "PELLSET1", u32 header length, header (JSON), u64 checksum of the header, records:
//!   u32 volume, u64 checksum of its labels, u16 x 3 voxel a point,
//!   f32 radiance a point and channel, f32 standard error a point and channel, u64 checksum of the record
//! ```
//! Numbers are little-endian. Volumes follow from the recipe in the header, and stencils from the volumes.

use std::path::Path;

use pellucid_core::files::read_bounded;
use pellucid_voxel::MaterialTable;
use serde::{Deserialize, Serialize};

use super::samples::{Fnv, Samples};
use crate::{DatasetError, Recipe, Split};

const MAGIC: &[u8; 8] = b"PELLSET1";
const MAX_HEADER: usize = 1 << 20;
/// Largest file that is read.
const MAX_BYTES: u64 = 1 << 30;
/// Most points of a volume in a file.
const MAX_POINTS: u32 = 1 << 20;

/// Part `index` of `count` of a set: its volumes with that remainder.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shard {
    /// From 0.
    pub index: u32,
    /// At least 1.
    pub count: u32,
}

impl Shard {
    /// The whole set.
    pub const WHOLE: Self = Self { index: 0, count: 1 };

    /// Checks and makes a shard.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] unless `index` is below `count`.
    pub fn new(index: u32, count: u32) -> Result<Self, DatasetError> {
        if index < count {
            Ok(Self { index, count })
        } else {
            Err(DatasetError::invalid(
                "shard",
                format!("{index}/{count}; parts of {count} are numbered from 0 to below {count}"),
            ))
        }
    }

    /// Number of the shard's volumes of a split.
    pub fn count_of(self, split: &Split) -> u64 {
        u64::from(split.volumes.saturating_sub(self.index)).div_ceil(u64::from(self.count.max(1)))
    }

    /// The shard's volumes of a split.
    pub fn volumes(self, split: &Split) -> impl Iterator<Item = u32> {
        (self.index..split.volumes).step_by(self.count.max(1) as usize)
    }
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SetHeader {
    /// The recipe.
    pub recipe: Recipe,
    /// Which of its splits.
    pub split: String,
    /// The materials before the split's density.
    pub materials: MaterialTable,
    /// Which part of the split.
    pub shard: Shard,
}

impl SetHeader {
    /// Checks the recipe and the shard.
    ///
    /// # Errors
    /// [`DatasetError::Invalid`] naming the field.
    pub fn check(&self) -> Result<(), DatasetError> {
        self.recipe.check()?;
        let split = self.recipe.split(&self.split)?;
        if split.points > MAX_POINTS {
            return Err(DatasetError::invalid(
                "points",
                format!("{} in a volume, over {MAX_POINTS}", split.points),
            ));
        }
        Shard::new(self.shard.index, self.shard.count).map(|_| ())
    }

    /// The split.
    ///
    /// # Errors
    /// As [`Recipe::split`].
    pub fn split(&self) -> Result<&Split, DatasetError> {
        self.recipe.split(&self.split)
    }

    /// The start of a file.
    pub(crate) fn bytes(&self) -> Result<Vec<u8>, DatasetError> {
        let json = serde_json::to_vec(self).map_err(|e| DatasetError::invalid("recipe", e.to_string()))?;
        if json.len() > MAX_HEADER {
            return Err(DatasetError::invalid("recipe", "takes over 1 MiB as JSON"));
        }
        let mut bytes = MAGIC.to_vec();
        bytes.extend((json.len() as u32).to_le_bytes());
        let sum = checksum(&json);
        bytes.extend(json);
        bytes.extend(sum.to_le_bytes());
        Ok(bytes)
    }

    /// Bytes of a record.
    pub(crate) fn record_bytes(&self) -> Result<usize, DatasetError> {
        Ok(20 + self.split()?.points as usize * (6 + 8 * self.materials.channels()))
    }
}

/// The labelled points of one volume in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// The volume.
    pub volume: u32,
    /// A checksum of its labels.
    pub digest: u64,
    /// The points' voxels `[x, y, z]`.
    pub voxels: Vec<[u16; 3]>,
    /// Ordered `[point][channel]`.
    pub radiance: Vec<f32>,
    /// Standard errors of `radiance`.
    pub std_error: Vec<f32>,
}

impl Record {
    pub(crate) fn new(volume: u32, samples: &Samples) -> Result<Self, DatasetError> {
        let narrow = |v: &[u32; 3]| {
            let [x, y, z] = v.map(|c| u16::try_from(c).ok());
            Some([x?, y?, z?])
        };
        let voxels = samples.voxels.iter().map(narrow).collect::<Option<Vec<_>>>();
        Ok(Self {
            volume,
            digest: samples.digest,
            voxels: voxels
                .ok_or_else(|| DatasetError::invalid("pitch", "a volume has over 65536 voxels an edge"))?,
            radiance: samples.radiance.clone(),
            std_error: samples.std_error.clone(),
        })
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.volume.to_le_bytes().to_vec();
        bytes.extend(self.digest.to_le_bytes());
        bytes.extend(self.voxels.iter().flatten().flat_map(|c| c.to_le_bytes()));
        bytes.extend(self.radiance.iter().chain(&self.std_error).flat_map(|v| v.to_le_bytes()));
        let sum = checksum(&bytes);
        bytes.extend(sum.to_le_bytes());
        bytes
    }

    /// Reads a record of the right length; `None` when its checksum or its values are wrong.
    fn parse(bytes: &[u8], points: usize, channels: usize) -> Option<Self> {
        let (body, sum) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
        if checksum(body) != u64::from_le_bytes(sum.try_into().ok()?) {
            return None;
        }
        let (head, rest) = body.split_at_checked(12)?;
        let (voxels, values) = rest.split_at_checked(6 * points)?;
        let short = |b: &[u8]| u16::from_le_bytes([b[0], b[1]]);
        let mut values = values.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
        let record = Self {
            volume: u32::from_le_bytes(head[..4].try_into().ok()?),
            digest: u64::from_le_bytes(head[4..].try_into().ok()?),
            voxels: voxels.chunks_exact(6).map(|b| [short(b), short(&b[2..]), short(&b[4..])]).collect(),
            radiance: values.by_ref().take(points * channels).collect(),
            std_error: values.collect(),
        };
        let fine = record.std_error.len() == points * channels
            && record.radiance.iter().all(|r| (0.0..=1.0).contains(r))
            && record.std_error.iter().all(|e| e.is_finite() && *e >= 0.0);
        fine.then_some(record)
    }
}

/// What could be read of a file.
pub(crate) struct Contents {
    pub header: SetHeader,
    /// Whole records from the start on.
    pub records: Vec<Record>,
    /// Bytes of header and whole records.
    pub good_bytes: u64,
    /// Whether anything follows them.
    pub broken: bool,
}

/// Reads what is whole of a file.
pub(crate) fn read(path: &Path) -> Result<Contents, DatasetError> {
    parse(path, &read_bounded(path, MAX_BYTES)?)
}

/// As [`read`], from memory.
pub(crate) fn parse(path: &Path, bytes: &[u8]) -> Result<Contents, DatasetError> {
    let remedy = "give a file of `pellucid dataset generate`, or generate it again";
    let broken = |reason: &str| DatasetError::damaged(path, "header", reason, remedy);
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| broken("it does not start with \"PELLSET1\""))?;
    let (length, rest) = rest.split_first_chunk::<4>().ok_or_else(|| broken("it is cut off"))?;
    let length = u32::from_le_bytes(*length) as usize;
    if length > MAX_HEADER {
        return Err(broken("it claims over 1 MiB"));
    }
    let (json, rest) = rest.split_at_checked(length).ok_or_else(|| broken("it is cut off"))?;
    let (sum, body) = rest.split_first_chunk::<8>().ok_or_else(|| broken("it is cut off"))?;
    if checksum(json) != u64::from_le_bytes(*sum) {
        return Err(broken("its checksum is wrong"));
    }
    let header: SetHeader = serde_json::from_slice(json).map_err(|e| broken(&e.to_string()))?;
    header.check().map_err(|e| broken(&e.to_string()))?;
    let size = header.record_bytes()?;
    let (points, channels) = (header.split()?.points as usize, header.materials.channels());
    let records: Vec<Record> =
        body.chunks_exact(size).map_while(|record| Record::parse(record, points, channels)).collect();
    let good_bytes = (bytes.len() - body.len() + records.len() * size) as u64;
    Ok(Contents { broken: good_bytes < bytes.len() as u64, header, records, good_bytes })
}

fn checksum(bytes: &[u8]) -> u64 {
    let mut sum = Fnv::new();
    sum.add(bytes);
    sum.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ShapeClass;
    use pellucid_voxel::Pitch;

    fn header() -> SetHeader {
        let split = Split {
            name: "test".into(),
            volumes: 5,
            points: 3,
            spp: 64,
            std_error: None,
            shapes: vec![(ShapeClass::Slab, 1.0)],
            density: 1.0,
            other_inks: None,
            neighbours: None,
            pale: None,
            halftone: crate::Halftone::Ranked,
        };
        let recipe = Recipe {
            name: "test".into(),
            seed: 11,
            pitch: Pitch::j750(),
            size_mm: [1.0, 2.0],
            large_mm: 2.0,
            large_share: 0.0,
            refractive_index: 1.5,
            splits: vec![split],
        };
        SetHeader { recipe, split: "test".into(), materials: MaterialTable::cmykw(), shard: Shard::WHOLE }
    }

    fn refusal(bytes: &[u8]) -> String {
        parse(Path::new("a.set"), bytes).err().unwrap().to_string()
    }

    #[test]
    fn shards_count_what_they_list() {
        for volumes in [0, 1, 5, 12] {
            let split = Split { volumes, ..header().recipe.splits[0].clone() };
            for count in 1..4 {
                for index in 0..count {
                    let shard = Shard { index, count };
                    assert_eq!(shard.count_of(&split), shard.volumes(&split).count() as u64);
                }
            }
        }
    }

    #[test]
    fn claims_of_a_header_are_checked_before_they_are_believed() {
        let bytes = header().bytes().unwrap();
        assert!(parse(Path::new("a.set"), &bytes).unwrap().records.is_empty());
        let mut long = bytes.clone();
        long[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(refusal(&long).contains("1 MiB"));
        assert!(refusal(&bytes[..bytes.len() - 1]).contains("cut off"));
        assert!(refusal(&bytes[..10]).contains("cut off"));
        assert!(refusal(b"PNG").contains("PELLSET1"));
        let with = |change: fn(&mut SetHeader)| {
            let mut header = header();
            change(&mut header);
            refusal(&header.bytes().unwrap())
        };
        assert!(with(|h| h.recipe.splits[0].points = u32::MAX).contains("points"));
        assert!(with(|h| h.recipe.pitch = Pitch::new([1e-6; 3]).unwrap()).contains("large_mm"));
        assert!(with(|h| h.shard.count = 0).contains("shard"));
        assert!(with(|h| h.split = "other".into()).contains("other"));
        // As many volumes as there may be cost nothing until they are there.
        let mut many = header();
        many.recipe.splits[0].volumes = u32::MAX;
        assert!(parse(Path::new("a.set"), &many.bytes().unwrap()).unwrap().records.is_empty());
    }

    #[test]
    fn records_round_trip() {
        let record = Record {
            volume: 3,
            digest: 77,
            voxels: vec![[1, 2, 3], [65535, 0, 9]],
            radiance: vec![0.0, 0.5, 1.0, 0.25],
            std_error: vec![0.1, 0.0, 0.2, 0.3],
        };
        let mut bytes = record.bytes();
        assert_eq!(Record::parse(&bytes, 2, 2), Some(record));
        assert_eq!(Record::parse(&bytes, 1, 2), None);
        bytes[20] ^= 1;
        assert_eq!(Record::parse(&bytes, 2, 2), None);
    }
}
