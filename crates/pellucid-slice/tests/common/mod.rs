//! What the tests share.

use pellucid_slice::PrintTarget;
use pellucid_voxel::{Frame, LabelGrid, Tile};

/// Where grids lie: no round numbers.
pub const ORIGIN: [f64; 3] = [0.1, -7.3, 1.0 / 3.0];

/// A grid whose labels are a hash of the voxel and the seed, in blobs so that some tiles are constant.
pub fn hashed(size: [u32; 3], seed: u64, target: &PrintTarget) -> LabelGrid {
    let frame = Frame::new(ORIGIN, target.pitch(), size).unwrap();
    let mut grid =
        LabelGrid::from_tiles(frame, |t| Tile::Constant(((u64::from(t[0] + t[1]) + seed) % 6) as u8));
    let mut state = seed | 1;
    for _ in 0..size.iter().product::<u32>().min(4000) {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let voxel = std::array::from_fn(|a| (state >> (8 + 17 * a)) as u32 % size[a]);
        grid.set(voxel, ((state >> 60) % 6) as u8);
    }
    grid
}
