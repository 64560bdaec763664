//! From volume fractions and a threshold to a label.

/// Cumulative shares of 65535 at which one label gives way to the next. A mixture of `n` labels needs `n - 1`: the
/// last label takes what the others leave.
///
/// ```
/// use pellucid_halftone::Thresholds;
/// let mut row = [0; 2];
/// Thresholds::write(&[0.25, 0.5, 0.25], &mut row);
/// let chosen = |threshold| Thresholds::choose(&row, threshold);
/// assert_eq!([chosen(0.1), chosen(0.5), chosen(0.9)], [0, 1, 2]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Thresholds;

impl Thresholds {
    /// Writes the cumulative shares of `fractions` (each at least 0, sum 1, in halftone order) to `row`, one less
    /// than fractions; the shorter length counts.
    pub fn write(fractions: &[f32], row: &mut [u16]) {
        let mut sum = 0.0;
        for (slot, fraction) in row.iter_mut().zip(fractions) {
            sum += fraction;
            *slot = (sum * 65535.0).round().clamp(0.0, 65535.0) as u16;
        }
    }

    /// The position of the label that a voxel with this threshold (0 to 1) takes: 0 up to and with the length of
    /// `row`. A greater threshold never gives an earlier label.
    #[inline]
    pub fn choose(row: &[u16], threshold: f32) -> usize {
        let threshold = (threshold * 65535.0) as u16;
        row.iter().position(|&sum| threshold < sum).unwrap_or(row.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn thresholds_are_monotone_and_take_their_shares(parts in prop::collection::vec(0.0f32..1.0, 2..17)) {
            let total: f32 = parts.iter().sum::<f32>() + 1e-3;
            let mut fractions: Vec<f32> = parts.iter().map(|p| p / total).collect();
            let last = fractions.len() - 1;
            fractions[last] += 1e-3 / total;
            let mut row = vec![0; last];
            Thresholds::write(&fractions, &mut row);
            prop_assert!(row.windows(2).all(|w| w[0] <= w[1]), "{row:?}");
            let steps = 4096;
            let mut counts = vec![0u32; fractions.len()];
            let mut before = 0;
            for i in 0..steps {
                let label = Thresholds::choose(&row, (i as f32 + 0.5) / steps as f32);
                prop_assert!(label >= before);
                before = label;
                counts[label] += 1;
            }
            for (count, fraction) in counts.iter().zip(&fractions) {
                // A step at either end, and the rounding to 65535 parts.
                prop_assert!((*count as f32 - fraction * steps as f32).abs() < 2.2, "{counts:?} {fractions:?}");
            }
        }
    }

    #[test]
    fn pure_labels_take_every_voxel() {
        for pure in 0..3 {
            let mut fractions = [0.0; 3];
            fractions[pure] = 1.0;
            let mut row = [0; 2];
            Thresholds::write(&fractions, &mut row);
            for threshold in [1e-6, 0.5, 1.0 - 1e-5] {
                assert_eq!(Thresholds::choose(&row, threshold), pure);
            }
        }
    }
}
