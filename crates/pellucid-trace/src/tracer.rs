//! Radiance at surface points, in parallel.

use std::ops::Range;
use std::sync::atomic::AtomicU64;

use pellucid_core::InstructionSet;
use pellucid_voxel::{Control, MaterialTable};
use rayon::prelude::*;

use crate::bands::{self, Group};
use crate::coefficients::{Coefficients, Optics16};
use crate::kernel::{self, Batch, Form, Scene};
use crate::tally::Tally;
use crate::volume::{Start, Volume};
use crate::{TraceError, TraceOptions, rng};

/// Paths traced by one task between looks at the cancellation flag.
const PATHS_PER_TASK: usize = 1 << 14;

/// Estimates the radiance L(x, n) of surface points by unbiased path tracing.
///
/// A path starts at the surface going inward along -n, scatters by delta tracking and
/// Henyey-Greenstein, and contributes its throughput on leaving (Sumin et al. 2019). The same
/// options give the same bytes for any number of threads and on any processor, whichever other
/// points are asked for.
///
/// ```
/// use pellucid_trace::{TraceOptions, Tracer, Volume};
/// use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions, Tile};
/// let frame = Frame::new([0.0; 3], Pitch::j750(), [48, 24, 74]).unwrap(); // 2 mm
/// let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5)); // white
/// let control = Control::none();
/// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
/// let volume = Volume::new(&grid, &surface, &control).unwrap();
/// let materials = MaterialTable::cmykw();
/// let tracer = Tracer::new(&volume, &materials, TraceOptions { spp: 64, ..Default::default() }).unwrap();
/// let top = surface.index_of([24, 12, 73]).unwrap();
/// let mut radiance = [0.0; 3];
/// tracer.radiance(&[top], 0, &mut radiance, &control).unwrap();
/// assert!(radiance.iter().all(|&l| l > 0.6 && l <= 1.0));
/// ```
pub struct Tracer<'a> {
    pub(crate) volume: &'a Volume,
    channels: Vec<Coefficients>,
    optics: Vec<Optics16>,
    /// By channel, the first with the same coefficients.
    originals: Vec<usize>,
    groups: Vec<Group>,
    pub(crate) materials: MaterialTable,
    pub(crate) options: TraceOptions,
    pub(crate) form: Form,
}

impl<'a> Tracer<'a> {
    /// A tracer for a volume of these materials.
    ///
    /// # Errors
    /// As [`TraceOptions::check`], and [`TraceError::Invalid`] when a label in use has no material.
    pub fn new(
        volume: &'a Volume,
        materials: &MaterialTable,
        options: TraceOptions,
    ) -> Result<Self, TraceError> {
        options.check()?;
        volume.check_materials(materials)?;
        let channels = (0..materials.channels())
            .map(|c| Coefficients::new(materials, volume.palette(), c, options.tracking))
            .collect();
        let optics =
            (0..materials.channels()).map(|c| Optics16::new(materials, volume.palette(), c)).collect();
        let form = Form::of(options.instruction_set.unwrap_or_else(InstructionSet::chosen));
        let palette = volume.palette();
        let originals = bands::originals(materials, palette);
        let most = options.shared_bands;
        let groups = bands::groups(materials, palette, &originals, options.tracking, options.spp, most);
        Ok(Self { volume, channels, optics, originals, groups, materials: materials.clone(), options, form })
    }

    /// Number of channels, the materials'.
    pub fn channels(&self) -> usize {
        self.channels.len()
    }

    pub(crate) fn optics(&self, channel: usize) -> &Optics16 {
        &self.optics[channel]
    }

    /// The instruction set in use: the best one that the kernel has a form for and that is not above the one asked
    /// for.
    pub fn instruction_set(&self) -> InstructionSet {
        self.form.instruction_set()
    }

    /// Radiance of `points`, positions in the surface's list, into `radiance`, ordered
    /// `[point][channel]`, each within 0..=1. `iteration` chooses an independent set of paths.
    ///
    /// Channels with the same coefficients have the same paths, and are walked once. Neighbouring bands share paths
    /// ([`TraceOptions::shared_bands`]).
    ///
    /// # Errors
    /// [`TraceError::Invalid`] for a point past the surface or a buffer of another length,
    /// [`TraceError::Cancelled`]. Progress counts paths.
    pub fn radiance(
        &self,
        points: &[u32],
        iteration: u32,
        radiance: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        let (spp, channels) = (self.options.spp, self.channels());
        self.check_points(points, "radiance buffer", radiance.len())?;
        let progress = bands::progress(control, &self.groups, points.len(), spp);
        for group in &self.groups {
            if group.is_shared() {
                self.radiance_shared(group, points, iteration, radiance, &progress)?;
                continue;
            }
            let c = group.channels[0];
            let per_task = points_per_task(spp as usize);
            let tasks = points.par_chunks(per_task).zip(radiance.par_chunks_mut(per_task * channels));
            tasks.try_for_each(|(points, radiance)| {
                let starts: Vec<Start> = points.iter().map(|&p| self.volume.start(p)).collect();
                let sums = self.trace(points, &starts, c, iteration, 0..spp, &progress)?;
                let rows = radiance.chunks_exact_mut(channels);
                rows.zip(sums).for_each(|(row, sum)| row[c] = sum.mean(spp) as f32);
                Ok::<_, TraceError>(())
            })?;
        }
        if self.originals.iter().enumerate().any(|(c, &o)| c != o) {
            let copy = |row: &mut [f32]| {
                self.originals.iter().enumerate().for_each(|(c, &original)| row[c] = row[original]);
            };
            radiance.par_chunks_exact_mut(channels).for_each(copy);
        }
        Ok(())
    }

