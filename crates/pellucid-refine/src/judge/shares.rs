//! Where the error sits.

use serde::{Deserialize, Serialize};

/// Where the error to the target as given sits, at 0.1 mm: shares of its mean, 0 to 1, which sum to 1; all 0 where
/// there is no error.
///
/// From the target to what is shown it is three steps, each a CIEDE2000 difference: what the gamut takes, what
/// thickness takes of that, and what is left to the printable target. The error of each surface voxel is divided in
/// proportion to its steps, and the divided errors are averaged. Steps may lead back, so their lengths alone would sum
/// to more than the error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ErrorShares {
    /// The target is no colour of a thick print.
    pub out_of_gamut: f64,
    /// The material is too thin for what a thick print would show. Where the judge was not told what that is
    /// ([`Judge::with_gamut_target`](super::Judge::with_gamut_target)), this is 0 and `out_of_gamut` contains it.
    pub too_thin: f64,
    /// What is shown is not the printable target: cross-talk from neighbours' inks, grain of the halftone, and all else
    /// that refinement may lessen.
    pub cross_talk: f64,
}

impl ErrorShares {
    /// Of divided errors, `[out of gamut, too thin, cross-talk]` a surface voxel:
    /// [`Judge::error_parts`](super::Judge::error_parts).
    pub fn of(parts: &[[f32; 3]]) -> Self {
        let mut sums = [0.0f64; 3];
        parts.iter().for_each(|part| (0..3).for_each(|i| sums[i] += f64::from(part[i])));
        let whole: f64 = sums.iter().sum();
        let [out_of_gamut, too_thin, cross_talk] = sums.map(|s| if whole > 0.0 { s / whole } else { 0.0 });
        Self { out_of_gamut, too_thin, cross_talk }
    }
}

/// Divides errors in proportion to steps: the first two of each voxel, and the last.
pub(super) fn divided(errors: &[f32], first: &[[f32; 2]], last: &[f32]) -> Vec<[f32; 3]> {
    let divide = |((&error, &[a, b]), &c): ((&f32, &[f32; 2]), &f32)| match a + b + c {
        way if way > 0.0 => [a, b, c].map(|step| error * (step / way)),
        _ => [0.0, 0.0, error],
    };
    errors.iter().zip(first).zip(last).map(divide).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn errors_are_divided_in_proportion() {
        let parts = divided(
            &[6.0, 2.0, 1.0, 0.0],
            &[[1.0, 2.0], [0.0, 0.0], [0.0; 2], [3.0, 0.0]],
            &[3.0, 5.0, 0.0, 3.0],
        );
        assert_eq!(parts, [[1.0, 2.0, 3.0], [0.0, 0.0, 2.0], [0.0, 0.0, 1.0], [0.0; 3]]);
        let shares = ErrorShares::of(&parts);
        assert_eq!(
            [shares.out_of_gamut, shares.too_thin, shares.cross_talk],
            [1.0, 2.0, 6.0].map(|s| s / 9.0)
        );
        assert_eq!(ErrorShares::of(&[[0.0; 3]; 4]), ErrorShares::default());
        assert_eq!(ErrorShares::of(&[]), ErrorShares::default());
    }

    proptest! {
        #[test]
        fn parts_sum_to_the_error_and_shares_to_one(
            voxels in prop::collection::vec((1e-3f32..100.0, 0f32..100.0, 0f32..100.0, 0f32..100.0), 1..50)
        ) {
            let errors: Vec<f32> = voxels.iter().map(|v| v.0).collect();
            let first: Vec<[f32; 2]> = voxels.iter().map(|v| [v.1, v.2]).collect();
            let last: Vec<f32> = voxels.iter().map(|v| v.3).collect();
            let parts = divided(&errors, &first, &last);
            for (part, error) in parts.iter().zip(&errors) {
                prop_assert!((part.iter().sum::<f32>() - error).abs() <= 1e-6 * error);
                prop_assert!(part.iter().all(|&p| p >= 0.0));
            }
            let ErrorShares { out_of_gamut, too_thin, cross_talk } = ErrorShares::of(&parts);
            prop_assert!((out_of_gamut + too_thin + cross_talk - 1.0).abs() < 1e-12);
        }
    }
}
