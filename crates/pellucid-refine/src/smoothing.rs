//! Gaussian smoothing over the surface.
//!
//! Light averages the materials within a few tenths of a millimetre, so what the target lacks on a finer scale cannot
//! be corrected by a voxel's own material: fed back, it only piles up as noise. Smoothing leaves what the print can
//! follow, and averages Monte Carlo noise away.

use std::ops::Range;

use pellucid_core::{Cancelled, Control};
use pellucid_voxel::Surface;
use rayon::prelude::*;

/// Neighbours whose normals differ more lie on another side of an edge or a thin sheet.
const SAME_SIDE: f32 = 0.5;
/// Standard deviation in mm of one pass; wider Gaussians take several.
const PASS_MM: f64 = 0.045;
/// A pass is cut at this many standard deviations.
const CUT: f64 = 2.0;
/// Along an axis whose voxels are longer than this part of the cut, the cut would leave the next voxel less than the
/// Gaussian's share: only few of its own neighbours lie within it.
const FINE: f64 = 0.8;
/// Points that one task handles.
const CHUNK: usize = 2048;

/// Smooths values of surface voxels by Gaussians over the surface: from voxel to voxel whose normals agree, so never
/// through a thin sheet.
///
/// A Gaussian is made of passes over lists of neighbours, which are built once. Constants stay.
///
/// ```
/// use pellucid_refine::SurfaceSmoother;
/// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions, Tile};
/// let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3])?, [32, 32, 32])?;
/// let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none())?;
/// let smoother = SurfaceSmoother::new(&surface, 0.1, &Control::none())?;
/// let stripes: Vec<[f32; 3]> = surface.voxels().iter().map(|v| [(v[0] % 2) as f32; 3]).collect();
/// let smooth = smoother.smooth(stripes, &Control::none())?;
/// let top = surface.index_of([16, 16, 31]).unwrap();
/// assert!((smooth[top as usize][0] - 0.5).abs() < 0.2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SurfaceSmoother {
    /// Passes of [`SurfaceSmoother::smooth`].
    passes: u32,
    /// Variance in mm² along the surface that a whole pass adds, the mean over faces of a block.
    pass_variance: f64,
    neighbours: Neighbours,
    weights: Vec<f32>,
}

/// Neighbours of every surface voxel, itself among them, in runs: neighbours along x follow each other in the list of
/// surface voxels, and their offsets in that of weights.
#[derive(Default)]
struct Neighbours {
    /// Runs before each task's voxels.
    before: Vec<u64>,
    /// Where each voxel's runs end among those of its task.
    ends: Vec<u32>,
    runs: Vec<Run>,
}

/// Neighbours that follow each other, in six bytes.
#[derive(Clone, Copy)]
struct Run {
    /// The first of them, its lower half first.
    first: [u16; 2],
    /// Position of its offset's weight, and the number of the others in the last [`LENGTH_BITS`] bits. A pass has fewer
    /// than 4096 offsets: it reaches 8 voxels.
    shape: u16,
}

const LENGTH_BITS: u32 = 4;
const LENGTH: u16 = (1 << LENGTH_BITS) - 1;

impl Run {
    fn new(point: u32, weight: u16) -> Self {
        Self { first: [point as u16, (point >> 16) as u16], shape: weight << LENGTH_BITS }
    }

    fn points(self) -> Range<usize> {
        let first = (u32::from(self.first[1]) << 16 | u32::from(self.first[0])) as usize;
        first..first + usize::from(self.shape & LENGTH) + 1
    }

    fn weights(self) -> Range<usize> {
        let first = usize::from(self.shape >> LENGTH_BITS);
        first..first + usize::from(self.shape & LENGTH) + 1
    }

    /// Takes a neighbour in where it follows.
    fn extend(&mut self, point: u32, weight: u16) -> bool {
        let follows = self.points().end == point as usize && self.weights().end == usize::from(weight);
        let extended = follows && self.shape & LENGTH < LENGTH;
        self.shape += u16::from(extended);
        extended
    }
}

impl Neighbours {
    /// A voxel's neighbours in runs.
    fn of(&self, point: usize) -> impl Iterator<Item = Run> {
        let before = self.before[point / CHUNK] as usize;
        let start = if point.is_multiple_of(CHUNK) { 0 } else { self.ends[point - 1] as usize };
        self.runs[before + start..before + self.ends[point] as usize].iter().copied()
    }
}

/// Offsets within reach of a pass, and their weights.
struct Kernel {
    steps: Vec<[i64; 3]>,
    weights: Vec<f32>,
}

