//! Material arrangements of the data set: patterns of mixtures, halftoned to one material a voxel
//! (paper, section 4.1 and Figure 2).

use rand_core::Rng;
use serde::{Deserialize, Serialize};

use crate::noise::{fractal_noise, hash, unit, voronoi_cell};

/// Volume fractions of the materials, in label order; sum 1.
pub type Mixture = Vec<f64>;

/// How mixtures vary over space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pattern {
    /// One mixture everywhere.
    Constant,
    /// Noise thresholded into bands, each with a mixture: sharp edges.
    Bands,
    /// Noise that blends between mixtures.
    Blend,
    /// Voronoi cells, each with a mixture.
    Cells,
    /// Single voxels drawn without regard to their neighbours' mixtures.
    Speckle,
}

/// How a mixture becomes one material a voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Dither {
    /// Independent random thresholds.
    White,
    /// A three-dimensional additive recurrence: neighbouring thresholds differ.
    Recurrence,
}

/// The arrangement of one volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Texture {
    /// Seed of noise and thresholds.
    pub seed: u64,
    /// How mixtures vary.
    pub pattern: Pattern,
    /// Feature size in mm.
    pub scale_mm: f64,
    /// Octaves of noise.
    pub octaves: u32,
    /// Mixtures of the pattern.
    pub palette: Vec<Mixture>,
    /// Depth in mm to which the pattern reaches; infinite fills the volume.
    pub depth_mm: f64,
    /// Mixture below that depth.
    pub core: Mixture,
    /// How mixtures become labels.
    pub dither: Dither,
}

impl Texture {
    /// The label of a voxel centred at `p` mm, `depth` mm below the surface.
    pub fn label(&self, voxel: [i64; 3], p: [f64; 3], depth: f64) -> u8 {
        let [x, y, z] = voxel;
        let threshold = match self.dither {
            Dither::White => unit(hash(self.seed ^ 0x5eed, x, y, z)),
            // Inverse powers of the root of t^4 = t + 1: the three-dimensional golden ratio.
            Dither::Recurrence => {
                let offset = unit(hash(self.seed ^ 0x5eed, 0, 0, 0));
                let sum = x as f64 * 0.819_172_513_396_164_4
                    + y as f64 * 0.671_043_606_703_789_2
                    + z as f64 * 0.549_700_477_901_970_2;
                (sum + offset).rem_euclid(1.0)
            }
        };
        if depth > self.depth_mm {
            return pick(&self.core, threshold);
        }
        let q = p.map(|v| v / self.scale_mm);
        // Noise lies within about ±0.9; its middle half holds most of its values.
        let level = || (0.5 + 0.9 * fractal_noise(self.seed, q, self.octaves)).clamp(0.0, 1.0);
        let n = self.palette.len();
        match self.pattern {
            Pattern::Constant => pick(&self.palette[0], threshold),
            Pattern::Cells => {
                pick(&self.palette[(voronoi_cell(self.seed, q) % n as u64) as usize], threshold)
            }
            Pattern::Speckle => {
                pick(&self.palette[(hash(self.seed, x, y, z) % n as u64) as usize], threshold)
            }
            Pattern::Bands => {
                let band = (level() * (2 * n) as f64) as usize % n;
                pick(&self.palette[band], threshold)
            }
            Pattern::Blend => {
                let at = level() * (n - 1) as f64;
                let (low, t) = ((at as usize).min(n.saturating_sub(2)), at - at.floor());
                let mixed: Mixture = match self.palette.get(low + 1) {
                    Some(high) => self.palette[low].iter().zip(high).map(|(a, b)| a + t * (b - a)).collect(),
                    None => self.palette[low].clone(),
                };
                pick(&mixed, threshold)
            }
        }
    }
}