    /// By channel, the first with the same coefficients.
    pub(crate) fn originals(&self) -> &[usize] {
        &self.originals
    }

    /// As [`Tracer::radiance`] without shared paths, with the standard error of each estimate in `std_error`.
    ///
    /// # Errors
    /// As [`Tracer::radiance`]; `std_error` must be as long as `radiance`.
    pub fn radiance_with_error(
        &self,
        points: &[u32],
        iteration: u32,
        radiance: &mut [f32],
        std_error: &mut [f32],
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        let spp = self.options.spp;
        let mut tallies = self.tallies_for(points, radiance.len())?;
        self.tallies_for(points, std_error.len())?;
        self.add_samples(points, iteration, 0..spp, &mut tallies, control)?;
        for ((out, error), tally) in radiance.iter_mut().zip(std_error).zip(&tallies) {
            *out = tally.mean(spp) as f32;
            *error = tally.std_error(spp) as f32;
        }
        Ok(())
    }

    /// Empty tallies `[point][channel]`, after checking the points and a buffer's length.
    pub(crate) fn tallies_for(&self, points: &[u32], buffer: usize) -> Result<Vec<Tally>, TraceError> {
        self.check_points(points, "radiance buffer", buffer)?;
        Ok(vec![Tally::default(); buffer])
    }

    /// What the walks of a channel share.
    pub(crate) fn scene(&self, channel: usize) -> Scene<'_> {
        Scene {
            volume: self.volume,
            coefficients: &self.channels[channel],
            index: self.options.boundary.index() as f32,
            roulette: self.options.roulette,
        }
    }

    /// Checks points and a buffer's length.
    pub(crate) fn check_points(
        &self,
        points: &[u32],
        what: &'static str,
        buffer: usize,
    ) -> Result<(), TraceError> {
        if buffer != points.len() * self.channels.len() {
            return Err(TraceError::invalid(
                what,
                format!("{buffer} values for {} points of {} channels", points.len(), self.channels.len()),
            ));
        }
        match points.iter().find(|&&p| p as usize >= self.volume.len()) {
            Some(p) => {
                Err(TraceError::invalid("points", format!("point {p} of a surface of {}", self.volume.len())))
            }
            None => Ok(()),
        }
    }

    /// Traces the same samples of every point and channel into `tallies`, `[point][channel]`.
    pub(crate) fn add_samples(
        &self,
        points: &[u32],
        iteration: u32,
        samples: Range<u32>,
        tallies: &mut [Tally],
        control: &Control<'_>,
    ) -> Result<(), TraceError> {
        let walked = (0..self.channels()).filter(|&c| self.originals[c] == c).count() as u64;
        let total = walked * points.len() as u64 * samples.len() as u64;
        let progress = Progress { control, done: AtomicU64::new(0), total };
        let channels = self.channels.len();
        let per_task = points_per_task(samples.len());
        points.par_chunks(per_task).zip(tallies.par_chunks_mut(per_task * channels)).try_for_each(
            |(points, tallies)| {
                let starts: Vec<Start> = points.iter().map(|&p| self.volume.start(p)).collect();
                for c in (0..channels).filter(|&c| self.originals[c] == c) {
                    let sums = self.trace(points, &starts, c, iteration, samples.clone(), &progress)?;
                    for copy in (c..channels).filter(|&copy| self.originals[copy] == c) {
                        sums.iter().enumerate().for_each(|(p, &sum)| tallies[p * channels + copy] += sum);
                    }
                }
                Ok(())
            },
        )
    }

    /// Traces samples of a few points in one channel.
    pub(crate) fn trace(
        &self,
        points: &[u32],
        starts: &[Start],
        channel: usize,
        iteration: u32,
        samples: Range<u32>,
        progress: &Progress<'_, '_>,
    ) -> Result<Vec<Tally>, TraceError> {
        let keys: Vec<u64> =
            points.iter().map(|&p| rng::point_key(self.options.seed, iteration, channel as u32, p)).collect();
        // Few points with many samples are split by sample.
        let parts: Vec<_> = split(samples, PATHS_PER_TASK / points.len().max(1)).collect();
        parts
            .into_par_iter()
            .map(|samples| {
                progress.control.check()?;
                let paths = (samples.len() * starts.len()) as u64;
                let mut part = vec![Tally::default(); starts.len()];
                let batch = Batch { starts, keys: &keys, samples };
                kernel::trace(self.form, &self.scene(channel), &batch, &mut part);
                progress.control.advance(&progress.done, paths, progress.total);
                Ok(part)
            })
            .try_reduce(
                || vec![Tally::default(); starts.len()],
                |mut a, b| {
                    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
                    Ok(a)
                },
            )
    }
}

/// Progress in paths, shared by tasks.
pub(crate) struct Progress<'a, 'c> {
    pub(crate) control: &'a Control<'c>,
    pub(crate) done: AtomicU64,
    pub(crate) total: u64,
}

/// How many points of `spp` paths make a task.
pub(crate) fn points_per_task(spp: usize) -> usize {
    (PATHS_PER_TASK / spp.max(1)).clamp(1, 4096)
}

/// Consecutive ranges of at most `most` (at least 1) samples, of nearly equal length.
fn split(samples: Range<u32>, most: usize) -> impl Iterator<Item = Range<u32>> {
    let n = samples.len();
    let parts = n.div_ceil(most.max(1)).max(1);
    (0..parts)
        .map(move |i| samples.start + (n * i / parts) as u32..samples.start + (n * (i + 1) / parts) as u32)
}
