//! Local thickness: how much solid lies behind each surface voxel.

use std::sync::atomic::AtomicU64;

use rayon::prelude::*;

use crate::{AIR, Control, LabelGrid, Surface, TILE, Tile, VoxelError};

/// Surface voxels a task takes.
const CHUNK: usize = 4096;

/// Thickness in mm of the solid at each surface voxel, in the order of the surface.
///
/// It is the length of the straight run of solid through the voxel's centre along its normal:
/// inward to the first air and outward to the first air. A level slab of n layers has exactly n
/// layer heights; a tilted one has its thickness within the extent of a voxel along the normal,
/// half a voxel too much on average; a ball has its diameter. Lengths are cut at `max_mm`, which bounds the work:
/// ask for no more than is of interest. Progress counts surface voxels.
///
/// ```
/// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions, Tile};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [48, 48, 20]).unwrap();
/// let slab = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
/// let control = Control::none();
/// let surface = Surface::extract(&slab, &SurfaceOptions::default(), &control).unwrap();
/// let thickness = pellucid_voxel::local_thickness_mm(&slab, &surface, 1.0, &control).unwrap();
/// let top = surface.index_of([24, 24, 19]).unwrap() as usize;
/// assert!((thickness[top] - 20.0 * 0.027_021).abs() < 1e-4);
/// ```
///
/// # Errors
/// [`VoxelError::Invalid`] when the surface lies in another frame or `max_mm` is not finite and
/// above 0, [`VoxelError::Cancelled`].
pub fn local_thickness_mm(
    grid: &LabelGrid,
    surface: &Surface,
    max_mm: f64,
    control: &Control,
) -> Result<Vec<f32>, VoxelError> {
    if grid.frame() != surface.frame() {
        return Err(VoxelError::invalid(
            "surface",
            format!("its frame {:?} is not the grid's {:?}", surface.frame(), grid.frame()),
        ));
    }
    if !(max_mm.is_finite() && max_mm > 0.0) {
        return Err(VoxelError::invalid("max_mm", format!("{max_mm}; it must be finite and above 0")));
    }
    let mut thickness = vec![0.0; surface.len()];
    let done = AtomicU64::new(0);
    thickness.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, out)| {
        control.check()?;
        let from = chunk * CHUNK;
        for (out, i) in out.iter_mut().zip(from..) {
            let (voxel, normal) = (surface.voxels()[i], surface.normals()[i].map(f64::from));
            let inward = solid_run(grid, voxel, normal.map(|c| -c), max_mm);
            *out = (inward + solid_run(grid, voxel, normal, max_mm - inward)) as f32;
        }
        control.advance(&done, out.len() as u64, surface.len() as u64);
        Ok::<(), VoxelError>(())
    })?;
    Ok(thickness)
}

