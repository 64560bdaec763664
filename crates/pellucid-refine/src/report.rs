//! What a refinement reports.

use pellucid_core::ErrorStats;

use crate::difference::{lab_of, out_of_gamut};
use serde::{Deserialize, Serialize};

/// One iteration: the state of the labels that was predicted, and its errors in CIEDE2000 over all surface voxels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct IterationReport {
    /// 0 for the unrefined halftone.
    pub iteration: u32,
    /// Against the target as given.
    pub target: ErrorStats,
    /// Against the printable target, which is what the loop aims at.
    pub printable_target: ErrorStats,
    /// As `printable_target`, with what the target lacks smoothed over
    /// [`RefineSettings::residual_blur_mm`](crate::RefineSettings::residual_blur_mm): without most of the halftone's
    /// and the predictor's noise. The best iterate has the least mean, over all viewings.
    pub smoothed: ErrorStats,
    /// The mean of the same in each further viewing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub further: Vec<f64>,
    /// Voxels whose label differs from the labels handed to the step: for iteration 0 the coloured voxels, else those
    /// that changed since the iteration before, unless the step was resumed or repeated with other labels.
    pub label_flips: u64,
    /// Tiles with at least one such voxel.
    pub changed_tiles: u64,
    /// Predicted values around which coefficients lie outside what the predictor was made for.
    pub outside_training: u64,
    /// Paths traced.
    pub paths: u64,
    /// Seconds spent on mixtures and halftone.
    pub halftone_seconds: f64,
    /// Seconds spent in the predictor.
    pub predict_seconds: f64,
    /// Seconds spent on the next state, derivatives included.
    pub update_seconds: f64,
    /// What the strategy lowers, where it says so.
    pub loss: Option<f64>,
    /// How much of it is the predictor's random error, where that was measured.
    pub noise: Option<f64>,
    /// Mean change of what it moved next, where it says so.
    pub step: Option<f64>,
}

impl IterationReport {
    /// Adds a section's: its share of the means, and its work where it did any.
    fn add(&mut self, own: &Self, share: f64, worked: bool) {
        add(&mut self.target, &own.target, share);
        add(&mut self.printable_target, &own.printable_target, share);
        add(&mut self.smoothed, &own.smoothed, share);
        self.further.resize(self.further.len().max(own.further.len()), 0.0);
        self.further.iter_mut().zip(&own.further).for_each(|(sum, own)| *sum += share * own);
        add_some(&mut self.loss, own.loss, share);
        add_some(&mut self.noise, own.noise, share);
        self.outside_training += own.outside_training;
        if worked {
            add_some(&mut self.step, own.step, share);
            self.label_flips += own.label_flips;
            self.changed_tiles += own.changed_tiles;
            self.paths += own.paths;
            self.halftone_seconds += own.halftone_seconds;
            self.predict_seconds += own.predict_seconds;
            self.update_seconds += own.update_seconds;
        }
    }

    /// Sum of the smoothed means over all viewings: the best iterate has the least.
    pub(crate) fn off(&self) -> f64 {
        self.smoothed.mean + self.further.iter().sum::<f64>()
    }
}

/// Adds a share of some errors.
fn add(sum: &mut ErrorStats, own: &ErrorStats, share: f64) {
    sum.count += own.count;
    sum.mean += share * own.mean;
    sum.median += share * own.median;
    sum.p95 += share * own.p95;
    sum.max = sum.max.max(own.max);
}

/// Adds a share of a figure that may not be there.
fn add_some(sum: &mut Option<f64>, own: Option<f64>, share: f64) {
    if let Some(own) = own {
        *sum.get_or_insert(0.0) += share * own;
    }
}

/// The whole refinement.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
#[non_exhaustive]
pub struct RefineReport {
    /// [`Strategy::name`](crate::Strategy::name).
    pub strategy: String,
    /// Every iteration in order; the first is the unrefined halftone.
    pub iterations: Vec<IterationReport>,
    /// The iteration whose labels are kept: least mean of [`IterationReport::smoothed`] over
    /// all viewings.
    pub best: u32,
    /// The strategy ended the refinement before its iterations were done: nothing was to be gained.
    pub settled: bool,
    /// Surface voxels in all.
    pub surface_voxels: u64,
    /// Share of surface voxels whose target had to be mapped by more than one CIEDE2000 unit.
    pub out_of_gamut: f64,
    /// Of a print that was refined in sections, each of them, with what is around it. Its iterations are then sums over
    /// the sections, and means by their surface voxels, of quantiles too; a section that settled counts on with its last
    /// iteration. `best` is then the iteration with the least such mean, though each section keeps its own best.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub sections: Vec<RefineReport>,
}

