//! How far the pictures of a proof are off what many paths say.

use pellucid_color::Viewing;
use pellucid_core::NoisyScore;
use serde::{Deserialize, Serialize};

/// Error of the appearance that a proof shows, whose noise was taken out for the eye: against many paths at some surface
/// voxels, in linear RGB relative to the print's white; those paths' own noise is taken out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PictureError {
    /// Root mean square over voxels and R, G, B.
    pub rmse: f64,
    /// Mean of what is shown less what the paths say.
    pub bias: f64,
    /// Surface voxels that were compared.
    pub points: u64,
}

impl PictureError {
    /// Of what every surface voxel shows, against the radiance of some of them by two halves of paths, `[point][channel]`.
    pub(crate) fn of(shown: &[[f32; 3]], points: &[u32], halves: &[Vec<f32>; 2], viewing: &Viewing) -> Self {
        let mut score = NoisyScore::default();
        let rgb = |half: &Vec<f32>, i: usize| {
            let channels = viewing.channels();
            viewing.relative_rgb(&half[i * channels..][..channels]).map(f64::from)
        };
        for (i, &point) in points.iter().enumerate() {
            let [a, b] = halves.each_ref().map(|half| rgb(half, i));
            for c in 0..3 {
                score.add(f64::from(shown[point as usize][c]), [a[c], b[c]]);
            }
        }
        Self { rmse: score.rmse(), bias: score.bias(), points: points.len() as u64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_color::MediaWhite;

    #[test]
    fn errors_are_relative_to_the_white_and_free_of_the_paths_noise() {
        let viewing = Viewing::rgb(MediaWhite::new([0.5, 0.8, 0.4]).unwrap());
        let shown = vec![[0.9, 0.9, 0.9], [0.6, 0.6, 0.6]];
        let halves = [vec![0.25, 0.40, 0.20], vec![0.25, 0.40, 0.20]];
        let error = PictureError::of(&shown, &[1], &halves, &viewing);
        assert!((error.rmse - 0.1).abs() < 1e-6 && (error.bias - 0.1).abs() < 1e-6, "{error:?}");
        // The mean of the halves is off by as much as they are apart.
        let noisy = [vec![0.30, 0.48, 0.24], vec![0.20, 0.32, 0.16]];
        let error = PictureError::of(&[[0.6; 3]], &[0], &noisy, &viewing);
        // The root of what rounding leaves of a square.
        assert!(error.rmse < 3e-4 && error.points == 1, "{error:?}");
    }
}
