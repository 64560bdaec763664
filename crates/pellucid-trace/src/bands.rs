//! Which channels walk by themselves, which share paths, and which repeat another.

use std::sync::atomic::AtomicU64;

use pellucid_voxel::{Channels, Control, MaterialTable};
use rayon::prelude::*;

use crate::coefficients::{Coefficients, SharedBands};
use crate::kernel::{self, Batch, Block, MOST_BANDS, Scene};
use crate::tracer::{Progress, points_per_task};
use crate::volume::Start;
use crate::{TraceError, Tracer, Tracking, rng};

/// Most paths of a point and band that are shared: with more, each band's own are as good.
const MOST_SHARED: u32 = 256;

/// Bands that share paths: consecutive ones among the channels that are walked.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// The channels.
    pub(crate) channels: Vec<usize>,
    /// What the paths of each need, where there is more than one.
    walkers: Vec<(Coefficients, SharedBands)>,
}

/// Channels whose coefficients are another's, by the first such; itself where there is none.
pub(crate) fn originals(materials: &MaterialTable, palette: &[u8]) -> Vec<usize> {
    let row = |c: usize| -> Vec<u32> {
        let used = palette.iter().filter_map(|&label| materials.get(label));
        used.flat_map(|m| [m.sigma_s[c], m.sigma_a[c], m.g.at(c)].map(f32::to_bits)).collect()
    };
    let rows: Vec<_> = (0..materials.channels()).map(row).collect();
    (0..rows.len()).map(|c| (0..c).find(|&o| rows[o] == rows[c]).unwrap_or(c)).collect()
}

/// Groups of the channels that are no copies, for so many paths a point.
pub(crate) fn groups(
    materials: &MaterialTable,
    palette: &[u8],
    originals: &[usize],
    tracking: Tracking,
    spp: u32,
    most: u32,
) -> Vec<Group> {
    let walked: Vec<usize> = (0..originals.len()).filter(|&c| originals[c] == c).collect();
    // Two blocks at least: each one's control variate comes from the others.
    let most = match materials.spectrum() {
        Channels::Bands { .. } if tracking != Tracking::Regular && spp <= MOST_SHARED => {
            (most.min(spp / 2) as usize).clamp(1, MOST_BANDS)
        }
        _ => 1,
    };
    let parts = walked.len().div_ceil(most).max(1);
    let part = |i: usize| &walked[walked.len() * i / parts..walked.len() * (i + 1) / parts];
    let mut found = Vec::new();
    for channels in (0..parts).map(part) {
        match Group::shared(materials, palette, channels, tracking) {
            Some(group) => found.push(group),
            None => found.extend(channels.iter().map(|&c| Group { channels: vec![c], walkers: Vec::new() })),
        }
    }
    found
}

impl Group {
    /// `None` where paths are not alike enough to be shared.
    fn shared(
        materials: &MaterialTable,
        palette: &[u8],
        channels: &[usize],
        tracking: Tracking,
    ) -> Option<Self> {
        let used = || palette.iter().filter_map(|&label| materials.get(label));
        let one_g = used().all(|m| channels.iter().all(|&c| m.g.at(c) == m.g.at(channels[0])));
        if channels.len() < 2 || !one_g {
            return None;
        }
        let walkers = Coefficients::shared(materials, palette, channels, tracking)?;
        Some(Self { channels: channels.to_vec(), walkers })
    }

    /// True where several bands share each path.
    pub(crate) fn is_shared(&self) -> bool {
        !self.walkers.is_empty()
    }
}

impl Tracer<'_> {
    /// Radiance of a group's bands by shared paths, into `[point][channel]`.
    ///
    /// A block is one path of each band. Every path counts for every band, by the balance heuristic. What that adds of
    /// noise to bright bands, whose throughputs hardly differ, is taken out by a control variate: the weights, whose
    /// mean is known, times what the other blocks say of the throughput, so that the result stays unbiased but for
    /// being brought within 0 to 1.
    pub(crate) fn radiance_shared(
        &self,
        group: &Group,
        points: &[u32],
        iteration: u32,
        radiance: &mut [f32],
        progress: &Progress<'_, '_>,
    ) -> Result<(), TraceError> {
        let bands = group.channels.len();
        let blocks = (self.options.spp as usize).div_ceil(bands);
        let per_task = points_per_task(blocks * bands);
        let channels = self.channels();
        let tasks = points.par_chunks(per_task).zip(radiance.par_chunks_mut(per_task * channels));
        tasks.try_for_each(|(points, radiance)| {
            let starts: Vec<Start> = points.iter().map(|&p| self.volume.start(p)).collect();
            let mut sums = vec![Block::default(); points.len() * blocks];
            for (&channel, (coefficients, shared)) in group.channels.iter().zip(&group.walkers) {
                progress.control.check()?;
                let key = |&p: &u32| rng::point_key(self.options.seed, iteration, channel as u32, p);
                let keys: Vec<u64> = points.iter().map(key).collect();
                let batch = Batch { starts: &starts, keys: &keys, samples: 0..blocks as u32 };
                let scene = Scene { coefficients, ..self.scene(channel) };
                kernel::trace_shared(self.form, &scene, shared, &batch, &mut sums);
                let paths = (points.len() * blocks) as u64;
                progress.control.advance(&progress.done, paths, progress.total);
            }
            for (blocks, radiance) in sums.chunks_exact(blocks).zip(radiance.chunks_exact_mut(channels)) {
                for (j, &channel) in group.channels.iter().enumerate() {
                    radiance[channel] = estimate(blocks, j, bands);
                }
            }
            Ok(())
        })
    }
}

/// Radiance of a band from blocks of paths.
fn estimate(blocks: &[Block], band: usize, bands: usize) -> f32 {
    let of = |b: &Block| (f64::from(b.throughput[band]), f64::from(b.weight[band]));
    let (mut throughput, mut weight) = (0.0, 0.0);
    for (t, w) in blocks.iter().map(of) {
        throughput += t;
        weight += w;
    }
    let mut sum = throughput;
    for (t, w) in blocks.iter().map(of) {
        let others = if weight - w > 0.0 { (throughput - t) / (weight - w) } else { 0.0 };
        sum -= others * (w - bands as f64);
    }
    (sum / (blocks.len() * bands) as f64).clamp(0.0, 1.0) as f32
}

/// Progress over all groups.
pub(crate) fn progress<'a, 'c>(
    control: &'a Control<'c>,
    groups: &[Group],
    points: usize,
    spp: u32,
) -> Progress<'a, 'c> {
    let paths = |g: &Group| {
        let bands = g.channels.len() as u64;
        if g.is_shared() { u64::from(spp).div_ceil(bands) * bands } else { u64::from(spp) }
    };
    let total = groups.iter().map(paths).sum::<u64>() * points as u64;
    Progress { control, done: AtomicU64::new(0), total }
}
