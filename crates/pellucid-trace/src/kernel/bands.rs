//! Neighbouring bands that share a path: what each one's throughput along it is, and how likely each would have walked it.

use super::bits;
use super::lanes::Lanes;
use super::work::{Cursor, Job, Work};
use super::{Batch, Constants, Trail, Vector};
use crate::coefficients::SharedBands;

/// Most bands that share a path.
pub(crate) const MOST_BANDS: usize = 4;
/// Nothing that matters is below: it keeps products out of the subnormal numbers, which are slow.
const LEAST: f32 = 1e-30;

/// What paths carry beside their weight.
pub(super) trait Companions<L: Lanes> {
    /// Lanes that begin a path.
    fn begin(&mut self, l: L, fresh: L::M);
    /// Lanes that arrived at a tentative collision in voxels of the given bytes, and of these the ones that scatter.
    fn collide(&mut self, l: L, byte: L::I, arrived: L::M, scatters: L::M);
}

/// One band: the weight is all.
impl<L: Lanes> Companions<L> for () {
    #[inline(always)]
    fn begin(&mut self, _: L, _: L::M) {}
    #[inline(always)]
    fn collide(&mut self, _: L, _: L::I, _: L::M, _: L::M) {}
}

/// Several bands along the paths of one of them.
#[derive(Clone, Copy)]
pub(super) struct Along<L: Lanes> {
    /// Share of the path's weight that a band keeps at a collision, by palette position.
    keep: [L::F; MOST_BANDS],
    /// Probability of a scattering over the walking band's, and of none.
    scatter: [L::F; MOST_BANDS],
    null: [L::F; MOST_BANDS],
    /// 1 for bands, 0 where there are fewer.
    first: [L::F; MOST_BANDS],
    /// Product of what was kept.
    kept: [L::F; MOST_BANDS],
    /// Probability of the path over the walking band's.
    odds: [L::F; MOST_BANDS],
}

impl<L: Lanes> Companions<L> for Along<L> {
    #[inline(always)]
    fn begin(&mut self, l: L, fresh: L::M) {
        for j in 0..MOST_BANDS {
            self.kept[j] = l.select(fresh, l.splat(1.0), self.kept[j]);
            self.odds[j] = l.select(fresh, self.first[j], self.odds[j]);
        }
    }

    #[inline(always)]
    fn collide(&mut self, l: L, byte: L::I, arrived: L::M, scatters: L::M) {
        let least = l.splat(LEAST);
        for j in 0..MOST_BANDS {
            let kept = l.max(l.mul(self.kept[j], l.lookup(self.keep[j], byte)), least);
            let odds = l.select(scatters, l.lookup(self.scatter[j], byte), l.lookup(self.null[j], byte));
            let odds = l.max(l.mul(self.odds[j], odds), least);
            self.kept[j] = l.select(arrived, kept, self.kept[j]);
            self.odds[j] = l.select(arrived, odds, self.odds[j]);
        }
    }
}

/// What a block of paths, one of each band, came to in every band.
#[derive(Clone, Copy, Default)]
pub(crate) struct Block {
    /// Sum of throughputs, weighed.
    pub(crate) throughput: [f32; MOST_BANDS],
    /// Sum of weights, whose expectation is the number of bands.
    pub(crate) weight: [f32; MOST_BANDS],
}

/// A batch walked by one of several bands, whose ends are added up by start and sample.
pub(super) struct Shared<'a> {
    batch: &'a Batch<'a>,
    bands: &'a SharedBands,
    cursor: Cursor,
    blocks: &'a mut [Block],
}

impl<'a> Shared<'a> {
    /// `blocks` is `[start][sample]`.
    pub(super) fn new(batch: &'a Batch<'a>, bands: &'a SharedBands, blocks: &'a mut [Block]) -> Self {
        assert!(blocks.len() == batch.starts.len() * batch.samples.len());
        Self { batch, bands, cursor: Cursor::new(batch), blocks }
    }

    /// Adds the ends of some lanes' paths, by the balance heuristic over the bands (Veach and Guibas 1995; Wilkie et al.
    /// 2014).
    #[inline(always)]
    fn end<L: Lanes>(&mut self, l: L, along: &Along<L>, owner: &[u32; 16], lanes: u16, weights: &[f32; 16]) {
        let mut kept = [[0.0; 16]; MOST_BANDS];
        let mut odds = [[0.0; 16]; MOST_BANDS];
        for j in 0..MOST_BANDS {
            kept[j] = l.store(along.kept[j]);
            odds[j] = l.store(along.odds[j]);
        }
        let count = self.bands.count as f32;
        for lane in bits(lanes) {
            let odds: [f32; MOST_BANDS] = std::array::from_fn(|j| odds[j][lane].min(f32::MAX / 8.0));
            let any = (odds[0] + odds[1]) + (odds[2] + odds[3]);
            let block = &mut self.blocks[owner[lane] as usize];
            for j in 0..MOST_BANDS {
                let weight = count * (odds[j] / any);
                block.weight[j] += weight;
                block.throughput[j] += weight * (weights[lane] * kept[j][lane]);
            }
        }
    }
}

impl Work for Shared<'_> {
    type Extra<L: Lanes> = Along<L>;

    #[inline(always)]
    fn extra<L: Lanes>(&self, l: L) -> Along<L> {
        let b = self.bands;
        let mut along = Along {
            keep: [l.splat(0.0); MOST_BANDS],
            scatter: [l.splat(0.0); MOST_BANDS],
            null: [l.splat(0.0); MOST_BANDS],
            first: [l.splat(0.0); MOST_BANDS],
            kept: [l.splat(1.0); MOST_BANDS],
            odds: [l.splat(1.0); MOST_BANDS],
        };
        for j in 0..MOST_BANDS {
            along.keep[j] = l.load(&b.keep[j]);
            along.scatter[j] = l.load(&b.scatter[j]);
            along.null[j] = l.load(&b.null[j]);
            along.first[j] = l.splat(if j < b.count { 1.0 } else { 0.0 });
        }
        along
    }

    #[inline(always)]
    fn left(&self) -> bool {
        self.cursor.left(self.batch)
    }

    #[inline(always)]
    fn next(&mut self) -> Option<Job<'_>> {
        let samples = &self.batch.samples;
        let owner = |start: usize, sample: u32| start * samples.len() + (sample - samples.start) as usize;
        self.cursor.next(self.batch, |start, sample| owner(start, sample) as u32)
    }

    /// Never called: what leaves has several weights.
    #[inline(always)]
    fn leaves(&mut self, _: u32, _: f32) {}

    #[inline(always)]
    fn leave<L: Lanes>(
        &mut self,
        l: L,
        along: &Along<L>,
        owner: &[u32; 16],
        lanes: u16,
        weights: &[f32; 16],
    ) {
        self.end(l, along, owner, lanes, weights);
    }

    /// What is absorbed counts too: weights must have their expectation.
    #[inline(always)]
    fn absorb<L: Lanes>(&mut self, l: L, along: &Along<L>, owner: &[u32; 16], lanes: u16) {
        self.end(l, along, owner, lanes, &[0.0; 16]);
    }

    #[inline(always)]
    fn record<L: Lanes>(&mut self, _: L, _: &Constants<'_, L>, _: &Vector<L>, _: &Trail<L>) {}
}