/// The label whose share of 0..1 holds `threshold`.
fn pick(mixture: &[f64], threshold: f64) -> u8 {
    let mut sum = 0.0;
    for (i, fraction) in mixture.iter().enumerate() {
        sum += fraction;
        if threshold < sum {
            return i as u8 + 1;
        }
    }
    mixture.iter().rposition(|&f| f > 0.0).unwrap_or(0) as u8 + 1
}

/// A random mixture: a pure material, two materials, a tint of the last (white), or anything.
pub fn random_mixture(rng: &mut impl Rng, materials: usize) -> Mixture {
    let mut uniform = || unit(rng.next_u64());
    let mut mixture = vec![0.0; materials];
    let any = |u: f64, n: usize| ((u * n as f64) as usize).min(n - 1);
    let white = materials - 1;
    match any(uniform(), 4) {
        0 => mixture[any(uniform(), materials)] = 1.0,
        1 => {
            let share = uniform();
            mixture[any(uniform(), materials)] += share;
            mixture[any(uniform(), materials)] += 1.0 - share;
        }
        2 => {
            // Quadratic towards white: pale tints are common in textures.
            let tint = uniform().powi(2);
            mixture[any(uniform(), materials)] += tint;
            mixture[white] += 1.0 - tint;
        }
        _ => {
            let weights: Vec<f64> = (0..materials).map(|_| -(1.0 - uniform()).ln()).collect();
            let sum: f64 = weights.iter().sum();
            mixture.iter_mut().zip(weights).for_each(|(m, w)| *m = w / sum.max(1e-300));
        }
    }
    mixture
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_pcg::Pcg64;

    #[test]
    fn dithers_reproduce_the_mixture() {
        let mixture = vec![0.1, 0.0, 0.25, 0.05, 0.6];
        for dither in [Dither::White, Dither::Recurrence] {
            let texture = Texture {
                seed: 4,
                pattern: Pattern::Constant,
                scale_mm: 1.0,
                octaves: 1,
                palette: vec![mixture.clone()],
                depth_mm: f64::INFINITY,
                core: vec![0.0, 0.0, 0.0, 0.0, 1.0],
                dither,
            };
            let mut counts = [0.0; 6];
            let n = 32i64;
            for i in 0..n * n * n {
                counts[usize::from(texture.label([i % n, i / n % n, i / n / n], [0.0; 3], 0.1))] += 1.0;
            }
            let total = (n * n * n) as f64;
            for (label, &fraction) in mixture.iter().enumerate() {
                // Five standard errors of independent draws; the recurrence does better.
                let error = (fraction * (1.0 - fraction) / total).sqrt();
                assert!((counts[label + 1] / total - fraction).abs() <= 5.0 * error, "{dither:?} {label}");
            }
        }
    }

    #[test]
    fn below_the_depth_is_the_core() {
        let texture = Texture {
            seed: 4,
            pattern: Pattern::Cells,
            scale_mm: 0.5,
            octaves: 1,
            palette: vec![vec![1.0, 0.0], vec![0.5, 0.5]],
            depth_mm: 0.3,
            core: vec![0.0, 1.0],
            dither: Dither::White,
        };
        let labels: Vec<u8> =
            (0..200).map(|i| texture.label([i, 0, 0], [i as f64 * 0.1, 0.0, 0.0], 0.31)).collect();
        assert!(labels.iter().all(|&l| l == 2));
        let above: Vec<u8> =
            (0..200).map(|i| texture.label([i, 0, 0], [i as f64 * 0.1, 0.0, 0.0], 0.29)).collect();
        assert!(above.contains(&1) && above.contains(&2));
    }

    #[test]
    fn random_mixtures_sum_to_one() {
        let mut rng = Pcg64::new(1, 2);
        for _ in 0..1000 {
            let m = random_mixture(&mut rng, 5);
            assert!((m.iter().sum::<f64>() - 1.0).abs() < 1e-12 && m.iter().all(|&f| f >= 0.0), "{m:?}");
        }
    }
}
