//! One step of sixteen paths: fly to the next tentative collision, or as far as is known to be
//! free of air, or to the next voxel face; then look up the voxel and collide.
//!
//! No closures here: they would not inherit the caller's instruction set.

use super::bands::Companions;
use super::lanes::Lanes;
use super::math::{neg_ln, sin_cos_turn, unit};
use crate::bricks::{Bricks, SHARED};
use crate::coefficients::Coefficients;

/// The paths of sixteen lanes.
#[derive(Clone, Copy)]
pub(super) struct Paths<L: Lanes> {
    /// Position in voxels, margin included.
    pub(super) position: [L::F; 3],
    /// Unit direction in millimetres.
    pub(super) direction: [L::F; 3],
    /// Throughput, 0 to 1.
    pub(super) weight: L::F,
    /// What is left of the free flight in mm; 0 asks for a new one.
    pub(super) flight: L::F,
    /// Byte of the voxel.
    pub(super) byte: L::I,
    /// Random state.
    pub(super) rng: L::W,
}

/// What does not change from step to step, spread over lanes.
pub(super) struct Constants<'a, L: Lanes> {
    table: &'a [u32],
    words: &'a [u32],
    rate: [L::F; 3],
    last: [L::I; 3],
    row: L::I,
    slab: L::I,
    clear: L::F,
    mean_free_path: L::F,
    keep: L::F,
    scatter: L::F,
    inv_scatter: L::F,
    g: L::F,
    roulette: L::F,
}

/// Which lanes met what.
pub(super) struct Events<L: Lanes> {
    /// Arrived in air.
    pub(super) air: L::M,
    /// Ended by absorption.
    pub(super) absorbed: L::M,
    /// The axis of the face crossed last.
    pub(super) axis: L::I,
    /// A uniform random number a lane for what happens at the surface.
    pub(super) reflection: L::F,
    /// What the step did; zeros unless it was to be recorded.
    pub(super) trail: Trail<L>,
}

/// What a step did, for the derivative along a path.
pub(super) struct Trail<L: Lanes> {
    /// A uniformly random point of the stretch flown.
    pub(super) point: [L::F; 3],
    /// The stretch's length in mm.
    pub(super) length: L::F,
    /// Throughput along it.
    pub(super) weight: L::F,
    /// Direction along it.
    pub(super) heading: [L::F; 3],
    /// Scattered at its end.
    pub(super) scatters: L::M,
    /// Throughput after the collision, before roulette.
    pub(super) kept: L::F,
}

impl<'a, L: Lanes> Constants<'a, L> {
    pub(super) fn new(
        l: L,
        bricks: &'a Bricks,
        pitch_mm: [f64; 3],
        radii_mm: &[f32; 16],
        c: &Coefficients,
        roulette: f32,
    ) -> Self {
        let words = super::words(&bricks.pool);
        Self {
            table: &bricks.table,
            words,
            rate: pitch_mm.map(|mm| l.splat((1.0 / mm) as f32)),
            last: bricks.dims.map(|d| l.splat_i(d * 4 - 1)),
            row: l.splat_i(bricks.dims[0]),
            slab: l.splat_i(bricks.dims[1]),
            clear: l.load(radii_mm),
            mean_free_path: l.load(&c.mean_free_path),
            keep: l.load(&c.keep),
            scatter: l.load(&c.scatter),
            inv_scatter: l.load(&c.inv_scatter),
            g: l.load(&c.g),
            roulette: l.splat(roulette.max(1e-6)),
        }
    }
}

/// Advances every lane by one step. Lanes outside `alive` move too, to no effect.
///
/// Each lane draws the same numbers whatever its neighbours do, and moves the same whether recorded or not.
#[inline(always)]
pub(super) fn step<
    L: Lanes,
    E: Companions<L>,
    const REGULAR: bool,
    const PER_MATERIAL: bool,
    const RECORD: bool,