/// Length in mm from a voxel's centre along a unit direction to the first air, at most `max_mm`;
/// 0 when the voxel is air.
fn solid_run(grid: &LabelGrid, voxel: [u32; 3], direction: [f64; 3], max_mm: f64) -> f64 {
    let mm = grid.frame().pitch().mm();
    let size = grid.size();
    // Distance to the next face along each axis, and between faces.
    let gap: [f64; 3] = std::array::from_fn(|a| mm[a] / direction[a].abs());
    let mut next = gap.map(|g| 0.5 * g);
    let mut at = voxel;
    let mut length = 0.0;
    // The tile last looked at, so that a run within it costs no look-up.
    let mut tile_at = [u32::MAX; 3];
    let mut tile = &Tile::Constant(AIR);
    while length < max_mm {
        let t = at.map(|v| v / TILE as u32);
        if t != tile_at {
            (tile_at, tile) = (t, grid.tile(t));
        }
        let [x, y, z] = at.map(|v| v as usize % TILE);
        if tile.label(x, y, z) == AIR {
            return length;
        }
        let a = if next[0] <= next[1] && next[0] <= next[2] {
            0
        } else if next[1] <= next[2] {
            1
        } else {
            2
        };
        length = next[a];
        next[a] += gap[a];
        let step = if direction[a] > 0.0 { 1 } else { -1 };
        match at[a].checked_add_signed(step) {
            Some(v) if v < size[a] => at[a] = v,
            _ => break,
        }
    }
    length.min(max_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Frame, Pitch, SurfaceOptions};

    fn carve(half: f64, solid: impl Fn([f64; 3]) -> bool + Sync) -> LabelGrid {
        let size = Pitch::j750().mm().map(|p| (2.0 * half / p).ceil() as u32);
        let frame = Frame::new([-half; 3], Pitch::j750(), size).unwrap();
        LabelGrid::from_fn(frame, |v| u8::from(solid(frame.centre_mm(v.map(i64::from)))))
    }

    fn thickness(grid: &LabelGrid, max_mm: f64) -> (Surface, Vec<f32>) {
        let surface = Surface::extract(grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let lengths = local_thickness_mm(grid, &surface, max_mm, &Control::none()).unwrap();
        (surface, lengths)
    }

    #[test]
    fn level_slabs_are_exact_along_every_axis() {
        for axis in 0..3 {
            let layers = 14u32;
            let mut size = [60; 3];
            size[axis] = layers + 3;
            let frame = Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
            let mut grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
            for i in 0..3600 {
                for layer in [0, layers + 1, layers + 2] {
                    let mut v = [i % 60; 3];
                    v[(axis + 1) % 3] = i / 60;
                    v[axis] = layer;
                    grid.set(v, AIR);
                }
            }
            let (surface, lengths) = thickness(&grid, 10.0);
            for layer in [1, layers] {
                let mut v = [30; 3];
                v[axis] = layer;
                let expected = f64::from(layers) * Pitch::j750().mm()[axis];
                let found = lengths[surface.index_of(v).unwrap() as usize];
                assert!((f64::from(found) - expected).abs() < 1e-5, "axis {axis}: {found} for {expected}");
            }
            let (_, cut) = thickness(&grid, 0.2);
            assert!(cut.iter().all(|&l| l > 0.0 && l <= 0.2));
        }
    }

    #[test]
    fn balls_and_tilted_slabs_have_their_thickness() {
        let ball = carve(1.2, |p| p.iter().map(|c| c * c).sum::<f64>() <= 1.0);
        let (_, lengths) = thickness(&ball, 10.0);
        let mean = lengths.iter().map(|&l| f64::from(l)).sum::<f64>() / lengths.len() as f64;
        assert!((mean - 2.0).abs() < 0.05, "{mean}");
        let n = [0.48, 0.6, 0.64];
        let slab = carve(1.2, |p| (0..3).map(|a| p[a] * n[a]).sum::<f64>().abs() <= 0.25);
        let (surface, lengths) = thickness(&slab, 10.0);
        let inner: Vec<f64> = (0..surface.len())
            .filter(|&i| surface.position_mm(i as u32).iter().map(|c| c * c).sum::<f64>() < 0.5)
            .map(|i| f64::from(lengths[i]))
            .collect();
        let mean = inner.iter().sum::<f64>() / inner.len() as f64;
        // Half a voxel's extent along the normal.
        let edge: f64 = 0.5 * (0..3).map(|a| n[a] * Pitch::j750().mm()[a]).sum::<f64>();
        assert!((mean - 0.5).abs() < edge, "{mean}");
        assert!(inner.iter().all(|l| (0.4..0.65).contains(l)));
    }

    #[test]
    fn refuses_another_frame_or_no_length() {
        let frame = |size| Frame::new([0.0; 3], Pitch::j750(), size).unwrap();
        let grid = LabelGrid::from_tiles(frame([20, 20, 20]), |_| Tile::Constant(1));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        assert!(
            local_thickness_mm(&LabelGrid::new(frame([20, 20, 21])), &surface, 1.0, &Control::none())
                .is_err()
        );
        for max_mm in [0.0, f64::NAN, f64::INFINITY] {
            assert!(local_thickness_mm(&grid, &surface, max_mm, &Control::none()).is_err());
        }
        let stop = std::sync::atomic::AtomicBool::new(true);
        let cancelled = local_thickness_mm(&grid, &surface, 1.0, &Control::none().with_cancel(&stop));
        assert_eq!(cancelled.err(), Some(VoxelError::Cancelled));
    }
}