impl SurfaceSmoother {
    /// Prepares Gaussians of `sigma_mm` and others; 0 leaves values as they are. Takes some 65 bytes a surface voxel
    /// at 600 x 300 x 940 DPI.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(surface: &Surface, sigma_mm: f64, control: &Control<'_>) -> Result<Self, Cancelled> {
        let passes = (sigma_mm / PASS_MM).powi(2).ceil() as u32;
        let sigma = sigma_mm / f64::from(passes.max(1)).sqrt();
        let kernel = Kernel::new(sigma, surface.frame().pitch().mm());
        Self::with_kernel(surface, kernel, passes, control)
    }

    /// Prepares [`SurfaceSmoother::widen`] by passes that each have the variance of `pass_mm`, or a little more, on the
    /// faces of a block; so has [`SurfaceSmoother::smooth`], of one pass.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn exact(surface: &Surface, pass_mm: f64, control: &Control<'_>) -> Result<Self, Cancelled> {
        let pitch = surface.frame().pitch().mm();
        // Cutting narrows a pass by at most a fifth.
        let wider = (0..=30).map(|i| Kernel::new(pass_mm * (1.0 + 0.01 * f64::from(i)), pitch));
        let mut kernel = Kernel::new(1.3 * pass_mm, pitch);
        if let Some(found) = wider.into_iter().find(|k| k.variance(pitch) >= pass_mm * pass_mm) {
            kernel = found;
        }
        Self::with_kernel(surface, kernel, u32::from(pass_mm > 0.0), control)
    }

    fn with_kernel(
        surface: &Surface,
        kernel: Kernel,
        passes: u32,
        control: &Control<'_>,
    ) -> Result<Self, Cancelled> {
        let pass_variance = kernel.variance(surface.frame().pitch().mm());
        let neighbours =
            if passes == 0 { Neighbours::default() } else { kernel.neighbours(surface, control)? };
        Ok(Self { passes, pass_variance, neighbours, weights: kernel.weights })
    }

    /// Smooths one row of values a surface voxel by the Gaussian that this was prepared for. Passes are cut at two deviations,
    /// so that a Gaussian of several comes out up to a fifth narrower than it is named. Progress counts passes.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn smooth<const N: usize>(
        &self,
        values: Vec<[f32; N]>,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; N]>, Cancelled> {
        self.run(values, self.passes, 1.0, control)
    }

    /// Smooths rows that were smoothed by a Gaussian of `from_mm` further to one of `to_mm`, exact in variance in the
    /// mean over the faces of a block. Nothing changes when `to_mm` is not greater.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn widen<const N: usize>(
        &self,
        values: Vec<[f32; N]>,
        from_mm: f64,
        to_mm: f64,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; N]>, Cancelled> {
        let variance = (to_mm * to_mm - from_mm * from_mm).max(0.0);
        let passes = (variance / self.pass_variance).ceil();
        let share = variance / (passes.max(1.0) * self.pass_variance);
        self.run(values, passes as u32, share as f32, control)
    }

    /// The transpose of [`SurfaceSmoother::smooth`]: of derivatives by smoothed values it makes those by the values.
    /// Rows may be of any length.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn transposed<const N: usize>(
        &self,
        mut values: Vec<[f32; N]>,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; N]>, Cancelled> {
        if self.neighbours.ends.is_empty() {
            return Ok(values);
        }
        // Lists and weights are symmetric: of a pass, only the division by the sum of weights changes sides.
        let totals: Vec<f32> = (0..values.len()).into_par_iter().map(|point| self.total(point)).collect();
        let mut next = vec![[0.0; N]; values.len()];
        for _ in 0..self.passes {
            values.par_iter_mut().zip(&totals).for_each(|(v, total)| v.iter_mut().for_each(|v| *v /= total));
            self.each(&mut next, control, |point| self.sum(point, &values))?;
            std::mem::swap(&mut values, &mut next);
        }
        Ok(values)
    }

    fn run<const N: usize>(
        &self,
        mut values: Vec<[f32; N]>,
        passes: u32,
        share: f32,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; N]>, Cancelled> {
        if self.neighbours.ends.is_empty() || passes == 0 {
            return Ok(values);
        }
        let mut next = vec![[0.0; N]; values.len()];
        for pass in 0..passes {
            self.each(&mut next, control, |point| {
                let total = self.total(point);
                let mean = self.sum(point, &values).map(|s| s / total);
                let own = values[point];
                match share < 1.0 {
                    true => std::array::from_fn(|c| own[c] + share * (mean[c] - own[c])),
                    false => mean,
                }
            })?;
            std::mem::swap(&mut values, &mut next);
            control.report(u64::from(pass) + 1, u64::from(passes));
        }
        Ok(values)
    }

    /// Fills `out` by point.
    fn each<T: Send>(
        &self,
        out: &mut [T],
        control: &Control<'_>,
        value: impl Fn(usize) -> T + Sync,
    ) -> Result<(), Cancelled> {
        out.par_chunks_mut(CHUNK).enumerate().try_for_each(|(chunk, out)| {
            control.check()?;
            out.iter_mut().enumerate().for_each(|(i, out)| *out = value(chunk * CHUNK + i));
            Ok(())
        })
    }

    /// Weighted sum over a point's neighbours.
    fn sum<const N: usize>(&self, point: usize, values: &[[f32; N]]) -> [f32; N] {
        let mut sum = [0.0; N];
        for run in self.neighbours.of(point) {
            for (value, weight) in values[run.points()].iter().zip(&self.weights[run.weights()]) {
                (0..N).for_each(|c| sum[c] += weight * value[c]);
            }
        }
        sum
    }

    /// Sum of the weights of a point's neighbours.
    fn total(&self, point: usize) -> f32 {
        self.neighbours.of(point).flat_map(|run| &self.weights[run.weights()]).sum()
    }
}

