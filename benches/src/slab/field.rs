//! Colours over a slab's surface, and Gaussians over it.

use super::Slab;

/// Deviations at which a Gaussian is cut.
const CUT: f64 = 3.0;

/// A Gaussian over a surface that repeats sideways. Its weights are symmetric: it is its own transpose.
pub struct Gaussian {
    edge: usize,
    /// Weights by distance in voxels, wrapped to the surface's edge.
    weights: Vec<f64>,
}

impl Gaussian {
    /// Of a standard deviation in mm; 0 changes nothing.
    pub fn new(slab: &Slab, sigma_mm: f64) -> Self {
        let (edge, sigma) = (slab.edge, sigma_mm / slab.voxel_mm);
        let mut weights = vec![0.0; edge];
        let reach = (CUT * sigma).ceil() as i64;
        for distance in -reach..=reach {
            let weight = if sigma > 0.0 { (-0.5 * (distance as f64 / sigma).powi(2)).exp() } else { 1.0 };
            weights[distance.rem_euclid(edge as i64) as usize] += weight;
        }
        let sum: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= sum);
        Self { edge, weights }
    }

    /// Smooths `[y][x]` values.
    pub fn apply<const N: usize>(&self, field: &[[f64; N]]) -> Vec<[f64; N]> {
        let n = self.edge;
        let pass = |field: &[[f64; N]], at: &dyn Fn(usize, usize) -> usize| {
            let mut out = vec![[0.0; N]; field.len()];
            for line in 0..n {
                for i in 0..n {
                    let sum = &mut out[at(line, i)];
                    for (k, weight) in self.weights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                        let from = &field[at(line, (i + k) % n)];
                        (0..N).for_each(|c| sum[c] += weight * from[c]);
                    }
                }
            }
            out
        };
        pass(&pass(field, &|line, i| line * n + i), &|line, i| i * n + line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::small_slab;

    #[test]
    fn a_gaussian_keeps_the_sum_and_is_its_own_transpose() {
        let slab = Slab { edge: 9, ..small_slab() };
        for sigma_mm in [0.0, 0.15, 2.0] {
            let gaussian = Gaussian::new(&slab, sigma_mm);
            let spike = |at: usize| {
                let mut field = vec![[0.0, 0.0]; 81];
                field[at] = [1.0, -2.0];
                gaussian.apply(&field)
            };
            let (a, b) = (spike(13), spike(40));
            let sum: f64 = a.iter().map(|v| v[0]).sum();
            assert!((sum - 1.0).abs() < 1e-12);
            assert!((a[40][0] - b[13][0]).abs() < 1e-15 && (a[40][1] + 2.0 * a[40][0]).abs() < 1e-15);
            assert_eq!(a[13][0] == 1.0, sigma_mm == 0.0);
        }
    }
}