impl RefineReport {
    /// Of a print whose surface voxels should show `target` and can show `printable_target`, from those of its sections,
    /// which overlap.
    pub fn of_sections(
        sections: Vec<RefineReport>,
        target: &[[f32; 3]],
        printable_target: &[[f32; 3]],
    ) -> Self {
        let weights: Vec<f64> = sections.iter().map(|s| s.surface_voxels as f64).collect();
        let all = weights.iter().sum::<f64>().max(1.0);
        let most = sections.iter().map(|s| s.iterations.len()).max().unwrap_or(0);
        let iteration = |i: usize| {
            let mut sum = IterationReport { iteration: i as u32, ..IterationReport::default() };
            for (section, weight) in sections.iter().zip(&weights) {
                match (section.iterations.get(i), section.iterations.last()) {
                    (Some(own), _) => sum.add(own, weight / all, true),
                    (None, Some(last)) => sum.add(last, weight / all, false),
                    (None, None) => {}
                }
            }
            sum
        };
        let iterations: Vec<IterationReport> = (0..most).map(iteration).collect();
        let best = iterations.iter().min_by(|a, b| a.off().total_cmp(&b.off())).map_or(0, |i| i.iteration);
        Self {
            strategy: sections.first().map(|s| s.strategy.clone()).unwrap_or_default(),
            iterations,
            best,
            settled: !sections.is_empty() && sections.iter().all(|s| s.settled),
            surface_voxels: target.len() as u64,
            out_of_gamut: out_of_gamut(&lab_of(target), &lab_of(printable_target)),
            sections,
        }
    }

    /// The report of the iteration that is kept; `None` before any iteration finished.
    pub fn best_iteration(&self) -> Option<&IterationReport> {
        self.iterations.iter().find(|i| i.iteration == self.best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn iteration(iteration: u32, mean: f64, paths: u64, step: Option<f64>) -> IterationReport {
        let errors = ErrorStats { count: 10, mean, median: mean, p95: 2.0 * mean, max: 3.0 * mean };
        let further = vec![mean + 1.0];
        IterationReport { iteration, smoothed: errors, further, paths, step, ..IterationReport::default() }
    }

    fn section(surface_voxels: u64, iterations: Vec<IterationReport>) -> RefineReport {
        let settled = iterations.len() == 2;
        RefineReport {
            strategy: "descent".to_owned(),
            iterations,
            settled,
            surface_voxels,
            ..RefineReport::default()
        }
    }

    #[test]
    fn sections_count_by_their_surface_and_settled_ones_by_their_last() {
        let long = [(8.0, 0.1), (4.0, 0.2), (2.0, 0.3)];
        let long =
            long.iter().zip(0..).map(|(&(mean, step), i)| iteration(i, mean, 100, Some(step))).collect();
        let short = vec![iteration(0, 4.0, 10, Some(0.4)), iteration(1, 12.0, 10, None)];
        let sections = vec![section(300, long), section(100, short)];
        let white = [[1.0; 3]; 4];
        let printable = [[1.0; 3], [1.0; 3], [1.0; 3], [0.5, 0.5, 0.5]];
        let report = RefineReport::of_sections(sections.clone(), &white, &printable);
        let means: Vec<f64> = report.iterations.iter().map(|i| i.smoothed.mean).collect();
        assert_eq!(means, [7.0, 6.0, 4.5]);
        let first = &report.iterations[0];
        assert_eq!((first.smoothed.p95, first.smoothed.max, first.smoothed.count), (14.0, 24.0, 20));
        assert_eq!(first.further, [8.0]);
        assert_eq!(report.iterations.iter().map(|i| i.paths).collect::<Vec<_>>(), [110, 110, 100]);
        assert!((first.step.unwrap() - 0.175).abs() < 1e-12);
        assert_eq!((report.best, report.settled), (2, false));
        // Of the print itself: what sections have in common counts once.
        assert_eq!((report.surface_voxels, report.out_of_gamut), (4, 0.25));
        assert_eq!(report.sections, sections);
    }
}