impl Kernel {
    /// A Gaussian, cut. Along an axis whose voxels are about as long as the cut, or longer, the next voxel takes part
    /// whole, with the weight that gives three voxels the Gaussian's variance.
    fn new(sigma: f64, pitch: [f64; 3]) -> Self {
        let coarse: [Option<f64>; 3] = std::array::from_fn(|a| {
            let t = (sigma / pitch[a]).powi(2);
            (pitch[a] > FINE * CUT * sigma).then_some(t / (2.0 - 2.0 * t))
        });
        let reach = |a: usize| match coarse[a] {
            Some(_) => 1,
            None => (CUT * sigma / pitch[a]).floor().min(8.0) as i64,
        };
        let (mut steps, mut weights) = (Vec::new(), Vec::new());
        let [x, y, z] = [0, 1, 2].map(|a| -reach(a)..=reach(a));
        for z in z {
            for y in y.clone() {
                for x in x.clone() {
                    let step = [x, y, z];
                    let fine = |a: &usize| coarse[*a].is_none();
                    let squared: f64 = (0..3).filter(fine).map(|a| (step[a] as f64 * pitch[a]).powi(2)).sum();
                    if squared <= (CUT * sigma).powi(2) {
                        let next =
                            (0..3).filter(|&a| step[a] != 0).filter_map(|a| coarse[a]).product::<f64>();
                        steps.push(step);
                        weights.push(((-0.5 * squared / (sigma * sigma)).exp() * next) as f32);
                    }
                }
            }
        }
        Self { steps, weights }
    }

    /// Mean over the three faces of a block, and over the two axes of each, of the variance in mm² that a pass adds.
    fn variance(&self, pitch: [f64; 3]) -> f64 {
        let face = |normal: usize| {
            let (mut total, mut second) = (0.0, 0.0);
            for (step, &weight) in self.steps.iter().zip(&self.weights).filter(|(s, _)| s[normal] == 0) {
                let squared: f64 = (0..3).map(|a| (step[a] as f64 * pitch[a]).powi(2)).sum();
                total += f64::from(weight);
                second += f64::from(weight) * squared;
            }
            second / (2.0 * total)
        };
        (0..3).map(face).sum::<f64>() / 3.0
    }

