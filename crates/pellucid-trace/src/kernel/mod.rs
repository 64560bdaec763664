//! The SIMD kernel: delta tracking of many paths at once, lanes refilled as paths end.
//!
//! One source, three instruction sets, bit-identical results: see [`lanes::Lanes`].
#![allow(
    unsafe_code,
    reason = "vector intrinsics, entered by a token that exists once the processor was seen to have them, and \
              gathers whose indices the step keeps inside the table and the pool of bricks"
)]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod bands;
mod lanes;
mod math;
mod portable;
mod replay;
mod step;
mod work;

use bands::{Companions, Shared};
use lanes::Lanes;
use pellucid_core::InstructionSet;
use portable::Portable;
use step::{Constants, Events, Paths, Trail};

use crate::bricks::Brick;
use crate::coefficients::{Coefficients, Phase, SharedBands};
use crate::exit::{self, Outcome};
use crate::rng;
use crate::tally::Tally;
use crate::volume::Volume;

use crate::adjoint::{Cells, Phases};
use replay::{Replay, Weights};
use work::{Tallies, Work};

pub(crate) use bands::{Block, MOST_BANDS};
pub(crate) use replay::{Addressed, Path, Scores};
pub(crate) use work::Batch;

/// Steps after which a path is ended as if it left the object then. A path of a 60 mm white cube
/// needs some 1e5 at most; only light trapped in clear material gets here.
pub(crate) const MAX_STEPS: u64 = 1 << 22;
/// Vectors in flight, so that one's latencies hide behind the other's work.
const VECTORS: usize = 2;
/// Lanes that must be idle before a vector is refilled.
const REFILL: u32 = 3;

/// What the walks of a set of paths share.
pub(crate) struct Scene<'a> {
    pub(crate) volume: &'a Volume,
    pub(crate) coefficients: &'a Coefficients,
    /// Refractive index.
    pub(crate) index: f32,
    pub(crate) roulette: f32,
}

/// A form of the kernel. All give the same bits.
#[derive(Clone, Copy)]
pub(crate) enum Form {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Avx2),
    #[cfg(target_arch = "x86_64")]
    Avx512(avx512::Avx512),
}

impl Form {
    /// The fastest form that is not above `set`.
    pub(crate) fn of(set: InstructionSet) -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if set >= InstructionSet::Avx512
                && let Some(lanes) = avx512::Avx512::detect()
            {
                return Self::Avx512(lanes);
            }
            if set >= InstructionSet::Avx2
                && let Some(lanes) = avx2::Avx2::detect()
            {
                return Self::Avx2(lanes);
            }
        }
        let _ = set;
        Self::Portable
    }

    /// What it needs.
    pub(crate) fn instruction_set(self) -> InstructionSet {
        match self {
            Self::Portable => InstructionSet::Portable,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2(_) => InstructionSet::Avx2,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512(_) => InstructionSet::Avx512,
        }
    }
}

/// Traces a batch, adding to one tally a start.
pub(crate) fn trace(form: Form, scene: &Scene<'_>, batch: &Batch<'_>, tallies: &mut [Tally]) {
    walk::<false, _>(form, scene, &mut Tallies::new(batch, tallies));
}

/// Traces a batch by the paths of one of several bands, adding to the blocks of each start and sample.
pub(crate) fn trace_shared(
    form: Form,
    scene: &Scene<'_>,
    bands: &SharedBands,
    batch: &Batch<'_>,
    blocks: &mut [Block],
) {
    walk::<false, _>(form, scene, &mut Shared::new(batch, bands, blocks));
}

/// Throughput of every path, 0 for those that are absorbed.
pub(crate) fn weigh(form: Form, scene: &Scene<'_>, paths: &Addressed<'_>) -> Vec<f32> {
    let mut work = Weights::new(paths);
    walk::<false, _>(form, scene, &mut work);
    work.weights
}

/// Walks paths again and adds what their scores make of their steps to `cells`.
pub(crate) fn replay(form: Form, scene: &Scene<'_>, paths: &Addressed<'_>, cells: &Cells, phases: &Phases) {
    let mut work = Replay::new(paths, cells, phases);
    walk::<true, _>(form, scene, &mut work);
    work.finish();
}

