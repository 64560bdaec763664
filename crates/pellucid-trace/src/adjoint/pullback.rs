//! Estimation of the derivative, channel by channel.

use std::ops::Range;
use std::sync::atomic::AtomicU64;

use pellucid_core::Team;
use pellucid_core::team::Alone;
use pellucid_voxel::Control;
use rayon::prelude::*;

use super::paths::Plan;
use super::{AdjointOptions, Cells, Derivatives, Phases};
use crate::kernel::{self, Addressed, Path, Scores};
use crate::volume::Start;
use crate::{TraceError, Tracer, rng};

/// Least mean throughput of paths whose scatterings are counted against a baseline.
const PALE: f64 = 0.6;

impl Tracer<'_> {
    /// Adds the derivative of `sum(d_radiance * radiance)` by the amount (volume fraction, 0 to 1) of each of the
    /// table's materials in each voxel to `out`. `d_radiance` is `[point][channel]`. Unbiased unless pooled; see [`adjoint`]
    /// for the estimator. Returns the number of paths.
    ///
    /// The same bytes for any number of threads and on any processor. Independent of [`Tracer::radiance`] with the same
    /// `iteration`.
    ///
    /// [`adjoint`]: crate::adjoint
    ///
    /// ```
    /// use pellucid_trace::{AdjointOptions, Derivatives, TraceOptions, Tracer, Volume};
    /// # use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};
    /// # let frame = Frame::new([0.0; 3], Pitch::j750(), [48, 24, 74]).unwrap();
    /// # let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
    /// # let control = Control::none();
    /// # let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
    /// # let volume = Volume::new(&grid, &surface, &control).unwrap();
    /// # let materials = MaterialTable::cmykw();
    /// # let top = surface.index_of([24, 12, 73]).unwrap();
    /// /// By the amount of black.
    /// struct Black(f64);
    /// impl Derivatives for Black {
    ///     fn add(&mut self, _voxel: [u32; 3], label: u8, derivative: f32) {
    ///         if label == 4 {
    ///             self.0 += f64::from(derivative);
    ///         }
    ///     }
    /// }
    /// let tracer = Tracer::new(&volume, &materials, TraceOptions::default()).unwrap();
    /// let options = AdjointOptions { paths: 256.0, ..AdjointOptions::default() };
    /// let mut black = Black(0.0);
    /// tracer.pullback(&[top], 0, &[1.0; 3], &options, &mut black, &control).unwrap();
    /// assert!(black.0 < 0.0); // more black anywhere is less light
    /// ```
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for a point past the surface, weights of another length or not finite, or options out of
    /// range; [`TraceError::Unsupported`] when the sums of what `out` wants do not fit in memory;
    /// [`TraceError::Cancelled`], after which `out` holds a part. Progress counts paths.
    pub fn pullback(
        &self,
        points: &[u32],
        iteration: u32,
        d_radiance: &[f32],
        options: &AdjointOptions,
        out: &mut dyn Derivatives,
        control: &Control<'_>,
    ) -> Result<u64, TraceError> {
        self.pullback_in(&Alone, points, iteration, d_radiance, options, out, control)
    }

    /// [`Tracer::pullback`] as a member of a team, all of whom ask for the same: each follows some of the paths, and their
    /// sums, which are integers, are added up. Every member gets the same bytes as one that is alone; the number of paths
    /// is the whole team's, and progress counts the member's own.
    ///
    /// # Errors
    /// As [`Tracer::pullback`]; [`TraceError::Cancelled`] also where another member was.
    pub fn pullback_in(
        &self,
        team: &dyn Team,
        points: &[u32],
        iteration: u32,
        d_radiance: &[f32],
        options: &AdjointOptions,
        out: &mut dyn Derivatives,
        control: &Control<'_>,
    ) -> Result<u64, TraceError> {
        options.check()?;
        self.check_points(points, "d_radiance", d_radiance.len())?;
        if let Some(i) = d_radiance.iter().position(|r| !r.is_finite()) {
            return Err(TraceError::invalid("d_radiance", format!("value {i} is {}", d_radiance[i])));
        }
        control.check()?;
        // Channels that repeat are walked once.
        let folded;
        let d_radiance = match self.originals().iter().enumerate().any(|(c, &o)| c != o) {
            false => d_radiance,
            true => {
                folded = self.folded(d_radiance);
                &folded
            }
        };
        let mean = d_radiance.iter().map(|&r| f64::from(r).abs()).sum::<f64>() / d_radiance.len() as f64;
        if d_radiance.is_empty() || mean == 0.0 {
            return Ok(0);
        }
        let per_path = mean / f64::from(options.paths);
        let plans: Vec<Plan> = (0..self.channels())
            .map(|c| {
                let weights = d_radiance[c..].iter().step_by(self.channels()).copied();
                Plan::new(weights, points.iter().map(|&p| self.adjoint_key(p, c, iteration)), 1.0 / per_path)
            })
            .collect::<Result<_, _>>()?;
        let total: u64 = plans.iter().map(Plan::paths).sum();
        let own = (total / team.size() as u64).max(1);
        let done = AtomicU64::new(0);
        let phases = |c| Phases::new(&self.materials, self.volume.palette(), c);
        let most = (0..self.channels()).map(|c| phases(c).len()).max().unwrap_or(1);
        let mut cells = Cells::new(self.volume, out, most)?;
        if cells.is_empty() {
            return Ok(0);
        }
        // A member that fails says so where the team meets next, so that none waits for it in vain.
        let mut outcome: Result<(), TraceError> = Ok(());
        for (c, plan) in plans.iter().enumerate() {
            let pass = Pass { tracer: self, points, d_radiance, iteration, channel: c, phases: phases(c) };
            let groups: Vec<u64> = plan.groups().skip(team.rank()).step_by(team.size()).collect();
            outcome = outcome.and_then(|()| {
                groups.into_par_iter().try_for_each(|group| {
                    control.check()?;
                    let (range, paths) = plan.group(group);
                    let count = paths.len() as u64;
                    pass.splat(range, paths, &cells);
                    control.advance(&done, count, own);
                    Ok::<_, TraceError>(())
                })
            });
            all_went_on(team, outcome)?;
            cells.sum(team);
            if options.pooled {
                cells.pool(self.volume, &pass.phases);
            }
            outcome = pass.hand_out(per_path, &mut cells, out, control);
        }
        all_went_on(team, outcome)?;
        Ok(total)
    }

    /// The weights of repeated channels added to those of the first one, and 0 in their place.
    fn folded(&self, d_radiance: &[f32]) -> Vec<f32> {
        let mut folded = vec![0.0; d_radiance.len()];
        let rows = folded.chunks_exact_mut(self.channels()).zip(d_radiance.chunks_exact(self.channels()));
        for (folded, row) in rows {
            row.iter().zip(self.originals()).for_each(|(d, &original)| folded[original] += d);
        }
        folded
    }

    /// Random key of a point's paths.
    fn adjoint_key(&self, point: u32, channel: usize, iteration: u32) -> u64 {
        rng::point_key(rng::adjoint_seed(self.options.seed), iteration, channel as u32, point)
    }
}

