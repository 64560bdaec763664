//! Gaussian smoothing over the surface.
//!
//! Light averages the materials within a few tenths of a millimetre, so what the target lacks on a finer scale cannot
//! be corrected by a voxel's own material: fed back, it only piles up as noise. Smoothing leaves what the print can
//! follow, and averages Monte Carlo noise away.

use pellucid_core::{Cancelled, Control};
use pellucid_voxel::Surface;
use rayon::prelude::*;

/// Neighbours whose normals differ more lie on another side of an edge or a thin sheet.
const SAME_SIDE: f32 = 0.5;
/// Standard deviation in mm of one pass; wider Gaussians take several.
const PASS_MM: f64 = 0.045;
/// Least standard deviation of a pass in longest voxel edges: a pass is cut at two deviations, which must reach the
/// next voxel along every axis.
const PASS_EDGES: f64 = 0.53;
/// A pass is cut at this many standard deviations.
const CUT: f64 = 2.0;
/// Points that one task handles.
const CHUNK: usize = 2048;

/// Smooths values of surface voxels by Gaussians over the surface, without crossing sharp edges or thin sheets.
///
/// A Gaussian is made of passes over lists of neighbours, which are built once. Where a pass would be narrower than the
/// voxels allow, it moves values only part of the way, which has the variance of the narrower one. Constants stay.
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
    /// Passes of [`SurfaceSmoother::smooth`], and how far each moves values.
    passes: u32,
    share: f32,
    /// Variance in mm² along the surface that a whole pass adds, the mean over faces of a block.
    pass_variance: f64,
    /// Where each voxel's neighbours begin, one entry more than voxels.
    starts: Vec<u64>,
    neighbours: Vec<u32>,
    /// Position in `weights` of each neighbour's offset.
    offsets: Vec<u16>,
    weights: Vec<f32>,
}

/// Offsets within reach of a pass, and their weights.
struct Kernel {
    steps: Vec<[i64; 3]>,
    weights: Vec<f32>,
}

impl SurfaceSmoother {
    /// Prepares Gaussians of `sigma_mm` and others; 0 leaves values as they are. Takes some 130 bytes a surface voxel
    /// at 600 x 300 x 940 DPI.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn new(surface: &Surface, sigma_mm: f64, control: &Control<'_>) -> Result<Self, Cancelled> {
        let pitch = surface.frame().pitch();
        let widest = PASS_MM.max(PASS_EDGES * pitch.max_mm());
        let passes = (sigma_mm / widest).powi(2).ceil() as u32;
        let sigma = if sigma_mm < widest { widest } else { sigma_mm / f64::from(passes).sqrt() };
        let kernel = Kernel::new(sigma, pitch.mm());
        let pass_variance = kernel.variance(pitch.mm());
        let share = (sigma_mm * sigma_mm / (f64::from(passes.max(1)) * pass_variance)).min(1.0) as f32;
        let (starts, neighbours, offsets) =
            if passes == 0 { Default::default() } else { kernel.neighbours(surface, control)? };
        let weights = kernel.weights;
        Ok(Self { passes, share, pass_variance, starts, neighbours, offsets, weights })
    }

    /// Smooths one colour a surface voxel by the Gaussian that this was prepared for. Passes are cut at two deviations,
    /// so that a Gaussian of several comes out up to a fifth narrower than it is named.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn smooth(&self, values: Vec<[f32; 3]>, control: &Control<'_>) -> Result<Vec<[f32; 3]>, Cancelled> {
        self.run(values, self.passes, self.share, control)
    }

    /// Smooths colours that were smoothed by a Gaussian of `from_mm` further to one of `to_mm`, exact in variance on the
    /// faces of a block. Nothing changes when `to_mm` is not greater.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn widen(
        &self,
        values: Vec<[f32; 3]>,
        from_mm: f64,
        to_mm: f64,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, Cancelled> {
        let variance = (to_mm * to_mm - from_mm * from_mm).max(0.0);
        let passes = (variance / self.pass_variance).ceil();
        let share = variance / (passes.max(1.0) * self.pass_variance);
        self.run(values, passes as u32, share as f32, control)
    }

    fn run(
        &self,
        mut values: Vec<[f32; 3]>,
        passes: u32,
        share: f32,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, Cancelled> {
        if self.starts.is_empty() || passes == 0 {
            return Ok(values);
        }
        let mut next = vec![[0.0; 3]; values.len()];
        for _ in 0..passes {
            let chunks = next.par_chunks_mut(CHUNK).enumerate();
            chunks.try_for_each(|(chunk, next)| {
                control.check()?;
                for (i, out) in next.iter_mut().enumerate() {
                    let point = chunk * CHUNK + i;
                    let mean = self.average(point, &values);
                    let own = values[point];
                    *out = match share < 1.0 {
                        true => std::array::from_fn(|c| own[c] + share * (mean[c] - own[c])),
                        false => mean,
                    };
                }
                Ok(())
            })?;
            std::mem::swap(&mut values, &mut next);
        }
        Ok(values)
    }

    fn average(&self, point: usize, values: &[[f32; 3]]) -> [f32; 3] {
        let range = self.starts[point] as usize..self.starts[point + 1] as usize;
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        for (&i, &w) in self.neighbours[range.clone()].iter().zip(&self.offsets[range]) {
            let (value, weight) = (values[i as usize], self.weights[usize::from(w)]);
            (0..3).for_each(|c| sum[c] += weight * value[c]);
            total += weight;
        }
        sum.map(|s| s / total)
    }
}

