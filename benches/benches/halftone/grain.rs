//! How grainy a halftone looks, and how far its mean is from its mixture.

use std::sync::Arc;

use pellucid::color::space::Lab;
use pellucid::color::{Viewing, delta_e_2000};
use pellucid::predict::{Changed, Draw, MonteCarlo, Object, Pass, Predictor};
use pellucid::refine::SurfaceSmoother;
use pellucid::voxel::{Control, LabelGrid, MaterialTable, Surface, SurfaceOptions};
use pellucid_benches::appearance::Error;

use super::plate::Plate;

const INDEX: f64 = 1.5;
/// Gaussians of the surface in mm that a plate is looked at through.
pub const VIEWED_MM: [f64; 3] = [0.045, 0.1, 0.2];

/// What is seen of a plate: at each of [`VIEWED_MM`], colours of the points looked at by two sets of paths.
pub struct Look {
    pub at: [[Vec<Lab>; 2]; 3],
    /// As it is, for pictures: where, and linear RGB.
    pub raw: Vec<([f64; 2], [f32; 3])>,
}

/// Looks at a plate.
pub fn look(
    plate: &Plate,
    labels: &LabelGrid,
    materials: &MaterialTable,
    viewing: &Viewing,
    paths: u32,
    control: &Control<'_>,
) -> Result<Look, Error> {
    let surface = Surface::extract(labels, &SurfaceOptions::default(), control)?;
    let object = Arc::new(Object::new(surface, materials.clone(), INDEX)?);
    let upper = plate.upper(object.surface());
    let points: Vec<u32> = upper.iter().map(|p| p.0).collect();
    let mut bound = MonteCarlo::new(paths)?.bind(Arc::clone(&object))?;
    bound.update(labels, Changed::Unknown, control)?;
    let mut seen: Vec<Vec<[f32; 3]>> = Vec::new();
    for half in 0..2 {
        let mut out = vec![0.0; points.len() * 3];
        bound.predict(&points, Draw::new(half, Pass::Trial), &mut out, control)?;
        seen.push(out.chunks_exact(3).map(|radiance| viewing.relative_rgb(radiance)).collect());
    }
    let mut at: [[Vec<Lab>; 2]; 3] = std::array::from_fn(|_| [Vec::new(), Vec::new()]);
    for (i, mm) in VIEWED_MM.into_iter().enumerate() {
        let smoother = SurfaceSmoother::new(object.surface(), mm, control)?;
        for half in 0..2 {
            // A fourth value says how much of each mean is of predicted points.
            let mut rows = vec![[0.0; 4]; object.surface().len()];
            for (&point, &[r, g, b]) in points.iter().zip(&seen[half]) {
                rows[point as usize] = [r, g, b, 1.0];
            }
            let rows = smoother.smooth(rows, control)?;
            let mean = |point: u32| {
                let [r, g, b, share] = rows[point as usize].map(f64::from);
                Lab::from_linear_rgb([r / share, g / share, b / share])
            };
            at[i][half] = upper.iter().filter(|p| p.1).map(|p| mean(p.0)).collect();
        }
    }
    let voxels = object.surface().voxels();
    let both = seen[0].iter().zip(&seen[1]).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c])));
    let raw = points.iter().zip(both).map(|(&p, rgb)| (plate.seen_at(voxels[p as usize]), rgb)).collect();
    Ok(Look { at, raw })
}

impl Look {
    /// Root mean square of the Lab difference to a plate of the homogeneous mixture, less the mean difference, at each
    /// of [`VIEWED_MM`]: from the covariance of both sets of paths, whose noise is independent.
    pub fn grain(&self, even: &Look) -> [f64; 3] {
        std::array::from_fn(|i| {
            let off = |half: usize| -> Vec<[f64; 3]> {
                let pairs = self.at[i][half].iter().zip(&even.at[i][half]);
                let off: Vec<[f64; 3]> = pairs.map(|(s, e)| [s.l - e.l, s.a - e.a, s.b - e.b]).collect();
                let mean: [f64; 3] =
                    std::array::from_fn(|c| off.iter().map(|v| v[c]).sum::<f64>() / off.len().max(1) as f64);
                off.iter().map(|v| std::array::from_fn(|c| v[c] - mean[c])).collect()
            };
            let (first, second) = (off(0), off(1));
            let products = first.iter().zip(&second).flat_map(|(a, b)| (0..3).map(move |c| a[c] * b[c]));
            (products.sum::<f64>() / first.len().max(1) as f64).max(0.0).sqrt()
        })
    }

    /// CIEDE2000 between the mean colours of both.
    pub fn shift(&self, even: &Look) -> f64 {
        delta_e_2000(self.mean(), even.mean())
    }

    fn mean(&self) -> Lab {
        let all = self.at[2].iter().flatten();
        let n = (self.at[2][0].len() + self.at[2][1].len()).max(1) as f64;
        let sum = all.fold([0.0; 3], |s, lab| [s[0] + lab.l, s[1] + lab.a, s[2] + lab.b]);
        Lab { l: sum[0] / n, a: sum[1] / n, b: sum[2] / n }
    }
}
