//! Which paths a kernel walks, and what becomes of them.

use std::ops::Range;

use super::bands::Companions;
use super::lanes::Lanes;
use super::step::{Constants, Trail};
use super::{Vector, bits};
use crate::tally::Tally;
use crate::volume::Start;

/// A path to walk.
pub(super) struct Job<'a> {
    /// Whom its end is told to.
    pub(super) owner: u32,
    pub(super) start: &'a Start,
    /// Random key of its point, channel and pass.
    pub(super) key: u64,
    pub(super) sample: u32,
}

/// Hands out paths and takes in their ends.
pub(super) trait Work {
    /// What paths carry beside their weight.
    type Extra<L: Lanes>: Companions<L>;
    fn extra<L: Lanes>(&self, l: L) -> Self::Extra<L>;
    /// Tells whether there are paths to walk still.
    fn left(&self) -> bool;
    fn next(&mut self) -> Option<Job<'_>>;
    /// A path left the object with a throughput. One that does not was absorbed.
    fn leaves(&mut self, owner: u32, weight: f32);
    /// Paths of some lanes left.
    #[inline(always)]
    fn leave<L: Lanes>(
        &mut self,
        _: L,
        _: &Self::Extra<L>,
        owner: &[u32; 16],
        lanes: u16,
        weights: &[f32; 16],
    ) {
        for lane in bits(lanes) {
            self.leaves(owner[lane], weights[lane]);
        }
    }
    /// Paths of some lanes were absorbed.
    #[inline(always)]
    fn absorb<L: Lanes>(&mut self, _: L, _: &Self::Extra<L>, _: &[u32; 16], _: u16) {}
    /// Every living lane of a vector did a step.
    fn record<L: Lanes>(&mut self, l: L, constants: &Constants<'_, L>, v: &Vector<L>, trail: &Trail<L>);
}

/// A set of paths: every sample of every point.
pub(crate) struct Batch<'a> {
    pub(crate) starts: &'a [Start],
    /// Random key of each start.
    pub(crate) keys: &'a [u64],
    pub(crate) samples: Range<u32>,
}

/// Where the walk of a batch is.
pub(super) struct Cursor {
    start: usize,
    sample: u32,
}

impl Cursor {
    pub(super) fn new(batch: &Batch<'_>) -> Self {
        Self { start: 0, sample: batch.samples.start }
    }

    #[inline(always)]
    pub(super) fn left(&self, batch: &Batch<'_>) -> bool {
        self.start < batch.starts.len() && !batch.samples.is_empty()
    }

    /// The next path, start by start; whose owner follows from its start and sample.
    #[inline(always)]
    pub(super) fn next<'b>(
        &mut self,
        batch: &'b Batch<'_>,
        owner: impl FnOnce(usize, u32) -> u32,
    ) -> Option<Job<'b>> {
        if !self.left(batch) {
            return None;
        }
        let (start, sample) = (self.start, self.sample);
        self.sample += 1;
        if self.sample >= batch.samples.end {
            self.sample = batch.samples.start;
            self.start += 1;
        }
        Some(Job { owner: owner(start, sample), start: &batch.starts[start], key: batch.keys[start], sample })
    }
}

/// A batch whose ends are added up by start.
pub(super) struct Tallies<'a> {
    batch: &'a Batch<'a>,
    cursor: Cursor,
    tallies: &'a mut [Tally],
}

impl<'a> Tallies<'a> {
    pub(super) fn new(batch: &'a Batch<'a>, tallies: &'a mut [Tally]) -> Self {
        assert!(tallies.len() == batch.starts.len() && batch.keys.len() == batch.starts.len());
        Self { batch, cursor: Cursor::new(batch), tallies }
    }
}

impl Work for Tallies<'_> {
    type Extra<L: Lanes> = ();

    #[inline(always)]
    fn extra<L: Lanes>(&self, _: L) {}

    #[inline(always)]
    fn left(&self) -> bool {
        self.cursor.left(self.batch)
    }

    #[inline(always)]
    fn next(&mut self) -> Option<Job<'_>> {
        self.cursor.next(self.batch, |start, _| start as u32)
    }

    #[inline(always)]
    fn leaves(&mut self, owner: u32, weight: f32) {
        self.tallies[owner as usize].add(weight);
    }

    #[inline(always)]
    fn record<L: Lanes>(&mut self, _: L, _: &Constants<'_, L>, _: &Vector<L>, _: &Trail<L>) {}
}
