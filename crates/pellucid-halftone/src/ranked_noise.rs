//! Blue-noise thresholds made in a moment: close to a mask of void-and-cluster, good enough for training data.

use pellucid_voxel::Pitch;

/// Voxels of a period along `[x, y, z]`.
const SIZE: [usize; 3] = [32, 16, 48];
/// Standard deviation in mm of the blur whose result is taken away: about two voxels of the J750.
const BLUR_MM: f64 = 0.07;
const ROUNDS: usize = 8;

/// A periodic array of thresholds in 0..1, each value once, without low frequencies in millimetres.
///
/// White noise is high-passed and ranked, again and again: cheaper than void-and-cluster and close enough to
/// it for training data.
#[derive(Clone, Debug, PartialEq)]
pub struct RankedNoise {
    /// Ordered `[z][y][x]`.
    thresholds: Vec<f32>,
}

impl RankedNoise {
    /// The thresholds for a pitch. `white` gives the white noise that they start from, in 0..1, by position; the same
    /// noise gives the same thresholds.
    pub fn new(pitch: Pitch, white: impl Fn(usize) -> f64) -> Self {
        let cells: usize = SIZE.iter().product();
        let mut values: Vec<f32> = (0..cells).map(|i| white(i) as f32).collect();
        let mut order: Vec<u32> = (0..cells as u32).collect();
        for _ in 0..ROUNDS {
            let mut low = values.clone();
            let mut stride = 1;
            for axis in 0..3 {
                low = blur(&low, SIZE[axis], stride, BLUR_MM / pitch.mm()[axis]);
                stride *= SIZE[axis];
            }
            for (v, l) in values.iter_mut().zip(&low) {
                *v -= l;
            }
            // The position settles ties, so that the result is the same everywhere.
            order
                .sort_unstable_by(|&a, &b| values[a as usize].total_cmp(&values[b as usize]).then(a.cmp(&b)));
            for (rank, &i) in order.iter().enumerate() {
                values[i as usize] = (rank as f32 + 0.5) / cells as f32;
            }
        }
        Self { thresholds: values }
    }

    /// The threshold of a voxel anywhere.
    pub fn at(&self, voxel: [i64; 3]) -> f64 {
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| voxel[a].rem_euclid(SIZE[a] as i64) as usize);
        f64::from(self.thresholds[(z * SIZE[1] + y) * SIZE[0] + x])
    }
}

/// Blurs along one axis of a periodic array by a Gaussian of `sigma` voxels.
fn blur(values: &[f32], size: usize, stride: usize, sigma: f64) -> Vec<f32> {
    let reach = ((3.0 * sigma).ceil() as usize).min(size / 2);
    let weight = |d: usize| (-0.5 * (d as f64 / sigma).powi(2)).exp();
    let sum = weight(0) + 2.0 * (1..=reach).map(weight).sum::<f64>();
    let weights: Vec<f32> = (0..=reach).map(|d| (weight(d) / sum) as f32).collect();
    (0..values.len())
        .map(|i| {
            let at = i / stride % size;
            let line = i - at * stride;
            let value = |k: usize| values[line + k % size * stride];
            let sides = (1..=reach).map(|d| weights[d] * (value(at + d) + value(at + size - d))).sum::<f32>();
            weights[0] * value(at) + sides
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_core::random::{Domain, uniform};

    #[test]
    fn every_threshold_occurs_once_and_averages_settle_fast() {
        let noise = RankedNoise::new(Pitch::j750(), |i| uniform(1, Domain::new("ranked noise"), i as u64, 0));
        let cells = noise.thresholds.len();
        let mut sorted = noise.thresholds.clone();
        sorted.sort_by(f32::total_cmp);
        for (i, t) in sorted.iter().enumerate() {
            assert!((f64::from(*t) * cells as f64 - i as f64 - 0.5).abs() < 0.01);
        }
        assert_eq!(noise.at([-1, -1, -1]), noise.at([31, 15, 47]));
        // Means over boxes of 8 x 4 x 12 voxels (0.34 mm) against those of white noise.
        let mut squares = 0.0;
        let boxes = 64;
        for b in 0..boxes {
            let low = [b % 4 * 8, b / 4 % 4 * 4, b / 16 * 12];
            let voxels = (0..384).map(|i| [low[0] + i % 8, low[1] + i / 8 % 4, low[2] + i / 32]);
            squares += (voxels.map(|v| noise.at(v)).sum::<f64>() / 384.0 - 0.5).powi(2);
        }
        let white = (1.0f64 / 12.0 / 384.0).sqrt();
        let part = (squares / f64::from(boxes as u32)).sqrt() / white;
        assert!(part < 0.45, "{part} of white noise's");
    }
}
