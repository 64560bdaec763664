//! Error diffusion, to compare with.

use pellucid_core::{Cancelled, Control};

/// Most labels of a mixture.
const MAX_LABELS: usize = 16;
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
/// `mixture` writes a voxel's `labels` fractions (1 to 16 of them, sum 1) and returns true, or false for air. The
/// result, ordered `[z][y][x]`, x fastest, holds positions of labels, [`u8::MAX`] for air. Error that no later voxel
/// of the solid can take is dropped. Serial by nature, and a change at one voxel changes all later ones: the
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
/// let chosen = diffuse_errors([16, 16, 16], 2, grey, &Control::none())?;
/// let dark = chosen.iter().filter(|&&c| c == 0).count();
/// assert!(dark.abs_diff(1024) < 64);
/// # Ok::<(), pellucid_core::Cancelled>(())
/// ```
pub fn diffuse_errors(
    size: [u32; 3],
    labels: usize,
    mut mixture: impl FnMut([u32; 3], &mut [f32]) -> bool,
    control: &Control<'_>,
) -> Result<Vec<u8>, Cancelled> {
    assert!((1..=MAX_LABELS).contains(&labels), "{labels} labels; 1 to {MAX_LABELS} are possible");
    let [nx, ny, nz] = size.map(|s| s as usize);
    let mut chosen = vec![u8::MAX; nx * ny * nz];
    // Errors of this layer and of the next, `[y][x][label]`.
    let mut here = vec![0.0f32; nx * ny * labels];
    let mut above = here.clone();
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
                for ([dx, dy, dz], weight) in SPREAD {
                    let (to_x, to_y) = (x as i64 + dx, y as i64 + dy);
                    if to_x < 0 || to_x >= nx as i64 || to_y >= ny as i64 {
                        continue;
                    }
                    let to = (to_y as usize * nx + to_x as usize) * labels;
                    let plane = if dz == 0 { &mut here } else { &mut above };
                    plane[to..to + labels].iter_mut().zip(wanted.iter()).for_each(|(e, w)| *e += weight * w);
                }
            }
        }
        control.report(z as u64 + 1, nz as u64);
        std::mem::swap(&mut here, &mut above);
        above.fill(0.0);
    }
    Ok(chosen)
}
