//! Which points get how many paths.

use std::ops::Range;

use crate::kernel::{Path, Scores};
use crate::{TraceError, rng};

/// Paths walked together: they share a baseline, and cancellation is looked at between them.
const TOGETHER: u64 = 1 << 12;

/// The paths of one channel, in the order of the points.
pub(crate) struct Plan {
    /// How many paths the points before the i-th have, and all of them.
    before: Vec<u64>,
}

impl Plan {
    /// Paths by the size of weights, `share` a unit of it: floor(|r| share + u).
    pub(crate) fn new(
        weights: impl Iterator<Item = f32>,
        keys: impl Iterator<Item = u64>,
        share: f64,
    ) -> Result<Self, TraceError> {
        let mut before = vec![0];
        let mut sum = 0;
        for (r, key) in weights.zip(keys) {
            let count = (f64::from(r).abs() * share + rng::point_unit(key)).floor();
            if count >= f64::from(u32::MAX) {
                return Err(TraceError::invalid(
                    "paths of the derivative",
                    format!("{count} for one point; ask for fewer"),
                ));
            }
            sum += count as u64;
            before.push(sum);
        }
        Ok(Self { before })
    }

    pub(crate) fn paths(&self) -> u64 {
        self.before.last().copied().unwrap_or(0)
    }

    pub(crate) fn groups(&self) -> Range<u64> {
        0..self.paths().div_ceil(TOGETHER)
    }

    /// Positions of the points of a group's paths, and the paths, whose starts count from the first of those.
    pub(crate) fn group(&self, group: u64) -> (Range<usize>, Vec<Path>) {
        let mine = group * TOGETHER..((group + 1) * TOGETHER).min(self.paths());
        let first = self.before.partition_point(|&b| b <= mine.start) - 1;
        let mut paths = Vec::with_capacity((mine.end - mine.start) as usize);
        let mut point = first;
        for path in mine {
            while self.before[point + 1] <= path {
                point += 1;
            }
            let sample = (path - self.before[point]) as u32;
            paths.push(Path { start: (point - first) as u32, sample, scores: Scores::default() });
        }
        (first..point + 1, paths)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// Groups hold every sample of every point once, in order.
        #[test]
        fn groups_are_all_paths_in_order(
            weights in prop::collection::vec(-3.0f32..3.0, 1..40),
            share in 0.0f64..900.0,
        ) {
            let keys = || (0..weights.len() as u64).map(rng::mix);
            let plan = Plan::new(weights.iter().copied(), keys(), share).unwrap();
            let expected: Vec<(usize, u32)> = weights
                .iter()
                .zip(keys())
                .enumerate()
                .flat_map(|(i, (r, key))| {
                    let count = (f64::from(r.abs()) * share + rng::point_unit(key)) as u32;
                    (0..count).map(move |sample| (i, sample))
                })
                .collect();
            let got: Vec<(usize, u32)> = plan
                .groups()
                .flat_map(|g| {
                    let (range, paths) = plan.group(g);
                    assert!(paths.len() as u64 <= TOGETHER && !paths.is_empty());
                    assert!(paths.iter().all(|p| range.contains(&(range.start + p.start as usize))));
                    paths.into_iter().map(move |p| (range.start + p.start as usize, p.sample))
                })
                .collect();
            prop_assert_eq!(plan.paths(), expected.len() as u64);
            prop_assert_eq!(got, expected);
        }
    }

    #[test]
    fn more_paths_than_can_be_numbered_are_refused() {
        assert!(Plan::new([1.0f32].into_iter(), [0u64].into_iter(), 4e9).is_ok());
        assert!(Plan::new([1.0f32].into_iter(), [0u64].into_iter(), 5e9).is_err());
    }
}
