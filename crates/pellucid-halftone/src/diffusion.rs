//! Error diffusion, to compare with.

use pellucid_core::random::{Domain, uniform};
use pellucid_core::{Cancelled, Control};

/// Most labels of a mixture.
const MAX_LABELS: usize = 16;
const START: Domain = Domain::new("error diffusion");
/// Steps `[x, y, z]` to later voxels and the share of the error that each takes: Floyd and Steinberg's weights for
/// the layer, halved, and the other half for the voxel above.
const SPREAD: [([i64; 3], f32); 5] = [
    ([1, 0, 0], 7.0 / 32.0),
    ([-1, 1, 0], 3.0 / 32.0),
    ([0, 1, 0], 5.0 / 32.0),
    ([1, 1, 0], 1.0 / 32.0),
    ([0, 0, 1], 16.0 / 32.0),
];

/// Halftones a box of `size` voxels `[x, y, z]` by vector error diffusion (Floyd and Steinberg 1976, extended by the
/// voxel above as in Lou and Stucki 1998): each voxel takes the label whose fraction plus the errors so far is the
/// greatest, and hands what it did not get of the others to neighbours that come later.
///
/// The first layer starts with random errors of `seed`, or light greys would wait several layers for theirs to build up
/// and then all flip together.
///
/// `mixture` writes a voxel's `labels` fractions (1 to 16 of them, sum 1) and returns true, or false for air. The
/// result, ordered `[z][y][x]`, x fastest, holds positions of labels, [`u8::MAX`] for air. Error handed to air is
/// lost. Serial by nature, and a change at one voxel changes all later ones: the
/// refinement uses masks.
///
/// # Errors
/// [`Cancelled`].
///
/// # Panics
/// When there are no labels or more than 16.
///
/// ```
/// use pellucid_core::Control;
/// use pellucid_halftone::diffuse_errors;
/// let grey = |_: [u32; 3], fractions: &mut [f32]| {
///     fractions.copy_from_slice(&[0.25, 0.75]);
///     true
/// };
/// let chosen = diffuse_errors([16, 16, 16], 2, 0, grey, &Control::none())?;
/// let dark = chosen.iter().filter(|&&c| c == 0).count();
/// assert!(dark.abs_diff(1024) < 64);
/// # Ok::<(), pellucid_core::Cancelled>(())
/// ```
pub fn diffuse_errors(
    size: [u32; 3],
    labels: usize,
    seed: u64,
    mut mixture: impl FnMut([u32; 3], &mut [f32]) -> bool,
    control: &Control<'_>,
) -> Result<Vec<u8>, Cancelled> {
    assert!((1..=MAX_LABELS).contains(&labels), "{labels} labels; 1 to {MAX_LABELS} are possible");
    let [nx, ny, nz] = size.map(|s| s as usize);
    let mut chosen = vec![u8::MAX; nx * ny * nz];
    // Errors of this layer and of the next, `[y][x][label]`.
    let mut here = start_errors(nx * ny, labels, seed);
    let mut above = vec![0.0f32; here.len()];
    let mut wanted = [0.0f32; MAX_LABELS];
    let wanted = &mut wanted[..labels];
    for z in 0..nz {
        for y in 0..ny {
            control.check()?;
            for x in 0..nx {
                if !mixture([x as u32, y as u32, z as u32], wanted) {
                    continue;
                }
                let own = (y * nx + x) * labels;
                wanted.iter_mut().zip(&here[own..own + labels]).for_each(|(w, e)| *w += e);
                let first = (0..labels).fold(0, |best, l| if wanted[l] > wanted[best] { l } else { best });
                chosen[(z * ny + y) * nx + x] = first as u8;
                wanted[first] -= 1.0;
                let later = SPREAD.iter().filter_map(|([dx, dy, dz], weight)| {
                    let (to_x, to_y) = (x as i64 + dx, y as i64 + dy);
                    let inside = (0..nx as i64).contains(&to_x) && to_y < ny as i64;
                    inside.then(|| ((to_y as usize * nx + to_x as usize) * labels, *dz, *weight))
                });
                let total: f32 = later.clone().map(|(_, _, weight)| weight).sum();
                for (to, dz, weight) in later {
                    let plane = if dz == 0 { &mut here } else { &mut above };
                    let errors = plane[to..to + labels].iter_mut().zip(wanted.iter());
                    errors.for_each(|(e, w)| *e += weight / total * w);
                }
            }
        }
        control.report(z as u64 + 1, nz as u64);
        std::mem::swap(&mut here, &mut above);
        above.fill(0.0);
    }
    Ok(chosen)
}

/// Errors that sum to zero at each of the voxels of a layer.
fn start_errors(voxels: usize, labels: usize, seed: u64) -> Vec<f32> {
    let mut errors = Vec::with_capacity(voxels * labels);
    for voxel in 0..voxels as u64 {
        let drawn = (0..labels as u64).map(|l| uniform(seed, START, voxel, l) as f32);
        let first = errors.len();
        errors.extend(drawn);
        let own = &mut errors[first..];
        let mean = own.iter().sum::<f32>() / labels as f32;
        own.iter_mut().for_each(|e| *e -= mean);
    }
    errors
}
