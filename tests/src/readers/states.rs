//! States that programs keep. Where a checksum guards them, they are read as they are and once more with the checksum put
//! right; files of tensors may leave their values out.

use std::fs;
use std::path::Path;

use pellucid::core::Checkpoints;
use pellucid::dataset::{StoredVolumes, info};
use pellucid::refine::{DescentState, Saved, SurfaceColorState, SurfaceFirstState};
use pellucid::rpnn::file::parse;
use pellucid::rpnn::train::Trainer;
use pellucid::voxel::LabelGrid;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::{Outcome, folder, seal};

/// Memory that a grid may take.
const GRID_BYTES: u64 = 1 << 26;

/// Trained weights.
pub fn weights(bytes: &[u8]) -> Outcome {
    parse(Path::new("a.safetensors"), &seal::tensors(bytes))?;
    Ok(())
}

/// The state of a training run.
pub fn run(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    let path = folder.path().join("run.safetensors");
    fs::write(&path, seal::tensors(bytes))?;
    Trainer::resume(&path)?;
    Ok(())
}

/// A labelled set.
pub fn set(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    let path = folder.path().join("a.set");
    let mut outcome = Ok(());
    for bytes in [bytes, &seal::set(bytes)] {
        fs::write(&path, bytes)?;
        let read = info(&path);
        StoredVolumes::load(&[&path])?;
        outcome = read.map(drop);
    }
    Ok(outcome?)
}

/// An encoded grid of labels.
pub fn grid(bytes: &[u8]) -> Outcome {
    let raw = LabelGrid::decode(bytes, GRID_BYTES);
    let grid = match LabelGrid::decode(&seal::grid(bytes), GRID_BYTES) {
        Ok(grid) => grid,
        Err(_) => raw?,
    };
    assert!(LabelGrid::decode(&grid.encode(), GRID_BYTES).expect("what was written is read") == grid);
    Ok(())
}

/// The record of an interrupted job, which the same job goes on with.
pub fn job_record(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    let record = serde_json::from_slice(bytes).unwrap_or_default();
    fs::write(folder.path().join("record.json"), bytes)?;
    Checkpoints::resume(folder.path()).begin(&record)?;
    Ok(())
}

/// A refinement's checkpoint, of each strategy.
pub fn refinement(bytes: &[u8]) -> Outcome {
    let sealed = seal::refinement(bytes);
    let outcomes = [bytes, &sealed].map(|bytes| {
        [saved::<SurfaceFirstState>(bytes), saved::<DescentState>(bytes), saved::<SurfaceColorState>(bytes)]
    });
    let mut outcomes = outcomes.into_iter().flatten();
    let first = outcomes.next().unwrap_or(Ok(()));
    if outcomes.any(|outcome| outcome.is_ok()) { Ok(()) } else { first }
}

fn saved<S: Serialize + DeserializeOwned>(bytes: &[u8]) -> Outcome {
    let saved = Saved::<S>::from_bytes(bytes)?;
    let written = saved.to_bytes()?;
    let again = Saved::<S>::from_bytes(&written).expect("what was written is read");
    assert!(again.to_bytes()? == written);
    Ok(())
}
