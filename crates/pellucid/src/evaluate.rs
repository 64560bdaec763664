//! Judging labels by a second prediction with fresh paths.

use pellucid_color::intent::MediaWhite;
use pellucid_color::space::lab_of_linear_rgb;
use pellucid_color::{ErrorStats, delta_e::delta_e_2000_of};
use pellucid_trace::{Boundary, TraceOptions, Tracer, Volume};
use pellucid_voxel::{Control, LabelGrid, MaterialTable, Surface};
use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::PrintError;
use crate::report::{Evaluation, PredictionError, StateErrors};

/// Iteration numbers of the judge's paths, beyond those of any loop.
const JUDGE: u32 = 0x4000_0000;
const PROOF: u32 = 0x4000_0002;

/// Predicts labels on the job's surface.
pub(crate) struct Judge<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) materials: &'a MaterialTable,
    pub(crate) boundary: Boundary,
    pub(crate) white: MediaWhite,
    pub(crate) seed: u64,
}

/// Media-relative radiance of points by either half of the judge's paths.
type Halves = [Vec<[f32; 3]>; 2];

/// What the judge saw of the refined labels.
pub(crate) struct Judged {
    pub(crate) points: Vec<u32>,
    halves: Halves,
}

/// How much is predicted.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) points: u32,
    pub(crate) spp: u32,
}

impl Judge<'_> {
    /// Media-relative radiance of `points`, by surface voxel; others are zero.
    pub(crate) fn appearance(
        &self,
        grid: &LabelGrid,
        points: &[u32],
        spp: u32,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, PrintError> {
        let volume = Volume::new(grid, self.surface, &control.silent())?;
        let values = self.relative(&volume, points, spp, PROOF, control)?;
        let mut all = vec![[0.0; 3]; self.surface.len()];
        points.iter().zip(values).for_each(|(&p, v)| all[p as usize] = v);
        Ok(all)
    }

    fn relative(
        &self,
        volume: &Volume,
        points: &[u32],
        spp: u32,
        iteration: u32,
        control: &Control<'_>,
    ) -> Result<Vec<[f32; 3]>, PrintError> {
        let options =
            TraceOptions { spp, seed: self.seed, boundary: self.boundary, ..TraceOptions::default() };
        let tracer = Tracer::new(volume, self.materials, options)?;
        let mut radiance = vec![0.0; points.len() * 3];
        tracer.radiance(points, iteration, &mut radiance, control)?;
        let white = self.white.rgb().map(|w| w as f32);
        Ok(radiance.chunks_exact(3).map(|l| std::array::from_fn(|c| l[c] / white[c])).collect())
    }

    /// How far predicted `radiance` of [`Judge::draw`]n points is off what the paths say.
    pub(crate) fn prediction_error(&self, judged: &Judged, radiance: &[f32]) -> PredictionError {
        let white = self.white.rgb();
        let (mut sum, mut squares, mut noise) = (0.0, 0.0, 0.0);
        for ((predicted, a), b) in radiance.chunks_exact(3).zip(&judged.halves[0]).zip(&judged.halves[1]) {
            for c in 0..3 {
                let [a, b] = [a[c], b[c]].map(|v| f64::from(v) * white[c]);
                let off = f64::from(predicted[c]) - 0.5 * (a + b);
                sum += off;
                squares += off * off;
                noise += (0.5 * (a - b)).powi(2);
            }
        }
        let n = radiance.len().max(1) as f64;
        PredictionError { rmse: ((squares - noise).max(0.0) / n).sqrt(), bias: sum / n }
    }

    /// Errors of two states of the labels at the same random surface voxels, and what was judged of the second.
    pub(crate) fn evaluate(
        &self,
        unrefined: &LabelGrid,
        refined: &LabelGrid,
        raw: &[[f32; 3]],
        mapped: &[[f32; 3]],
        sample: Sample,
        control: &Control<'_>,
    ) -> Result<(Evaluation, Judged), PrintError> {
        let points = self.draw(sample.points);
        let half = |from: u64| move |done: u64, total: u64| control.report(from * total + done, 4 * total);
        let state = |grid: &LabelGrid, from: u64| -> Result<(StateErrors, Halves), PrintError> {
            let volume = Volume::new(grid, self.surface, &control.silent())?;
            let predict = |part: u32| {
                let progress = half(from + u64::from(part));
                let control = control.silent().with_progress(&progress);
                self.relative(&volume, &points, sample.spp / 2, JUDGE + part, &control)
            };
            let (a, b) = (predict(0)?, predict(1)?);
            let mean: Vec<[f32; 3]> =
                a.iter().zip(&b).map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect();
            let targets = |all: &[[f32; 3]]| points.iter().map(|&p| all[p as usize]).collect::<Vec<_>>();
            let errors = StateErrors {
                raw: stats(&mean, &targets(raw))?,
                mapped: stats(&mean, &targets(mapped))?,
                // The halves differ by twice the error of their mean.
                noise: 0.5 * stats(&a, &b)?.mean,
            };
            Ok((errors, [a, b]))
        };
        let (unrefined, _) = state(unrefined, 0)?;
        let (refined, halves) = state(refined, 2)?;
        let evaluation =
            Evaluation { points: points.len() as u64, spp: sample.spp / 2 * 2, unrefined, refined };
        Ok((evaluation, Judged { points, halves }))
    }

    /// Distinct surface voxels, ascending: all when there are no more than `wanted`.
    pub(crate) fn draw(&self, wanted: u32) -> Vec<u32> {
        let n = self.surface.len() as u64;
        if u64::from(wanted) >= n {
            return (0..n as u32).collect();
        }
        let mut rng = Pcg64::new(u128::from(self.seed), 0x706f_696e_7473);
        let mut points: Vec<u32> = Vec::with_capacity(wanted as usize);
        // Repeats are rare while few of many are drawn, and a second draw replaces them.
        while points.len() < wanted as usize {
            let missing = wanted as usize - points.len();
            points.extend((0..missing).map(|_| ((u128::from(rng.next_u64()) * u128::from(n)) >> 64) as u32));
            points.sort_unstable();
            points.dedup();
        }
        points
    }
}

fn stats(a: &[[f32; 3]], b: &[[f32; 3]]) -> Result<pellucid_refine::ErrorStats, PrintError> {
    let lab = |rgb: &[[f32; 3]]| {
        let mut lab = vec![[0.0; 3]; rgb.len()];
        lab_of_linear_rgb(rgb, &mut lab);
        lab
    };
    let mut differences = vec![0.0; a.len()];
    delta_e_2000_of(&lab(a), &lab(b), &mut differences);
    let s = ErrorStats::of(differences);
    Ok(pellucid_refine::ErrorStats { mean: s.mean, median: s.median, p95: s.p95, max: s.max })
}