    fn neighbours(&self, surface: &Surface, control: &Control<'_>) -> Result<Neighbours, Cancelled> {
        let normals = surface.normals();
        let lists: Vec<(Vec<u32>, Vec<Run>)> = surface
            .voxels()
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(chunk, voxels)| {
                control.check()?;
                let (mut ends, mut runs) = (Vec::with_capacity(voxels.len()), Vec::<Run>::new());
                for (voxel, normal) in voxels.iter().zip(&normals[chunk * CHUNK..]) {
                    let agrees = |n: [f32; 3]| (0..3).map(|a| n[a] * normal[a]).sum::<f32>() > SAME_SIDE;
                    let from = runs.len();
                    for (w, step) in self.steps.iter().enumerate() {
                        let at = std::array::from_fn(|a| i64::from(voxel[a]) + step[a]);
                        let index = surface.frame().checked(at).and_then(|at| surface.index_of(at));
                        if let Some(index) = index.filter(|&i| agrees(normals[i as usize])) {
                            let last = runs[from..].last_mut();
                            if !last.is_some_and(|run| run.extend(index, w as u16)) {
                                runs.push(Run::new(index, w as u16));
                            }
                        }
                    }
                    ends.push(runs.len() as u32);
                }
                Ok((ends, runs))
            })
            .collect::<Result<_, Cancelled>>()?;
        let total = lists.iter().map(|(_, runs)| runs.len()).sum();
        let mut all = Neighbours {
            before: Vec::with_capacity(lists.len()),
            ends: Vec::with_capacity(surface.len()),
            runs: Vec::with_capacity(total),
        };
        for (ends, runs) in lists {
            all.before.push(all.runs.len() as u64);
            all.ends.extend(ends);
            all.runs.extend(runs);
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_core::random::{Domain, uniform};
    use pellucid_voxel::{Frame, LabelGrid, Pitch, SurfaceOptions, Tile};
    use proptest::prelude::*;
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

    fn block(pitch: Pitch, size: [u32; 3]) -> Surface {
        let frame = Frame::new([0.0; 3], pitch, size).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
        Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap()
    }

    #[test]
    fn an_impulse_spreads_by_the_stated_deviation_in_every_direction() {
        let surface = block(Pitch::j750(), [64, 32, 96]);
        let smoother = SurfaceSmoother::new(&surface, 0.1, &Control::none()).unwrap();
        // The middle of the face y = 0 shows x and z.
        let centre = surface.index_of([32, 0, 48]).unwrap() as usize;
        let mut values = vec![[0.0; 3]; surface.len()];
        values[centre] = [1.0; 3];
        let spread = smoother.smooth(values.clone(), &Control::none()).unwrap();
        let exact = SurfaceSmoother::exact(&surface, 0.045, &Control::none()).unwrap();
        let wider = exact.widen(values, 0.0, 0.1, &Control::none()).unwrap();
        // Cutting each pass at two deviations narrows it; the other makes up for it in the mean over faces and axes.
        for (spread, range) in [(spread, 0.075..0.105), (wider, 0.09..0.11)] {
            let (mut total, mut second) = (0.0, [0.0; 3]);
            for (voxel, value) in surface.voxels().iter().zip(&spread) {
                total += f64::from(value[0]);
                for a in 0..3 {
                    let d = (f64::from(voxel[a]) - [32.0, 0.0, 48.0][a]) * surface.frame().pitch().mm()[a];
                    second[a] += f64::from(value[0]) * d * d;
                }
            }
            assert!((total - 1.0).abs() < 1e-4, "{total}");
            for a in [0, 2] {
                let deviation = (second[a] / total).sqrt();
                assert!(range.contains(&deviation), "axis {a}: {deviation}");
            }
        }
    }

    fn count(smoother: &SurfaceSmoother, point: usize) -> usize {
        smoother.neighbours.of(point).map(|run| run.points().len()).sum()
    }

    #[test]
    fn neighbours_are_those_within_reach_on_the_same_side() {
        for pitch in [Pitch::j750(), Pitch::new([0.004, 0.03, 0.02]).unwrap()] {
            let surface = block(pitch, [40, 20, 50]);
            let smoother = SurfaceSmoother::new(&surface, 0.045, &Control::none()).unwrap();
            let kernel = Kernel::new(0.045, pitch.mm());
            let normals = surface.normals();
            for (point, voxel) in surface.voxels().iter().enumerate() {
                let agree = |i: u32| {
                    (0..3).map(|a| normals[i as usize][a] * normals[point][a]).sum::<f32>() > SAME_SIDE
                };
                let expected = kernel.steps.iter().zip(&kernel.weights).filter_map(|(step, &weight)| {
                    let at =
                        surface.frame().checked(std::array::from_fn(|a| i64::from(voxel[a]) + step[a]))?;
                    Some((surface.index_of(at).filter(|&i| agree(i))? as usize, weight))
                });
                let found = smoother.neighbours.of(point);
                let found = found.flat_map(|run| run.points().zip(run.weights()));
                let found = found.map(|(i, w)| (i, smoother.weights[w]));
                assert!(found.eq(expected), "{voxel:?}");
            }
            // 65 bytes a voxel at the J750's pitch; finer ones have longer runs.
            let runs = smoother.neighbours.runs.len();
            if pitch == Pitch::j750() {
                assert!(runs * size_of::<Run>() + 4 * surface.len() < 70 * surface.len());
            }
            assert!(2 * runs < (0..surface.len()).map(|p| count(&smoother, p)).sum());
        }
    }

    #[test]
    fn constants_stay_and_zero_width_changes_nothing() {
        let surface = block(Pitch::j750(), [64, 32, 96]);
        let smoother = SurfaceSmoother::new(&surface, 0.12, &Control::none()).unwrap();
        let smooth = smoother.smooth(vec![[0.25, 1.0, -3.0]; surface.len()], &Control::none()).unwrap();
        assert!(smooth.iter().all(|v| (v[0] - 0.25).abs() < 1e-6 && (v[2] + 3.0).abs() < 1e-5));
        let off = SurfaceSmoother::new(&surface, 0.0, &Control::none()).unwrap();
        let values: Vec<[f32; 3]> = (0..surface.len()).map(|i| [i as f32, 0.0, 1.0]).collect();
        assert_eq!(off.smooth(values.clone(), &Control::none()).unwrap(), values);
    }

    #[test]
    fn cancelling_stops_between_passes() {
        let surface = block(Pitch::j750(), [64, 32, 96]);
        let smoother = SurfaceSmoother::new(&surface, 1.0, &Control::none()).unwrap();
        let (stop, seen) = (AtomicBool::new(false), AtomicU64::new(0));
        let progress = |done: u64, total: u64| {
            assert!(total > 400);
            seen.store(done, Ordering::Relaxed);
            stop.store(done == 3, Ordering::Relaxed);
        };
        let control = Control::none().with_cancel(&stop).with_progress(&progress);
        assert_eq!(smoother.smooth(vec![[1.0; 3]; surface.len()], &control), Err(Cancelled));
        assert_eq!(seen.load(Ordering::Relaxed), 3);
    }

    /// What the discrete Gaussian (Lindeberg 1990) leaves of the variance of white noise along one axis: the sum of its
    /// squared weights, exp(-2t) I0(2t) at t deviations squared in voxels.
    fn variance_left(t: f64) -> f64 {
        let mut term = 1.0;
        let mut sum = 1.0;
        for k in 1..2000 {
            term *= (t / f64::from(k)).powi(2);
            sum += term;
            if term < 1e-17 * sum {
                break;
            }
        }
        (-2.0 * t).exp() * sum
    }

    /// Variance that smoothing leaves of white noise on the inner part of the face z = 0, and the Gaussian's.
    fn white_noise(pitch: [f64; 3], sigma: f64, seed: u64, widen: bool) -> (f64, f64) {
        let margin: [u32; 2] = std::array::from_fn(|a| (4.0 * sigma / pitch[a]).ceil() as u32 + 1);
        let size = [2 * margin[0] + 90, 2 * margin[1] + 90, 3];
        let surface = block(Pitch::new(pitch).unwrap(), size);
        let value = |i: usize| (uniform(seed, Domain::new("white"), i as u64, 0) - 0.5) as f32;
        let noise: Vec<[f32; 3]> = (0..surface.len()).map(|i| [value(i); 3]).collect();
        let smoother = SurfaceSmoother::new(&surface, sigma, &Control::none()).unwrap();
        let smooth = match widen {
            true => SurfaceSmoother::exact(&surface, 0.045, &Control::none())
                .and_then(|s| s.widen(noise, 0.0, sigma, &Control::none())),
            false => smoother.smooth(noise, &Control::none()),
        };
        let inner =
            |v: &[u32; 3]| v[2] == 0 && (0..2).all(|a| (margin[a]..size[a] - margin[a]).contains(&v[a]));
        let kept: Vec<f64> = surface
            .voxels()
            .iter()
            .zip(&smooth.unwrap())
            .filter(|(v, _)| inner(v))
            .map(|(_, s)| f64::from(s[0]))
            .collect();
        let left = 12.0 * kept.iter().map(|v| v * v).sum::<f64>() / kept.len() as f64;
        (left, (0..2).map(|a| variance_left((sigma / pitch[a]).powi(2))).product())
    }

    #[test]
    fn the_transpose_is_one() {
        // A block has edges and corners, where totals differ.
        let surface = block(Pitch::new([0.05, 0.08, 0.03]).unwrap(), [14, 11, 17]);
        let value = |i: usize, c: u64| (uniform(5, Domain::new("transpose"), i as u64, c) - 0.3) as f32;
        for sigma in [0.0, 0.045, 0.1] {
            let smoother = SurfaceSmoother::new(&surface, sigma, &Control::none()).unwrap();
            let a: Vec<[f32; 2]> = (0..surface.len()).map(|i| [value(i, 0), value(i, 1)]).collect();
            let b: Vec<[f32; 2]> = (0..surface.len()).map(|i| [value(i, 2), value(i, 3)]).collect();
            let smooth = smoother.smooth(a.clone(), &Control::none()).unwrap();
            let back = smoother.transposed(b.clone(), &Control::none()).unwrap();
            let dot = |x: &[[f32; 2]], y: &[[f32; 2]]| -> f64 {
                x.iter().flatten().zip(y.iter().flatten()).map(|(x, y)| f64::from(x * y)).sum()
            };
            let (there, here) = (dot(&smooth, &b), dot(&a, &back));
            assert!((there - here).abs() < 1e-5 * there.abs(), "{sigma}: {there} {here}");
        }
    }

    #[test]
    fn a_coarse_axis_is_smoothed_beside_a_fine_one() {
        // The next voxel lies just within a cut, its own neighbours along the fine axis do not.
        let (left, gaussian) = white_noise([0.08944526, 0.02, 0.03], 0.17913395, 0, false);
        assert!(left < 1.9 * gaussian, "{left} of {gaussian}");
    }

    #[test]
    fn noise_falls_on_either_side_of_the_pitch_where_it_once_did_not() {
        // A pass of 0.045 mm that is cut at two deviations reaches no neighbour from 0.09 mm on.
        for pitch in [0.0893, 0.0897, 0.1] {
            let (left, gaussian) = white_noise([pitch; 3], 0.1, 1, false);
            assert!(left < 1.5 * gaussian && left < 0.2, "{pitch}: {left}, Gaussian {gaussian}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn variance_of_white_noise_falls_by_the_gaussians_factor(
            x in 0.02f64..0.3, y in 0.02f64..0.3, sigma in 0.045f64..0.2, seed in 0u64..1000, widen: bool,
        ) {
            let (left, gaussian) = white_noise([x, y, 0.03], sigma, seed, widen);
            // Cut passes are up to a fifth narrower along each axis, which leaves up to 1.5 times the variance; the
            // estimate's own standard error is about 15 % where a Gaussian covers 50 of 8,100 voxels.
            prop_assert!((0.6..1.9).contains(&(left / gaussian)), "{x} {y} {sigma} {widen}: {left} of {gaussian}");
        }

        #[test]
        fn constants_stay_at_every_pitch(
            x in 0.02f64..0.3, y in 0.02f64..0.3, z in 0.02f64..0.3, sigma in 0.0f64..1.0, value in -2.0f32..2.0,
        ) {
            let surface = block(Pitch::new([x, y, z]).unwrap(), [9, 8, 7]);
            let smoother = SurfaceSmoother::new(&surface, sigma, &Control::none()).unwrap();
            for smooth in [
                smoother.smooth(vec![[value; 3]; surface.len()], &Control::none()).unwrap(),
                smoother.widen(vec![[value; 3]; surface.len()], 0.1 * sigma, sigma, &Control::none()).unwrap(),
            ] {
                prop_assert!(smooth.iter().flatten().all(|v| (v - value).abs() < 1e-4 * value.abs().max(1e-3)));
            }
        }

        #[test]
        fn the_order_of_points_does_not_matter(
            x in 0.03f64..0.2, y in 0.03f64..0.2, sigma in 0.02f64..0.3, seed in 0u64..1000,
        ) {
            // A block upside down and turned round is the same block with its points in reverse.
            let surface = block(Pitch::new([x, y, 0.04]).unwrap(), [12, 9, 15]);
            let smoother = SurfaceSmoother::new(&surface, sigma, &Control::none()).unwrap();
            let value = |i: u64, c: u64| uniform(seed, Domain::new("order"), i, c) as f32;
            let values: Vec<[f32; 3]> =
                (0..surface.len() as u64).map(|i| std::array::from_fn(|c| value(i, c as u64))).collect();
            let reversed: Vec<[f32; 3]> = values.iter().rev().copied().collect();
            let smooth = smoother.smooth(values, &Control::none()).unwrap();
            let turned = smoother.smooth(reversed, &Control::none()).unwrap();
            for (a, b) in smooth.iter().zip(turned.iter().rev()) {
                prop_assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-5), "{a:?} {b:?}");
            }
        }
    }
}
