//! The slices as bytes: all of them, or every second, third and so on.

use pellucid_core::{Control, FileError};
use pellucid_voxel::LabelGrid;
use rayon::prelude::*;
use serde::Serialize;

use super::pack::deflate;
use crate::ProofError;

/// One layer in so many is packed to find how much room all need.
const SAMPLE: usize = 16;

/// What the program must know to unpack.
#[derive(Clone, Debug, Serialize)]
pub(super) struct SlicesIndex {
    width: u32,
    height: u32,
    /// Layers of the object.
    layers: u32,
    /// The page holds one layer in so many, from 0 on.
    every: u32,
    /// Where each ends.
    ends: Vec<usize>,
}

/// Labels of layers, a byte a pixel, rows as in the images, each layer deflated by itself.
pub(super) struct PackedSlices {
    pub index: SlicesIndex,
    pub bytes: Vec<u8>,
}

impl PackedSlices {
    pub fn pack(
        labels: &LabelGrid,
        highest_y_first: bool,
        most_bytes: u64,
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        let [width, height, layers] = labels.size();
        let sample = packed(labels, highest_y_first, SAMPLE, control)?;
        let mean = sample.iter().map(Vec::len).sum::<usize>() as u64 / sample.len().max(1) as u64;
        let every = (mean * u64::from(layers)).div_ceil(most_bytes.max(1)).clamp(1, u64::from(layers));
        let kept = packed(labels, highest_y_first, every as usize, control)?;
        let mut end = 0;
        let ends = kept.iter().map(|layer| {
            end += layer.len();
            end
        });
        let index = SlicesIndex { width, height, layers, every: every as u32, ends: ends.collect() };
        Ok(Self { index, bytes: kept.concat() })
    }
}

#[cfg(test)]
impl PackedSlices {
    /// The index as the program reads it.
    pub fn index_json(&self) -> serde_json::Value {
        serde_json::to_value(&self.index).unwrap()
    }
}

/// One layer in `every`, the bottom one first.
fn packed(
    labels: &LabelGrid,
    highest_y_first: bool,
    every: usize,
    control: &Control<'_>,
) -> Result<Vec<Vec<u8>>, ProofError> {
    let [width, height, layers] = labels.size();
    let buffers = || [vec![0u8; width as usize * height as usize], Vec::new()];
    let layer = |[layer, rows]: &mut [Vec<u8>; 2], z: u32| {
        control.check()?;
        labels.copy_layer(z, layer).map_err(|e| ProofError::invalid("labels", e.to_string()))?;
        if highest_y_first {
            rows.clear();
            layer.chunks_exact(width as usize).rev().for_each(|row| rows.extend_from_slice(row));
        }
        let image = if highest_y_first { &*rows } else { &*layer };
        Ok(deflate(image).map_err(FileError::at("pack", "slices"))?)
    };
    (0..layers).into_par_iter().step_by(every).map_init(buffers, layer).collect()
}
