//! Making and checking files of labelled points.

use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use pellucid_core::{FileError, files};
use pellucid_trace::Boundary;
use pellucid_voxel::Control;

use super::samples::permutation;
use super::samples::{Labelling, Sampler};
use super::set_file::{self, Contents, Record, SetHeader, Shard};
use crate::DatasetError;

/// The name of a shard's file: `validation.set`, or `validation.2-of-5.set`.
pub fn file_name(split: &str, shard: Shard) -> String {
    match shard {
        Shard::WHOLE => format!("{split}.set"),
        Shard { index, count } => format!("{split}.{index}-of-{count}.set"),
    }
}

/// The sampler of a file's split.
pub(crate) fn sampler_of(header: &SetHeader) -> Result<Sampler, DatasetError> {
    let boundary = Boundary::with_index(header.recipe.refractive_index)?;
    Sampler::new(&header.recipe, &header.split, &header.materials, boundary)
}

/// Labels the points of a shard into a file of `folder`, and returns its path.
///
/// It is written volume by volume to a name ending in `.partial` and renamed at last. Where such a file is
/// there already, from a run that was stopped, only what it lacks is made; the result is the same byte for
/// byte. A finished file of the same header is left as it is. Progress counts volumes.
///
/// # Errors
/// [`DatasetError::Unsupported`] when a file of that name is another recipe's, [`DatasetError::Invalid`] when it is
/// damaged; [`DatasetError::Io`]; [`DatasetError::Cancelled`]; others as [`Sampler::samples`].
pub fn generate(folder: &Path, header: &SetHeader, control: &Control<'_>) -> Result<PathBuf, DatasetError> {
    header.check()?;
    let split = header.split()?;
    let path = folder.join(file_name(&header.split, header.shard));
    if path.exists() {
        let there = set_file::read(&path)?;
        check_same(&path, &there, header)?;
        check_complete(&path, &there)?;
        return Ok(path);
    }
    let partial = folder.join(format!("{}.partial", file_name(&header.split, header.shard)));
    let io = |e: std::io::Error| FileError::at("write", &partial)(e);
    let (mut file, mut done) = open_partial(&partial, header)?;
    let sampler = sampler_of(header)?;
    let total = header.shard.count_of(split);
    control.report(done as u64, total);
    for volume in header.shard.volumes(split).skip(done) {
        let samples = sampler.samples(volume, split.points, Labelling::of(split), &control.silent())?;
        file.write_all(&Record::new(volume, &samples)?.bytes()).map_err(io)?;
        done += 1;
        control.report(done as u64, total);
    }
    file.sync_all().and_then(|()| std::fs::rename(&partial, &path)).map_err(io)?;
    Ok(path)
}

/// Makes the file of a whole set, byte for byte as [`generate`] does, of the files of its `parts` parts in `folder`, and
/// removes those; returns its path. A finished file of the same header is left as it is.
///
/// # Errors
/// As [`generate`], where a part is missing as well.
pub fn join(folder: &Path, whole: &SetHeader, parts: u32) -> Result<PathBuf, DatasetError> {
    let whole = SetHeader { shard: Shard::WHOLE, ..whole.clone() };
    whole.check()?;
    let path = folder.join(file_name(&whole.split, Shard::WHOLE));
    if path.exists() {
        check_same(&path, &set_file::read(&path)?, &whole)?;
        return Ok(path);
    }
    let mut files = Vec::new();
    let mut records = Vec::new();
    for index in 0..parts {
        let header = SetHeader { shard: Shard::new(index, parts)?, ..whole.clone() };
        let file = folder.join(file_name(&header.split, header.shard));
        let there = set_file::read(&file)?;
        check_same(&file, &there, &header)?;
        check_complete(&file, &there)?;
        records.extend(there.records);
        files.push(file);
    }
    records.sort_by_key(|record| record.volume);
    let header = whole.bytes()?;
    files::write_whole(&path, |out| {
        out.write_all(&header)?;
        records.iter().try_for_each(|record| out.write_all(&record.bytes()))
    })?;
    for file in &files {
        std::fs::remove_file(file).map_err(FileError::at("remove", file))?;
    }
    Ok(path)
}

