//! How errors are spread over the surface.

use serde::{Deserialize, Serialize};

/// Width of a bin in CIEDE2000.
const BIN: f64 = 1.0;
/// Bins; the last takes all that is more.
const BINS: usize = 21;

/// Shares of the surface voxels by their error to the target as given, over 0.1 mm, of the appearance that the proof
/// shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ErrorHistogram {
    /// Width of a bin in CIEDE2000; the first begins at 0, the last takes all that is more.
    pub bin: f64,
    /// Shares before refinement, 0 to 1, which sum to 1.
    pub unrefined: Vec<f64>,
    /// Shares of the labels to print.
    pub refined: Vec<f64>,
}

impl ErrorHistogram {
    /// Of errors in parts, before and after.
    pub(crate) fn of([unrefined, refined]: [&[[f32; 3]]; 2]) -> Self {
        let shares = |parts: &[[f32; 3]]| {
            let mut shares = vec![0.0; BINS];
            for part in parts {
                let error: f64 = part.iter().copied().map(f64::from).sum();
                shares[((error / BIN).max(0.0) as usize).min(BINS - 1)] += 1.0 / parts.len() as f64;
            }
            shares
        };
        Self { bin: BIN, unrefined: shares(unrefined), refined: shares(refined) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_fall_into_bins_by_their_sum() {
        let parts = [[0.2, 0.3, 0.4], [0.0, 2.5, 0.0], [30.0, 0.0, 1.0], [19.5, 0.25, 0.25]];
        let histogram = ErrorHistogram::of([&parts[..2], &parts]);
        assert_eq!((histogram.unrefined[0], histogram.unrefined[2]), (0.5, 0.5));
        assert_eq!((histogram.refined[0], histogram.refined[2], histogram.refined[20]), (0.25, 0.25, 0.5));
        assert_eq!(histogram.refined.iter().sum::<f64>(), 1.0);
        assert_eq!(histogram.refined.len(), 21);
    }
}