>(
    l: L,
    c: &Constants<'_, L>,
    s: &mut Paths<L>,
    extra: &mut E,
    alive: L::M,
) -> Events<L> {
    let zero = l.splat(0.0);
    let one = l.splat(1.0);
    let (rng, b0) = l.draw(s.rng);
    let (rng, b1) = l.draw(rng);
    let (rng, b2) = l.draw(rng);
    s.rng = rng;

    let mut trail = Trail {
        point: s.position,
        length: zero,
        weight: s.weight,
        heading: s.direction,
        scatters: l.mask(0),
        kept: zero,
    };

    let fresh = l.le(s.flight, zero);
    let path = if REGULAR { l.lookup(c.mean_free_path, s.byte) } else { c.mean_free_path };
    let t = l.select(fresh, l.mul(neg_ln(l, unit(l, b0)), path), s.flight);
    let clear = if REGULAR { zero } else { l.lookup(c.clear, l.shr::<4>(s.byte)) };
    let short = l.and(l.lt(clear, t), alive);
    let rate = [
        l.mul(s.direction[0], c.rate[0]),
        l.mul(s.direction[1], c.rate[1]),
        l.mul(s.direction[2], c.rate[2]),
    ];
    let mut crossed = l.mask(0);
    let mut axis = l.splat_i(0);
    if l.any(short) {
        // The nearest face of the voxel ahead.
        let mut plane = [zero; 3];
        let mut time = [zero; 3];
        let mut up = [crossed; 3];
        for a in 0..3 {
            let floor = l.to_f(l.to_i(s.position[a]));
            up[a] = l.lt(zero, rate[a]);
            plane[a] = l.select(up[a], l.add(floor, one), floor);
            let speed = l.max(l.abs(rate[a]), l.splat(1e-12));
            time[a] = l.div(l.abs(l.sub(plane[a], s.position[a])), speed);
        }
        let face = l.min(time[0], l.min(time[1], time[2]));
        let along_yz = l.select(l.le(time[1], face), l.splat(1.0), l.splat(2.0));
        axis = l.to_i(l.select(l.le(time[0], face), zero, along_yz));
        crossed = l.and(short, l.and(l.le(clear, face), l.lt(face, t)));
        let m = l.select(short, l.min(t, l.max(clear, face)), t);
        for a in 0..3 {
            s.position[a] = l.fma(rate[a], m, s.position[a]);
            let onto = l.and(crossed, l.le(time[a], face));
            let below = l.floats(l.sub_i(l.bits(plane[a]), l.splat_i(1)));
            s.position[a] = l.select(onto, l.select(up[a], plane[a], below), s.position[a]);
        }
        s.flight = l.sub(t, m);
        trail.length = m;
    } else {
        for a in 0..3 {
            s.position[a] = l.fma(rate[a], t, s.position[a]);
        }
        s.flight = zero;
        trail.length = t;
    }
    if RECORD {
        let along = l.mul(trail.length, spare_unit(l, b0, b1));
        for a in 0..3 {
            trail.point[a] = l.fma(rate[a], along, trail.point[a]);
        }
    }

    s.byte = voxel_bytes(l, c, &s.position);
    let air = l.and(l.eq_i(l.and_i(s.byte, l.splat_i(15)), l.splat_i(0)), alive);
    let arrived = l.and(l.and_not(l.le(s.flight, zero), air), alive);
    if REGULAR {
        s.flight = l.select(crossed, zero, s.flight);
    }

    s.weight = l.select(arrived, l.mul(s.weight, l.lookup(c.keep, s.byte)), s.weight);
    let u1 = unit(l, b1);
    let u2 = unit(l, b2);
    let scatters = l.and(arrived, l.lt(u1, l.lookup(c.scatter, s.byte)));
    extra.collide(l, s.byte, arrived, scatters);
    if RECORD {
        trail.scatters = scatters;
        trail.kept = s.weight;
    }
    if l.any(scatters) {
        let turn = l.sub(l.mul(u1, l.lookup(c.inv_scatter, s.byte)), l.splat(0.5));
        let g = if PER_MATERIAL { l.lookup(c.g, s.byte) } else { c.g };
        let turned = deflect::<L, PER_MATERIAL>(l, &s.direction, g, turn, u2);
        for a in 0..3 {
            s.direction[a] = l.select(scatters, turned[a], s.direction[a]);
        }
    }

    let mut absorbed = l.mask(0);
    let low = l.and(arrived, l.lt(s.weight, c.roulette));
    if l.any(low) {
        let (rng, b3) = l.draw(s.rng);
        s.rng = l.select_w(low, rng, s.rng);
        let dies = l.and(low, l.le(s.weight, unit(l, b3)));
        s.weight = l.select(low, one, s.weight);
        absorbed = dies;
    }
    Events { air, absorbed, axis, reflection: u2, trail }
}

/// Uniform numbers from the nine bits of each of two draws that [`unit`] leaves out, so that recording takes no
/// draws of its own.
#[inline(always)]
fn spare_unit<L: Lanes>(l: L, high: L::I, low: L::I) -> L::F {
    let nine = l.splat_i(511);
    let bits = l.or_i(l.shl::<9>(l.and_i(high, nine)), l.and_i(low, nine));
    l.fma(l.to_f(bits), l.splat(1.0 / (1 << 18) as f32), l.splat(0.5 / (1 << 18) as f32))
}

/// Voxels of positions, which are first brought within the bricks' extent, and where their bricks are in a table: below
/// its length, which is the product of its dimensions and at most 2^29.
#[inline(always)]
fn brick_at<L: Lanes>(l: L, c: &Constants<'_, L>, position: &[L::F; 3]) -> ([L::I; 3], L::I) {
    let x = l.min_u(l.to_i(position[0]), c.last[0]);
    let y = l.min_u(l.to_i(position[1]), c.last[1]);
    let z = l.min_u(l.to_i(position[2]), c.last[2]);
    let at = l.add_i(l.mul_i(l.shr::<2>(z), c.slab), l.shr::<2>(y));
    ([x, y, z], l.add_i(l.mul_i(at, c.row), l.shr::<2>(x)))
}

