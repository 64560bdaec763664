//! What is noise in the mean of two halves of the passes: they differ by twice the error of their mean.

use rayon::prelude::*;

use crate::difference::{differences, lab_of};

/// Squared noise of a surface voxel: CIEDE2000 by radius, and across the hue at the widest.
pub(super) type Energy = [f32; 4];

pub(super) fn mean_of(halves: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
    match halves {
        [a, b] => a.par_iter().zip(b).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect(),
        halves => halves.first().cloned().unwrap_or_default(),
    }
}

/// By voxel, CIEDE2000 that is noise, and the squared noise of (a\*, b\*) across the hue of the mean, which adds to
/// chroma; along it noise cancels. `mean` is the mean in Lab. Empty of one pass.
pub(super) fn noise_of(halves: &[Vec<[f32; 3]>], mean: &[[f32; 3]]) -> Vec<[f32; 2]> {
    let [a, b] = halves else { return Vec::new() };
    let [a, b] = [a, b].map(|half| lab_of(half));
    let across = |a: &[f32; 3], b: &[f32; 3], mean: &[f32; 3]| {
        let turned = (a[1] - b[1]) * mean[2] - (a[2] - b[2]) * mean[1];
        0.25 * turned * turned / (mean[1] * mean[1] + mean[2] * mean[2]).max(f32::MIN_POSITIVE)
    };
    let voxels = a.par_iter().zip(&b).zip(mean);
    let across: Vec<f32> = voxels.map(|((a, b), mean)| across(a, b, mean)).collect();
    differences(&a, &b).into_iter().zip(across).map(|(d, across)| [0.5 * d, across]).collect()
}

pub(super) fn mean_noise(noise: &[[f32; 2]]) -> f64 {
    noise.iter().map(|&[v, _]| f64::from(v)).sum::<f64>() / noise.len().max(1) as f64
}

/// Takes the energy of the noise at a radius out of differences.
pub(super) fn without_noise(mut differences: Vec<f32>, energy: &[Energy], radius: usize) -> Vec<f32> {
    differences
        .iter_mut()
        .zip(energy)
        .for_each(|(d, energy)| *d = (*d * *d - energy[radius]).max(0.0).sqrt());
    differences
}