/// Opens the file of a run, new or stopped, at its end, with the number of its records.
fn open_partial(partial: &Path, header: &SetHeader) -> Result<(File, usize), DatasetError> {
    let io = |e: std::io::Error| FileError::at("write", partial)(e);
    let bytes = header.bytes()?;
    let whole_header = std::fs::metadata(partial).is_ok_and(|m| m.len() >= bytes.len() as u64);
    if !whole_header {
        let mut file = File::create(partial).map_err(io)?;
        file.write_all(&bytes).map_err(io)?;
        return Ok((file, 0));
    }
    let there = set_file::read(partial)?;
    check_same(partial, &there, header)?;
    let expected = header.shard.volumes(header.split()?);
    let done = there.records.iter().zip(expected).take_while(|(r, v)| r.volume == *v).count();
    let whole = there.good_bytes - ((there.records.len() - done) * header.record_bytes()?) as u64;
    let mut file = OpenOptions::new().write(true).open(partial).map_err(io)?;
    file.set_len(whole).and_then(|()| file.seek(SeekFrom::End(0))).map_err(io)?;
    Ok((file, done))
}

fn check_same(path: &Path, there: &Contents, header: &SetHeader) -> Result<(), DatasetError> {
    if there.header == *header {
        return Ok(());
    }
    let remedy = "delete it or choose another folder";
    Err(DatasetError::foreign(path, "recipe", "it is another recipe's or shard's", remedy))
}

/// Refuses files that lack volumes or hold others than their header says.
pub(crate) fn check_complete(path: &Path, there: &Contents) -> Result<(), DatasetError> {
    let expected = there.header.shard.volumes(there.header.split()?);
    if !there.broken && there.records.iter().map(|r| r.volume).eq(expected) {
        return Ok(());
    }
    let remedy = "delete it and generate it again";
    Err(DatasetError::damaged(path, "records", "the file is damaged or cut off", remedy))
}

/// What a file holds, for people to read.
#[derive(Clone, Debug, PartialEq)]
pub struct SetInfo {
    /// The header.
    pub header: SetHeader,
    /// Labelled points and channels.
    pub samples: u64,
    /// Mean radiance.
    pub mean: f64,
    /// Root mean square of the labels' standard errors.
    pub rms_std_error: f64,
    /// Greatest standard error.
    pub max_std_error: f64,
}

/// Summarises a finished file.
///
/// # Errors
/// [`DatasetError::Io`], or [`DatasetError::Invalid`] naming what is wrong with the file.
pub fn info(path: &Path) -> Result<SetInfo, DatasetError> {
    let there = set_file::read(path)?;
    check_complete(path, &there)?;
    let radiance = || there.records.iter().flat_map(|r| &r.radiance).map(|&v| f64::from(v));
    let errors = || there.records.iter().flat_map(|r| &r.std_error).map(|&v| f64::from(v));
    let samples = radiance().count() as u64;
    Ok(SetInfo {
        samples,
        mean: radiance().sum::<f64>() / samples as f64,
        rms_std_error: (errors().map(|e| e * e).sum::<f64>() / samples as f64).sqrt(),
        max_std_error: errors().fold(0.0, f64::max),
        header: there.header,
    })
}

/// Makes `volumes` of a file's volumes again, chosen by `seed`, and compares them bit by bit; returns how many
/// were compared. Progress counts volumes.
///
/// # Errors
/// [`DatasetError::Unsupported`] naming the first volume that differs; otherwise as [`info`] and [`generate`].
pub fn verify(path: &Path, volumes: u32, seed: u64, control: &Control<'_>) -> Result<u32, DatasetError> {
    let there = set_file::read(path)?;
    check_complete(path, &there)?;
    let sampler = sampler_of(&there.header)?;
    let split = there.header.split()?;
    let order = permutation(there.records.len(), crate::recipe::draw::rng(seed, 4, 0));
    let chosen = &order[..order.len().min(volumes as usize)];
    for (i, &at) in chosen.iter().enumerate() {
        control.report(i as u64, chosen.len() as u64);
        let record = &there.records[at as usize];
        let samples =
            sampler.samples(record.volume, split.points, Labelling::of(split), &control.silent())?;
        if Record::new(record.volume, &samples)?.bytes() != record.bytes() {
            return Err(DatasetError::foreign(
                path,
                &format!("volume {}", record.volume),
                "it differs from what this version makes of the recipe",
                "generate the set again",
            ));
        }
    }
    Ok(chosen.len() as u32)
}
