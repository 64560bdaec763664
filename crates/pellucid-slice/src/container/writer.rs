//! How any container is written: layers encoded on all cores, written one after the other.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{AIR, Control, LabelGrid};
use rayon::prelude::*;

use crate::SliceError;

/// About so many bytes of layers wait to be written.
const WAITING_BYTES: u64 = 256 << 20;

/// A container that is being written, from the bottom layer up.
pub(crate) trait LayerWriter: Sync {
    /// A layer as the container holds it.
    type Layer: Send;

    /// Encodes layer number `layer`, its labels ordered `[y][x]`. Called from several threads, in any order.
    fn encode(&self, layer: u32, labels: &[u8], control: &Control<'_>) -> Result<Self::Layer, SliceError>;

    /// Takes the next layer, the bottom one first.
    fn write(&mut self, layer: Self::Layer) -> Result<(), SliceError>;

    /// Writes what follows the layers, and gives the files their names.
    fn finish(self, control: &Control<'_>) -> Result<(), SliceError>;
}

/// Writes `layers` layers of a grid, those above it as air. The bytes do not depend on the number of threads; each
/// holds one layer of labels, and a few encoded ones wait. Progress counts layers.
pub(crate) fn write_layers<W: LayerWriter>(
    grid: &LabelGrid,
    layers: u32,
    mut writer: W,
    control: &Control<'_>,
) -> Result<(), SliceError> {
    let [width, height, depth] = grid.size();
    let threads = rayon::current_num_threads() as u64;
    let area = width as usize * height as usize;
    let batch = (WAITING_BYTES / (area as u64).max(1)).clamp(threads, 16 * threads) as u32;
    let done = AtomicU64::new(0);
    for first in (0..layers).step_by(batch as usize) {
        let encoded = (first..layers.min(first.saturating_add(batch)))
            .into_par_iter()
            .map_init(
                || vec![AIR; area],
                |labels, z| {
                    control.check()?;
                    if z < depth {
                        grid.copy_layer(z, labels)?;
                    } else {
                        labels.fill(AIR);
                    }
                    let encoded = writer.encode(z, labels, control)?;
                    control.advance(&done, 1, u64::from(layers));
                    Ok(encoded)
                },
            )
            .collect::<Result<Vec<_>, SliceError>>()?;
        for layer in encoded {
            writer.write(layer)?;
        }
    }
    control.check()?;
    writer.finish(control)
}
