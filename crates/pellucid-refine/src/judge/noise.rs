//! What is noise in the mean of two halves of the passes: they differ by twice the error of their mean.

use rayon::prelude::*;

use crate::difference::{differences, lab_of};

/// Of a value a surface voxel: noise energy by radius, and of chroma at the widest.
pub(super) type Energy = [f32; 4];

pub(super) fn mean_of(halves: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
    match halves {
        [a, b] => a.par_iter().zip(b).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect(),
        halves => halves.first().cloned().unwrap_or_default(),
    }
}

/// CIEDE2000 that is noise, and squared chroma, by voxel. Empty of one pass.
pub(super) fn noise_of(halves: &[Vec<[f32; 3]>]) -> Vec<[f32; 2]> {
    let [a, b] = halves else { return Vec::new() };
    let [a, b] = [a, b].map(|half| lab_of(half));
    let chroma = |a: &[f32; 3], b: &[f32; 3]| 0.25 * ((a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2));
    differences(&a, &b).into_iter().zip(a.iter().zip(&b)).map(|(d, (a, b))| [0.5 * d, chroma(a, b)]).collect()
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
