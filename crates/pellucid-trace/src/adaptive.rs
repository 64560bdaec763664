//! Radiance to a target standard error: paths go where the variance is.
//!
//! A pilot of 32 paths a point and channel estimates the variance of one path and plans how many
//! the target asks for; the estimate comes from those alone. Pooling both would save the pilot but
//! bias the mean by an eighth of the target (measured), since dark pilots plan fewer paths.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::Control;
use rayon::prelude::*;

use crate::tracer::{Progress, points_per_task};
use crate::volume::Start;
use crate::{TraceError, Tracer};

/// Paths of the first round.
const PILOT: u32 = 32;

/// When an adaptive estimate is good enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorTarget {
    /// Standard error to reach for every point and channel, above 0.
    pub std_error: f32,
    /// Most paths per point and channel after a pilot of 32, at least 32.
    pub max_spp: u32,
}

impl Tracer<'_> {
    /// As [`Tracer::radiance_with_error`], with as many paths per point and channel as the target
    /// asks for instead of the options' number. Returns the paths traced in all.
    ///
    /// ```
    /// # use pellucid_trace::{ErrorTarget, TraceOptions, Tracer, Volume};
    /// # use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};
    /// # let frame = Frame::new([0.0; 3], Pitch::j750(), [24, 12, 37]).unwrap();
    /// # let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(1));
    /// # let control = Control::none();
    /// # let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
    /// # let volume = Volume::new(&grid, &surface, &control).unwrap();
    /// # let materials = MaterialTable::cmykw();
    /// let tracer = Tracer::new(&volume, &materials, TraceOptions::default()).unwrap();
    /// let (mut radiance, mut error) = ([0.0; 3], [0.0; 3]);
    /// let target = ErrorTarget { std_error: 0.005, max_spp: 1 << 16 };
    /// tracer.radiance_to(&[7], 0, target, &mut radiance, &mut error, &control).unwrap();
    /// assert!(error.iter().all(|&e| e < 0.006));
    /// ```
    ///
    /// # Errors
    /// As [`Tracer::radiance_with_error`], and [`TraceError::Invalid`] for a target out of range.
    pub fn radiance_to(
        &self,
        points: &[u32],
        iteration: u32,
        target: ErrorTarget,
        radiance: &mut [f32],
        std_error: &mut [f32],
        control: &Control<'_>,
    ) -> Result<u64, TraceError> {
        let limits = PILOT..=u32::MAX - PILOT;
        if !(target.std_error > 0.0 && target.std_error.is_finite() && limits.contains(&target.max_spp)) {
            return Err(TraceError::invalid(
                "error target",
                format!("{target:?}; the error must be positive and the limit at least {PILOT} paths"),
            ));
        }
        let channels = self.channels();
        let mut tallies = self.tallies_for(points, radiance.len())?;
        self.tallies_for(points, std_error.len())?;
        self.add_samples(points, iteration, 0..PILOT, &mut tallies, control)?;
        let paths: Vec<u32> = tallies
            .iter()
            .map(|tally| {
                let wanted = tally.cautious_variance(PILOT) / f64::from(target.std_error).powi(2);
                // Steps of at most a quarter, so that points fall into few groups.
                let steps = (wanted / f64::from(PILOT)).max(1.0).log(1.25).ceil();
                (f64::from(PILOT) * 1.25f64.powf(steps)).min(f64::from(target.max_spp)) as u32
            })
            .collect();
        let pilots = u64::from(PILOT) * paths.len() as u64;
        let total = pilots + paths.iter().map(|&n| u64::from(n)).sum::<u64>();
        let progress = Progress { control, done: AtomicU64::new(pilots), total };
        for c in 0..channels {
            let mut order: Vec<u32> = (0..points.len() as u32).collect();
            order.sort_by_key(|&i| paths[i as usize * channels + c]);
            for group in
                order.chunk_by(|&a, &b| paths[a as usize * channels + c] == paths[b as usize * channels + c])
            {
                let n = paths[group[0] as usize * channels + c];
                let sums: Vec<_> = group
                    .par_chunks(points_per_task(n as usize))
                    .map(|part| {
                        let points: Vec<u32> = part.iter().map(|&i| points[i as usize]).collect();
                        let starts: Vec<Start> = points.iter().map(|&p| self.volume.start(p)).collect();
                        self.trace(&points, &starts, c, iteration, PILOT..PILOT + n, &progress)
                    })
                    .collect::<Result<_, _>>()?;
                for (&i, sum) in group.iter().zip(sums.into_iter().flatten()) {
                    tallies[i as usize * channels + c] = sum;
                }
            }
        }
        for (i, tally) in tallies.iter().enumerate() {
            radiance[i] = tally.mean(paths[i]) as f32;
            std_error[i] = tally.std_error(paths[i]) as f32;
        }
        Ok(total)
    }
}
