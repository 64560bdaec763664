//! Paths walked one by one for their throughput, and walked again for their derivative.

use super::lanes::Lanes;
use super::step::{Constants, Trail, cells};
use super::work::{Job, Work};
use super::{Vector, bits};
use crate::adjoint::{Cells, Phases};
use crate::volume::Start;

/// One path among those of a few points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Path {
    /// Position among the starts.
    pub(crate) start: u32,
    pub(crate) sample: u32,
    /// What is splat along it: see [`Scores`].
    pub(crate) scores: Scores,
}

/// What a path's throughput counts for, and what is subtracted from it: T and b of the estimator, with the sign of
/// the path's weight.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Scores {
    pub(crate) throughput: f32,
    pub(crate) baseline: f32,
}

/// Paths of a few points.
pub(crate) struct Addressed<'a> {
    pub(crate) paths: &'a [Path],
    pub(crate) starts: &'a [Start],
    /// Random key of each start.
    pub(crate) keys: &'a [u64],
}

impl Addressed<'_> {
    #[inline(always)]
    fn next(&self, position: &mut usize) -> Option<Job<'_>> {
        let path = self.paths.get(*position)?;
        let owner = *position as u32;
        *position += 1;
        let start = path.start as usize;
        Some(Job { owner, start: &self.starts[start], key: self.keys[start], sample: path.sample })
    }
}

/// Paths whose throughputs are wanted.
pub(super) struct Weights<'a> {
    paths: &'a Addressed<'a>,
    next: usize,
    pub(super) weights: Vec<f32>,
}

/// Additions that wait for their memory.
const PENDING: usize = 64;

/// Paths whose steps are splat.
pub(super) struct Replay<'a> {
    paths: &'a Addressed<'a>,
    next: usize,
    cells: &'a Cells,
    phases: &'a Phases,
    /// A ring: the oldest is at `place`.
    pending: [Splat; PENDING],
    place: usize,
}

/// What is added to a cell's length and to its scatterings.
#[derive(Clone, Copy, Default)]
struct Splat {
    cell: u32,
    length: f32,
    scattering: f32,
}

impl<'a> Weights<'a> {
    pub(super) fn new(paths: &'a Addressed<'a>) -> Self {
        Self { paths, next: 0, weights: vec![0.0; paths.paths.len()] }
    }
}

impl<'a> Replay<'a> {
    pub(super) fn new(paths: &'a Addressed<'a>, cells: &'a Cells, phases: &'a Phases) -> Self {
        Self { paths, next: 0, cells, phases, pending: [Splat::default(); PENDING], place: 0 }
    }

    /// Adds once the memory had time to come: paths wander through more of it than caches hold.
    #[inline(always)]
    fn add(&mut self, splat: Splat) {
        prefetch(self.cells.sums(splat.cell));
        let old = std::mem::replace(&mut self.pending[self.place], splat);
        self.place = (self.place + 1) % PENDING;
        self.cells.add(old.cell, old.length, old.scattering);
    }

    /// Adds what waits still.
    pub(super) fn finish(&mut self) {
        for splat in self.pending {
            self.cells.add(splat.cell, splat.length, splat.scattering);
        }
        self.pending = [Splat::default(); PENDING];
    }
}

impl Work for Weights<'_> {
    type Extra<L: Lanes> = ();

    #[inline(always)]
    fn extra<L: Lanes>(&self, _: L) {}

    #[inline(always)]
    fn left(&self) -> bool {
        self.next < self.paths.paths.len()
    }

    #[inline(always)]
    fn next(&mut self) -> Option<Job<'_>> {
        self.paths.next(&mut self.next)
    }

    #[inline(always)]
    fn leaves(&mut self, owner: u32, weight: f32) {
        self.weights[owner as usize] = weight;
    }

    #[inline(always)]
    fn record<L: Lanes>(&mut self, _: L, _: &Constants<'_, L>, _: &Vector<L>, _: &Trail<L>) {}
}

impl Work for Replay<'_> {
    type Extra<L: Lanes> = ();

    #[inline(always)]
    fn extra<L: Lanes>(&self, _: L) {}

    #[inline(always)]
    fn left(&self) -> bool {
        self.next < self.paths.paths.len()
    }

    #[inline(always)]
    fn next(&mut self) -> Option<Job<'_>> {
        self.paths.next(&mut self.next)
    }

    #[inline(always)]
    fn leaves(&mut self, _: u32, _: f32) {}

    #[inline(always)]
    fn record<L: Lanes>(&mut self, l: L, constants: &Constants<'_, L>, v: &Vector<L>, trail: &Trail<L>) {
        let none = l.splat_i(0);
        let (brick, local) = cells(l, constants, self.cells.table(), &trail.point);
        let flown = v.alive & !l.mask_bits(l.eq_i(brick, none));
        let mut scattered = v.alive & l.mask_bits(trail.scatters);
        if flown | scattered == 0 {
            return;
        }
        let mut splats = [Splat::default(); 16];
        if flown != 0 {
            let cell = l.store_i(cell_of(l, brick, local));
            let (length, weight) = (l.store(trail.length), l.store(trail.weight));
            for lane in bits(flown) {
                let scores = &self.paths.paths[v.owner[lane] as usize].scores;
                splats[lane] = Splat {
                    cell: cell[lane],
                    length: scores.throughput * length[lane],
                    scattering: scores.baseline * weight[lane] * length[lane],
                };
            }
        }
        if scattered != 0 {
            let (brick, local) = cells(l, constants, self.cells.table(), &v.paths.position);
            scattered &= !l.mask_bits(l.eq_i(brick, none));
            let cell = l.store_i(cell_of(l, brick, local));
            let (byte, kept) = (l.store_i(v.paths.byte), l.store(trail.kept));
            let cosine = if self.phases.several() {
                l.store(dot(l, &trail.heading, &v.paths.direction))
            } else {
                [0.0; 16]
            };
            for lane in bits(scattered) {
                let scores = &self.paths.paths[v.owner[lane] as usize].scores;
                let byte = byte[lane] & 15;
                let value = scores.throughput - scores.baseline * kept[lane];
                let value = value * self.phases.inv_sigma_s[byte as usize];
                if self.phases.several() {
                    self.cells.scatter(cell[lane], value, self.phases, byte, cosine[lane]);
                } else if flown >> lane & 1 != 0 && splats[lane].cell == cell[lane] {
                    splats[lane].scattering += value;
                } else {
                    self.add(Splat { cell: cell[lane], length: 0.0, scattering: value });
                }
            }
        }
        for lane in bits(flown) {
            self.add(splats[lane]);
        }
    }
}

/// Numbers of cells, of what their table says of a brick, 1 and more, and a voxel within it.
#[inline(always)]
fn cell_of<L: Lanes>(l: L, brick: L::I, local: L::I) -> L::I {
    l.or_i(l.shl::<6>(l.sub_i(brick, l.splat_i(1))), local)
}

#[inline(always)]
fn prefetch<T>(from: &[T]) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE is part of x86-64, and a prefetch of any address has no effect but on caches.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(from.as_ptr().cast());
    }
    let _ = from;
}

#[inline(always)]
fn dot<L: Lanes>(l: L, a: &[L::F; 3], b: &[L::F; 3]) -> L::F {
    l.fma(a[0], b[0], l.fma(a[1], b[1], l.mul(a[2], b[2])))
}