/// Positions in `table`, laid out as the bricks' table, and voxels within the bricks, of points, which are first
/// brought within it: what the table says, and `[z][y][x]` within the brick.
#[inline(always)]
pub(super) fn cells<L: Lanes>(l: L, c: &Constants<'_, L>, table: &[u32], point: &[L::F; 3]) -> (L::I, L::I) {
    assert_eq!(table.len(), c.table.len());
    let ([x, y, z], at) = brick_at(l, c, point);
    // SAFETY: `at` is below the length of the bricks' table, which is this one's.
    let brick = unsafe { l.gather(table, at) };
    let three = l.splat_i(3);
    let row = l.or_i(l.shl::<2>(l.and_i(z, three)), l.and_i(y, three));
    (brick, l.or_i(l.shl::<2>(row), l.and_i(x, three)))
}

/// The bytes of the voxels at positions, which are first brought within the table.
#[inline(always)]
fn voxel_bytes<L: Lanes>(l: L, c: &Constants<'_, L>, position: &[L::F; 3]) -> L::I {
    let ([x, y, z], at) = brick_at(l, c, position);
    // SAFETY: `at` is below the table's length.
    let brick = unsafe { l.gather(c.table, at) };
    let shared = l.eq_i(brick, l.and_i(brick, l.splat_i(SHARED - 1)));
    if l.mask_bits(shared) == u16::MAX {
        return brick;
    }
    let three = l.splat_i(3);
    let word = l.or_i(l.shl::<2>(l.and_i(z, three)), l.and_i(y, three));
    let word = l.or_i(l.shl::<4>(brick), word);
    // SAFETY: the table holds numbers of bricks in the pool, each of 16 words, and the pool has
    // at most 2^27 bricks.
    let word = unsafe { l.gather(c.words, word) };
    l.and_i(l.shr_by(word, l.shl::<3>(l.and_i(x, three))), l.splat_i(255))
}

/// New directions: Henyey-Greenstein cosine from `u`, azimuth from `turn` in -1/2..1/2.
#[inline(always)]
fn deflect<L: Lanes, const PER_MATERIAL: bool>(
    l: L,
    d: &[L::F; 3],
    g: L::F,
    turn: L::F,
    u: L::F,
) -> [L::F; 3] {
    let one = l.splat(1.0);
    let g2 = l.add(g, g);
    let gg = l.mul(g, g);
    let a = l.fma(u, g2, l.sub(one, g));
    let b = l.add(l.abs(d[2]), one);
    let (cosine, inv_b) = if PER_MATERIAL {
        let small = l.lt(l.abs(g), l.splat(crate::phase::NEAR_ISOTROPIC as f32));
        let q = l.div(l.sub(one, gg), a);
        let closed = l.div(l.fnma(q, q, l.add(one, gg)), l.select(small, one, g2));
        let z = l.fma(l.splat(2.0), u, l.splat(-1.0));
        let near = l.fma(l.mul(l.splat(1.5), g), l.fnma(z, z, one), z);
        (l.select(small, near, closed), l.div(one, b))
    } else {
        // One division for both quotients; that by 2g is the same every time and hoisted.
        let r = l.div(one, l.mul(a, b));
        let q = l.mul(l.mul(l.sub(one, gg), r), b);
        (l.mul(l.fnma(q, q, l.add(one, gg)), l.div(one, g2)), l.mul(r, a))
    };
    let cosine = l.max(l.min(cosine, one), l.splat(-1.0));
    let sine = l.sqrt(l.max(l.fnma(cosine, cosine, one), l.splat(0.0)));
    let (sin, cos) = sin_cos_turn(l, turn);
    let p = l.mul(sine, cos);
    let q = l.mul(sine, sin);
    let k = l.mul(l.sub(l.splat(0.0), l.fma(d[0], p, l.mul(d[1], q))), inv_b);
    let s = l.add(cosine, k);
    let signed = l.select(l.lt(d[2], l.splat(0.0)), l.sub(l.splat(0.0), k), k);
    let e = [l.fma(d[0], s, p), l.fma(d[1], s, q), l.fma(d[2], cosine, l.fma(d[2], k, signed))];
    // One Newton step keeps the length at 1 over any number of collisions.
    let norm = l.fma(e[0], e[0], l.fma(e[1], e[1], l.mul(e[2], e[2])));
    let scale = l.fnma(l.splat(0.5), norm, l.splat(1.5));
    [l.mul(e[0], scale), l.mul(e[1], scale), l.mul(e[2], scale)]
}