/// An error for every member when one of them stopped: nothing else ends these steps early.
fn all_went_on(team: &dyn Team, own: Result<(), TraceError>) -> Result<(), TraceError> {
    let mut stopped = [i64::from(own.is_err())];
    team.sum(&mut stopped);
    own?;
    if stopped == [0] { Ok(()) } else { Err(TraceError::Cancelled) }
}

/// The derivative of one channel.
struct Pass<'a> {
    tracer: &'a Tracer<'a>,
    points: &'a [u32],
    d_radiance: &'a [f32],
    iteration: u32,
    channel: usize,
    phases: Phases,
}

impl Pass<'_> {
    /// Walks paths of a range of points and adds their parts.
    fn splat(&self, range: Range<usize>, mut paths: Vec<Path>, cells: &Cells) {
        let (tracer, channel) = (self.tracer, self.channel);
        let scene = tracer.scene(channel);
        let points = &self.points[range.clone()];
        let starts: Vec<Start> = points.iter().map(|&p| tracer.volume.start(p)).collect();
        let keys: Vec<u64> = points.iter().map(|&p| tracer.adjoint_key(p, channel, self.iteration)).collect();
        let (starts, keys) = (&starts[..], &keys[..]);
        let weights = kernel::weigh(tracer.form, &scene, &Addressed { paths: &paths, starts, keys });
        let sum: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        for (path, &weight) in paths.iter_mut().zip(&weights) {
            let others = (sum - f64::from(weight)) / (weights.len() as f64 - 1.0).max(1.0);
            let baseline = if others > PALE { others as f32 } else { 0.0 };
            let point = range.start + path.start as usize;
            let sign = self.d_radiance[point * tracer.channels() + channel].signum();
            path.scores = Scores { throughput: sign * weight, baseline: sign * baseline };
        }
        paths.retain(|path| path.scores.throughput != 0.0 || path.scores.baseline != 0.0);
        kernel::replay(tracer.form, &scene, &Addressed { paths: &paths, starts, keys }, cells, &self.phases);
    }

    /// Turns the sums of a channel into derivatives by material.
    fn hand_out(
        &self,
        per_path: f64,
        cells: &mut Cells,
        out: &mut dyn Derivatives,
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        let (tracer, channel) = (self.tracer, self.channel);
        let materials = &tracer.materials;
        let materials: Vec<(f64, f64, usize)> = (0..materials.len())
            .map(|m| {
                let material = &materials.materials()[m];
                let (s, a) = (f64::from(material.sigma_s[channel]), f64::from(material.sigma_a[channel]));
                (s * per_path, (s + a) * per_path, 1 + self.phases.of(m))
            })
            .collect();
        let row = |sums: &[f64], row: &mut [f32]| {
            for (value, &(scattering, extinction, phase)) in row.iter_mut().zip(&materials) {
                *value = (scattering * sums[phase] - extinction * sums[0]) as f32;
            }
        };
        let region = out.region();
        cells.drain(tracer.volume, region, materials.len(), row, |voxels, rows| {
            control.check()?;
            out.add_rows(voxels, rows);
            Ok(())
        })
    }
}
