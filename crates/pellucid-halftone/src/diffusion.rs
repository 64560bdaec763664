//! Error diffusion, to compare with.

use pellucid_core::random::{Domain, uniform};
use pellucid_core::{Cancelled, Control};
use pellucid_voxel::Pitch;

/// Most labels of a mixture.
const MAX_LABELS: usize = 16;
const START: Domain = Domain::new("error diffusion");

/// Which later voxels take an error, and what share of it each.
///
/// ```
/// use pellucid_halftone::Spread;
/// use pellucid_voxel::Pitch;
/// let spread = Spread::of_pitch(Pitch::j750());
/// let share = |step| spread.steps().iter().find(|s| s.0 == step).map_or(0.0, |s| s.1);
/// // Layers are thinner than voxels are long.
/// assert!(share([0, 0, 1]) > share([1, 0, 0]) && share([1, 0, 0]) > share([0, 1, 0]));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Spread(Vec<([i64; 3], f32)>);

impl Spread {
    /// Floyd and Steinberg's (1976), each layer by itself.
    pub fn layer() -> Self {
        let shares = [([1, 0, 0], 7.0), ([-1, 1, 0], 3.0), ([0, 1, 0], 5.0), ([1, 1, 0], 1.0)];
        Self::of(shares.into_iter())
    }

    /// Floyd and Steinberg's, halved, and the other half for the voxel above (as in Lou and Stucki 1998).
    pub fn layers() -> Self {
        let above = ([0, 0, 1], Self::layer().0.iter().map(|s| s.1).sum());
        Self::of(Self::layer().0.into_iter().chain([above]))
    }

    /// All 13 neighbours that come later, by the inverse square of their distances in mm, so that a pattern is as
    /// fine in every direction where voxels are not cubes (Brunton, Arikan and Urban 2015 weigh by the pitch too).
    pub fn of_pitch(pitch: Pitch) -> Self {
        let steps = (0..27i64).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]);
        let later = steps.filter(|[x, y, z]| (z, y, x) > (&0, &0, &0));
        Self::of(later.map(|step: [i64; 3]| {
            let squared: f64 = (0..3).map(|a| (step[a] as f64 * pitch.mm()[a]).powi(2)).sum();
            (step, (1.0 / squared) as f32)
        }))
    }

    /// Of shares that need not sum to 1.
    fn of(shares: impl Iterator<Item = ([i64; 3], f32)>) -> Self {
        let mut all: Vec<_> = shares.collect();
        let total: f32 = all.iter().map(|s| s.1).sum();
        all.iter_mut().for_each(|s| s.1 /= total);
        Self(all)
    }

    /// Steps `[x, y, z]` in voxels and the share of each; they sum to 1.
    pub fn steps(&self) -> &[([i64; 3], f32)] {
        &self.0
    }

    fn within_layers(&self) -> bool {
        self.0.iter().all(|(step, _)| step[2] == 0)
    }
}

/// Halftones a box of `size` voxels `[x, y, z]` by vector error diffusion: each voxel takes the label whose fraction plus
/// the errors so far is the greatest, and hands what it did not get of the others to neighbours that come later.
///
/// The first layer starts with random errors of `seed`, or light greys would wait several layers for theirs to build up
/// and then all flip together; every layer does where none hands on to the next.
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
/// use pellucid_halftone::{Spread, diffuse_errors};
/// let grey = |_: [u32; 3], fractions: &mut [f32]| {
///     fractions.copy_from_slice(&[0.25, 0.75]);
///     true
/// };
/// let chosen = diffuse_errors([16, 16, 16], 2, &Spread::layers(), 0, grey, &Control::none())?;
/// let dark = chosen.iter().filter(|&&c| c == 0).count();
/// assert!(dark.abs_diff(1024) < 64);
/// # Ok::<(), pellucid_core::Cancelled>(())
/// ```
pub fn diffuse_errors(
    size: [u32; 3],
    labels: usize,
    spread: &Spread,
    seed: u64,
    mut mixture: impl FnMut([u32; 3], &mut [f32]) -> bool,
    control: &Control<'_>,
) -> Result<Vec<u8>, Cancelled> {
    assert!((1..=MAX_LABELS).contains(&labels), "{labels} labels; 1 to {MAX_LABELS} are possible");
    let [nx, ny, nz] = size.map(|s| s as usize);
    let mut chosen = vec![u8::MAX; nx * ny * nz];
    // Errors of this layer and of the next, `[y][x][label]`.
    let mut here = start_errors(nx * ny, labels, seed, 0);
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
                let later = spread.0.iter().filter_map(|([dx, dy, dz], weight)| {
                    let (to_x, to_y) = (x as i64 + dx, y as i64 + dy);
                    let inside = (0..nx as i64).contains(&to_x) && (0..ny as i64).contains(&to_y);
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
        match spread.within_layers() {
            true => here = start_errors(nx * ny, labels, seed, z as u64 + 1),
            false => above.fill(0.0),
        }
    }
    Ok(chosen)
}

/// Errors that sum to zero at each of the voxels of a layer.
fn start_errors(voxels: usize, labels: usize, seed: u64, layer: u64) -> Vec<f32> {
    let mut errors = Vec::with_capacity(voxels * labels);
    for voxel in 0..voxels as u64 {
        let drawn =
            (0..labels as u64).map(|l| uniform(seed, START, voxel, layer * MAX_LABELS as u64 + l) as f32);
        let first = errors.len();
        errors.extend(drawn);
        let own = &mut errors[first..];
        let mean = own.iter().sum::<f32>() / labels as f32;
        own.iter_mut().for_each(|e| *e -= mean);
    }
    errors
}
