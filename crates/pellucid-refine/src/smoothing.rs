//! Gaussian smoothing over the surface.
//!
//! Light averages the materials within a few tenths of a millimetre, so a residual finer than that cannot
//! be corrected by its own voxel's material: fed back, it only piles up as noise. Smoothing leaves what the
//! print can follow, and averages Monte Carlo noise away.

use pellucid_voxel::{Control, Surface, VoxelError};
use rayon::prelude::*;

/// Neighbours whose normals differ more lie on another side of an edge or a thin sheet.
const SAME_SIDE: f32 = 0.5;
/// Standard deviation in mm of one pass; wider Gaussians take several.
const PASS_MM: f64 = 0.045;
/// Points that one task handles.
const CHUNK: usize = 2048;

/// Weighted neighbours of every surface voxel.
pub(crate) struct Smoother {
    passes: u32,
    /// Where each voxel's neighbours begin, one entry more than voxels.
    starts: Vec<u64>,
    neighbours: Vec<u32>,
    /// Position in `weights` of each neighbour's offset.
    offsets: Vec<u16>,
    weights: Vec<f32>,
}

impl Smoother {
    /// Prepares smoothing by a Gaussian of `sigma_mm`; 0 leaves values as they are.
    pub(crate) fn new(surface: &Surface, sigma_mm: f64, control: &Control<'_>) -> Result<Self, VoxelError> {
        let passes = (sigma_mm / PASS_MM).powi(2).ceil() as u32;
        if passes == 0 {
            return Ok(Self { passes, starts: vec![], neighbours: vec![], offsets: vec![], weights: vec![] });
        }
        let sigma = sigma_mm / f64::from(passes).sqrt();
        let pitch = surface.frame().pitch().mm();
        let reach = pitch.map(|p| (2.0 * sigma / p).floor().min(8.0) as i64);
        let mut steps = Vec::new();
        let mut weights = Vec::new();
        for z in -reach[2]..=reach[2] {
            for y in -reach[1]..=reach[1] {
                for x in -reach[0]..=reach[0] {
                    let step = [x, y, z];
                    let squared: f64 = (0..3).map(|a| (step[a] as f64 * pitch[a]).powi(2)).sum();
                    if squared <= (2.0 * sigma).powi(2) {
                        steps.push(step);
                        weights.push((-0.5 * squared / (sigma * sigma)).exp() as f32);
                    }
                }
            }
        }
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
                    steps.iter().enumerate().filter_map(neighbour).collect()
                };
                Ok(voxels.iter().enumerate().map(list).collect())
            })
            .collect::<Result<_, VoxelError>>()?;
        let mut starts = Vec::with_capacity(surface.len() + 1);
        starts.push(0);
        let (mut neighbours, mut offsets) = (Vec::new(), Vec::new());
        for list in lists.into_iter().flatten() {
            for (index, weight) in list {
                neighbours.push(index);
                offsets.push(weight);
            }
            starts.push(neighbours.len() as u64);
        }
        Ok(Self { passes, starts, neighbours, offsets, weights })
    }

    /// Smooths one value a surface voxel. A constant stays constant.
    pub(crate) fn apply(&self, values: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
        let mut values = values;
        for _ in 0..self.passes {
            values = self
                .starts
                .par_windows(2)
                .with_min_len(CHUNK)
                .map(|range| self.average(range, &values))
                .collect();
        }
        values
    }

    fn average(&self, range: &[u64], values: &[[f32; 3]]) -> [f32; 3] {
        let range = range[0] as usize..range[1] as usize;
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

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Frame, LabelGrid, Pitch, SurfaceOptions, Tile};

    fn block() -> Surface {
        let frame = Frame::new([0.0; 3], Pitch::j750(), [64, 32, 96]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
        Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap()
    }

    #[test]
    fn an_impulse_spreads_by_the_stated_deviation_in_every_direction() {
        let surface = block();
        let smoother = Smoother::new(&surface, 0.1, &Control::none()).unwrap();
        // The middle of the face y = 0 shows x and z.
        let centre = surface.index_of([32, 0, 48]).unwrap() as usize;
        let mut values = vec![[0.0; 3]; surface.len()];
        values[centre] = [1.0; 3];
        let spread = smoother.apply(values);
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
            // Cutting each pass at two deviations narrows it.
            let deviation = (second[a] / total).sqrt();
            assert!((0.075..0.105).contains(&deviation), "axis {a}: {deviation}");
        }
    }

    #[test]
    fn constants_stay_and_zero_width_changes_nothing() {
        let surface = block();
        let smoother = Smoother::new(&surface, 0.12, &Control::none()).unwrap();
        let smooth = smoother.apply(vec![[0.25, 1.0, -3.0]; surface.len()]);
        assert!(smooth.iter().all(|v| (v[0] - 0.25).abs() < 1e-6 && (v[2] + 3.0).abs() < 1e-5));
        let off = Smoother::new(&surface, 0.0, &Control::none()).unwrap();
        let values: Vec<[f32; 3]> = (0..surface.len()).map(|i| [i as f32, 0.0, 1.0]).collect();
        assert_eq!(off.apply(values.clone()), values);
    }
}