impl Kernel {
    fn new(sigma: f64, pitch: [f64; 3]) -> Self {
        let reach = pitch.map(|p| (CUT * sigma / p).floor().min(8.0) as i64);
        let (mut steps, mut weights) = (Vec::new(), Vec::new());
        for z in -reach[2]..=reach[2] {
            for y in -reach[1]..=reach[1] {
                for x in -reach[0]..=reach[0] {
                    let step = [x, y, z];
                    let squared: f64 = (0..3).map(|a| (step[a] as f64 * pitch[a]).powi(2)).sum();
                    if squared <= (CUT * sigma).powi(2) {
                        steps.push(step);
                        weights.push((-0.5 * squared / (sigma * sigma)).exp() as f32);
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

    /// Where the neighbours of each surface voxel begin, the neighbours, and the positions of their offsets.
    fn neighbours(
        &self,
        surface: &Surface,
        control: &Control<'_>,
    ) -> Result<(Vec<u64>, Vec<u32>, Vec<u16>), Cancelled> {
        let normals = surface.normals();
        let lists: Vec<Vec<Vec<(u32, u16)>>> = surface
            .voxels()
            .par_chunks(CHUNK)
            .enumerate()
            .map(|(chunk, voxels)| {
                control.check()?;
                let list = |(i, voxel): (usize, &[u32; 3])| {
                    let normal = normals[chunk * CHUNK + i];
                    let agrees = |n: [f32; 3]| (0..3).map(|a| n[a] * normal[a]).sum::<f32>() > SAME_SIDE;
                    let neighbour = |(w, step): (usize, &[i64; 3])| {
                        let at = std::array::from_fn(|a| i64::from(voxel[a]) + step[a]);
                        let index = surface.index_of(surface.frame().checked(at)?)?;
                        agrees(normals[index as usize]).then_some((index, w as u16))
                    };
                    self.steps.iter().enumerate().filter_map(neighbour).collect()
                };
                Ok(voxels.iter().enumerate().map(list).collect())
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut starts = Vec::with_capacity(surface.len() + 1);
        starts.push(0);
        let (mut neighbours, mut offsets) = (Vec::new(), Vec::new());
        for list in lists.into_iter().flatten() {
            for (index, offset) in list {
                neighbours.push(index);
                offsets.push(offset);
            }
            starts.push(neighbours.len() as u64);
        }
        Ok((starts, neighbours, offsets))
    }
}
