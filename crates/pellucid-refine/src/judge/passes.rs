//! The judge's predictions.

use pellucid_core::Control;
use pellucid_predict::{BoundPredictor, Draw, Pass};
use rayon::prelude::*;

use super::Judge;
use crate::RefineError;

/// Relative RGB of every surface voxel by halves of the passes, or by one pass without random error.
pub(super) type Halves = Vec<Vec<[f32; 3]>>;

/// Counts passes for progress.
pub(super) struct Meter<'c> {
    pub(super) control: Control<'c>,
    pub(super) done: u64,
    pub(super) total: u64,
}

impl Judge<'_> {
    fn draw(&self, pass: u32, effort: u32) -> Draw {
        Draw::new(self.seed, Pass::Judge(pass)).with_effort(effort)
    }

    /// One pass; counts its paths.
    fn pass(
        &self,
        points: &[u32],
        draw: Draw,
        out: &mut [f32],
        bound: &dyn BoundPredictor,
        meter: &mut Meter<'_>,
    ) -> Result<u64, RefineError> {
        let Meter { control, done, total } = *meter;
        let share = points.len() as f64;
        let progress = |part: u64, of: u64| {
            control.report(done + (share * part as f64 / of.max(1) as f64) as u64, total);
        };
        let inner = control.silent().with_progress(&progress);
        let diagnostics = bound.predict(points, draw, out, &inner).map_err(RefineError::judge)?;
        if out.par_iter().any(|v| !v.is_finite()) {
            return Err(RefineError::invalid("prediction", "a radiance is not finite"));
        }
        meter.done += points.len() as u64;
        Ok(diagnostics.paths)
    }

    pub(super) fn surface_halves(
        &self,
        all: &[u32],
        passes: u32,
        effort: u32,
        bound: &dyn BoundPredictor,
        meter: &mut Meter<'_>,
        paths: &mut u64,
    ) -> Result<Halves, RefineError> {
        let viewing = self.input.viewing;
        let halves = passes.min(2);
        let scale = f64::from(halves) / f64::from(passes);
        let mut sums = vec![vec![[0.0f64; 3]; all.len()]; halves as usize];
        let mut radiance = vec![0.0; all.len() * viewing.channels()];
        for pass in 0..passes {
            *paths += self.pass(all, self.draw(pass, effort), &mut radiance, bound, meter)?;
            let values = radiance.par_chunks_exact(viewing.channels());
            sums[(pass % halves) as usize].par_iter_mut().zip(values).for_each(|(sum, l)| {
                let rgb = viewing.relative_rgb(l);
                (0..3).for_each(|c| sum[c] += f64::from(rgb[c]));
            });
        }
        Ok(sums
            .into_iter()
            .map(|half| half.into_iter().map(|sum| sum.map(|v| (v * scale) as f32)).collect())
            .collect())
    }

    pub(super) fn point_halves(
        &self,
        passes: std::ops::Range<u32>,
        effort: u32,
        bound: &dyn BoundPredictor,
        meter: &mut Meter<'_>,
        paths: &mut u64,
    ) -> Result<[Vec<f32>; 2], RefineError> {
        let values = self.points.len() * self.input.viewing.channels();
        let count = passes.len();
        let mut sums = [vec![0.0f64; values], vec![0.0f64; values]];
        let mut radiance = vec![0.0; values];
        for (i, pass) in passes.enumerate() {
            *paths += self.pass(&self.points, self.draw(pass, effort), &mut radiance, bound, meter)?;
            sums[i % 2].iter_mut().zip(&radiance).for_each(|(sum, &v)| *sum += f64::from(v));
        }
        if count == 1 {
            return Ok([radiance.clone(), radiance]);
        }
        let scale = 2.0 / count as f64;
        Ok(sums.map(|half| half.into_iter().map(|sum| (sum * scale) as f32).collect()))
    }
}