/// Walks the paths of `work`. `RECORD` hands it every step.
fn walk<const RECORD: bool, W: Work>(form: Form, scene: &Scene<'_>, work: &mut W) {
    match form {
        Form::Portable => choose::<_, RECORD, W>(Portable, scene, work),
        // SAFETY: the token proves the features.
        #[cfg(target_arch = "x86_64")]
        Form::Avx2(lanes) => unsafe { walk_avx2::<RECORD, W>(lanes, scene, work) },
        // SAFETY: the token proves the features.
        #[cfg(target_arch = "x86_64")]
        Form::Avx512(lanes) => unsafe { walk_avx512::<RECORD, W>(lanes, scene, work) },
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,avx2,fma,bmi1,bmi2,popcnt,lzcnt")]
fn walk_avx512<const RECORD: bool, W: Work>(lanes: avx512::Avx512, scene: &Scene<'_>, work: &mut W) {
    choose::<_, RECORD, W>(lanes, scene, work);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,popcnt,lzcnt")]
fn walk_avx2<const RECORD: bool, W: Work>(lanes: avx2::Avx2, scene: &Scene<'_>, work: &mut W) {
    choose::<_, RECORD, W>(lanes, scene, work);
}

#[inline(always)]
fn choose<L: Lanes, const RECORD: bool, W: Work>(l: L, scene: &Scene<'_>, work: &mut W) {
    match (scene.coefficients.regular, scene.coefficients.phase) {
        (false, Phase::Uniform) => run::<L, false, false, RECORD, W>(l, scene, work),
        (false, Phase::PerMaterial) => run::<L, false, true, RECORD, W>(l, scene, work),
        (true, Phase::Uniform) => run::<L, true, false, RECORD, W>(l, scene, work),
        (true, Phase::PerMaterial) => run::<L, true, true, RECORD, W>(l, scene, work),
    }
}

/// What lanes need besides the arithmetic: whose path each one walks.
struct Vector<L: Lanes> {
    paths: Paths<L>,
    alive: u16,
    owner: [u32; 16],
    deadline: [u64; 16],
}

#[inline(always)]
fn run<L: Lanes, const REGULAR: bool, const PER_MATERIAL: bool, const RECORD: bool, W: Work>(
    l: L,
    scene: &Scene<'_>,
    work: &mut W,
) {
    let volume = scene.volume;
    let mm = volume.mm();
    let constants =
        Constants::new(l, volume.bricks(), mm, volume.radii_mm(), scene.coefficients, scene.roulette);
    let idle = Paths {
        position: [l.splat(1.5); 3],
        direction: [l.splat(0.0), l.splat(0.0), l.splat(1.0)],
        weight: l.splat(0.0),
        flight: l.splat(0.0),
        byte: l.splat_i(0),
        rng: l.load_w(&[0; 16]),
    };
    let mut vectors: [Vector<L>; VECTORS] =
        std::array::from_fn(|_| Vector { paths: idle, alive: 0, owner: [0; 16], deadline: [0; 16] });
    let mut extras: [W::Extra<L>; VECTORS] = std::array::from_fn(|_| work.extra(l));
    let mut next_check = MAX_STEPS;
    let mut steps = 0u64;
    loop {
        if steps == next_check {
            next_check = end_overdue(l, &mut vectors, &extras, steps, work);
        }
        let mut busy = false;
        for (v, extra) in vectors.iter_mut().zip(&mut extras) {
            let dead = v.alive.count_zeros();
            if (dead >= REFILL || v.alive == 0) && dead > 0 && work.left() {
                refill(l, v, extra, work, steps);
            }
            if v.alive == 0 {
                continue;
            }
            busy = true;
            let alive = l.mask(v.alive);
            let events =
                step::step::<L, _, REGULAR, PER_MATERIAL, RECORD>(l, &constants, &mut v.paths, extra, alive);
            if RECORD {
                work.record(l, &constants, v, &events.trail);
            }
            let air = l.mask_bits(events.air);
            if air != 0 {
                let left = surface_events(l, volume, scene.index, v, &events);
                if left != 0 {
                    let weights = l.store(v.paths.weight);
                    work.leave(l, extra, &v.owner, left, &weights);
                    v.alive &= !left;
                }
            }
            let absorbed = l.mask_bits(events.absorbed);
            if absorbed != 0 {
                work.absorb(l, extra, &v.owner, absorbed);
                v.alive &= !absorbed;
            }
        }
        if !busy {
            break;
        }
        steps += 1;
    }
}

/// Gives idle lanes new paths.
#[inline(always)]
fn refill<L: Lanes, W: Work>(l: L, v: &mut Vector<L>, extra: &mut W::Extra<L>, work: &mut W, steps: u64) {
    let mut position = [[0.0f32; 16]; 3];
    let mut direction = [[0.0f32; 16]; 3];
    let mut byte = [0u32; 16];
    let mut state = [0u64; 16];
    let mut taken = 0u16;
    for lane in bits(!v.alive) {
        let Some(job) = work.next() else {
            break;
        };
        let s = job.start;
        for a in 0..3 {
            position[a][lane] = s.position[a];
            direction[a][lane] = s.direction[a];
        }
        byte[lane] = u32::from(s.byte);
        // As `Pcg32::new` does: one step after adding the increment.
        state[lane] = rng::path_state(job.key, job.sample)
            .wrapping_add(rng::PCG_INCREMENT)
            .wrapping_mul(rng::PCG_MULTIPLIER)
            .wrapping_add(rng::PCG_INCREMENT);
        v.owner[lane] = job.owner;
        v.deadline[lane] = steps + MAX_STEPS;
        taken |= 1 << lane;
    }
    let m = l.mask(taken);
    let p = &mut v.paths;
    for a in 0..3 {
        p.position[a] = l.select(m, l.load(&position[a]), p.position[a]);
        p.direction[a] = l.select(m, l.load(&direction[a]), p.direction[a]);
    }
    p.weight = l.select(m, l.splat(1.0), p.weight);
    p.flight = l.select(m, l.splat(0.0), p.flight);
    p.byte = l.bits(l.select(m, l.floats(l.load_i(&byte)), l.floats(p.byte)));
    p.rng = l.select_w(m, l.load_w(&state), p.rng);
    extra.begin(l, m);
    v.alive |= taken;
}

/// Decides what paths that met the surface do; returns those that leave.
#[inline(always)]
fn surface_events<L: Lanes>(l: L, volume: &Volume, index: f32, v: &mut Vector<L>, events: &Events<L>) -> u16 {
    let u = l.store(events.reflection);
    let axis = l.store_i(events.axis);
    let p = &mut v.paths;
    let position = [l.store(p.position[0]), l.store(p.position[1]), l.store(p.position[2])];
    let direction = [l.store(p.direction[0]), l.store(p.direction[1]), l.store(p.direction[2])];
    let mut left = 0;
    for lane in bits(l.mask_bits(events.air)) {
        let at = [position[0][lane], position[1][lane], position[2][lane]];
        let d = [direction[0][lane], direction[1][lane], direction[2][lane]];
        match exit::meet(volume, index, at, axis[lane] as usize % 3, d, u[lane]) {
            Outcome::Leave => left |= 1 << lane,
            Outcome::Stay { position: at, direction: d, byte } => {
                // Lane by lane: a vector read back from memory would wait for lanes just written there.
                let one = l.mask(1 << lane);
                for a in 0..3 {
                    p.position[a] = l.select(one, l.splat(at[a]), p.position[a]);
                    p.direction[a] = l.select(one, l.splat(d[a]), p.direction[a]);
                }
                let byte = l.floats(l.splat_i(u32::from(byte)));
                p.byte = l.bits(l.select(one, byte, l.floats(p.byte)));
            }
        }
    }
    left
}

/// Ends the paths whose time is up; returns when the next one's may be.
#[cold]
fn end_overdue<L: Lanes, W: Work>(
    l: L,
    vectors: &mut [Vector<L>],
    extras: &[W::Extra<L>],
    steps: u64,
    work: &mut W,
) -> u64 {
    let mut next = steps + MAX_STEPS;
    for (v, extra) in vectors.iter_mut().zip(extras) {
        let weights = l.store(v.paths.weight);
        for lane in bits(v.alive) {
            if v.deadline[lane] <= steps {
                work.leave(l, extra, &v.owner, 1 << lane, &weights);
                v.alive &= !(1 << lane);
            } else {
                next = next.min(v.deadline[lane]);
            }
        }
    }
    next
}

/// Positions of the bits set.
#[inline(always)]
fn bits(mut mask: u16) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (mask != 0).then(|| {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            lane
        })
    })
}

/// The pool as words, sixteen a brick.
fn words(pool: &[Brick]) -> &[u32] {
    // SAFETY: a brick is exactly sixteen u32 (`repr(C)`, size 64, alignment 64).
    unsafe { std::slice::from_raw_parts(pool.as_ptr().cast(), pool.len() * 16) }
}
