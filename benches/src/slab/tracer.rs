//! Paths through a slab, in double precision.
//!
//! As everywhere in the project, a path starts at the surface straight down and collects radiance 1 where it leaves. Since
//! extinction is constant, flights have no null collisions and where a path goes does not depend on albedos: its weight is
//! the product of the albedos at its collisions, and the derivative by one of them the weight over that albedo, once a
//! collision. A second walk with the same random numbers finds them again (path replay, Vicini, Speierer and Jakob 2021);
//! what Russian roulette decides is kept as it was, which leaves the derivative unbiased.

use std::f64::consts::TAU;

use pellucid_core::random::{Domain, hash};
use pellucid_voxel::internal_reflectance;
use rand_core::Rng;
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::{Albedo, Slab};

/// Tasks that a derivative is cut into; their sums are added in order, so that threads do not matter.
const TASKS: usize = 8;

/// Which random numbers, and how many paths.
#[derive(Clone, Copy, Debug)]
pub struct Draw {
    /// The seed.
    pub seed: u64,
    /// What for.
    pub domain: Domain,
    /// Paths a point and channel.
    pub spp: u32,
}

impl Draw {
    /// The random numbers of a path. All of the state is hashed: states with a half in common give numbers that are not
    /// uniform from path to path.
    fn path(self, item: usize, sample: u32) -> Pcg64 {
        let word = |k: u64| u128::from(hash(self.seed, self.domain, item as u64, 2 * u64::from(sample) + k));
        Pcg64::new(word(0) << 64 | word(1), 0)
    }
}

/// Derivatives by albedos, `[channel][z][y][x]`.
pub type Gradient = [Vec<f64>; 3];

impl Slab {
    /// Radiance, `[y][x]` by channel. A path starts anywhere on its voxel's face.
    pub fn radiance(&self, albedo: &Albedo, draw: Draw) -> Vec<[f64; 3]> {
        let one = |point: usize, c: usize| {
            let channel = Channel::new(self, albedo, c);
            let each = (0..draw.spp).map(|sample| channel.walk(point, draw, sample, |_| {}));
            each.sum::<f64>() / f64::from(draw.spp.max(1))
        };
        (0..self.points()).into_par_iter().map(|point| std::array::from_fn(|c| one(point, c))).collect()
    }

    /// Derivatives of Σ `d_radiance` · radiance by the albedos, `d_radiance` as `[y][x]` by channel.
    pub fn pullback(&self, albedo: &Albedo, d_radiance: &[[f64; 3]], draw: Draw) -> Gradient {
        let share = self.points().div_ceil(TASKS);
        let task = |c: usize, task: usize| {
            let channel = Channel::new(self, albedo, c);
            let mut sums = vec![0.0; self.voxels()];
            let points = task * share..((task + 1) * share).min(self.points());
            for point in points {
                let d = d_radiance[point][c] / f64::from(draw.spp.max(1));
                (0..draw.spp).for_each(|sample| channel.replay(point, draw, sample, d, &mut sums));
            }
            sums
        };
        let all: Vec<Vec<f64>> = (0..3 * TASKS).into_par_iter().map(|i| task(i / TASKS, i % TASKS)).collect();
        std::array::from_fn(|c| {
            let mut total = vec![0.0; self.voxels()];
            for part in &all[c * TASKS..(c + 1) * TASKS] {
                total.iter_mut().zip(part).for_each(|(sum, v)| *sum += v);
            }
            total
        })
    }
}

/// A slab in one channel.
struct Channel<'a> {
    slab: &'a Slab,
    albedo: &'a [f32],
    number: usize,
    /// Mean free path in voxels.
    free_path: f64,
}

impl<'a> Channel<'a> {
    fn new(slab: &'a Slab, albedo: &'a Albedo, number: usize) -> Self {
        let free_path = 1.0 / (slab.extinction[number] * slab.voxel_mm);
        Self { slab, albedo: albedo.channel(number), number, free_path }
    }

    /// Adds d times the derivative of a path's weight.
    fn replay(&self, point: usize, draw: Draw, sample: u32, d: f64, sums: &mut [f64]) {
        let weight = self.walk(point, draw, sample, |_| {});
        if weight > 0.0 && d != 0.0 {
            self.walk(point, draw, sample, |voxel| sums[voxel] += d * weight / f64::from(self.albedo[voxel]));
        }
    }

    /// The weight with which a path leaves, 0 when roulette ended it; `visit` is told the voxel of every collision.
    fn walk(&self, point: usize, draw: Draw, sample: u32, mut visit: impl FnMut(usize)) -> f64 {
        let rng = &mut draw.path(point * 3 + self.number, sample);
        let (edge, depth) = (self.slab.edge as f64, self.slab.layers as f64);
        let mut x = (point % self.slab.edge) as f64 + uniform(rng);
        let mut y = (point / self.slab.edge) as f64 + uniform(rng);
        let mut z = 0.0;
        let mut d = [0.0, 0.0, 1.0];
        let mut weight = 1.0;
        loop {
            let flight = -uniform(rng).ln() * self.free_path;
            let to_face = if d[2] < 0.0 { -z / d[2] } else { (depth - z) / d[2] };
            let t = flight.min(to_face);
            x = wrapped(x + t * d[0], edge);
            y = wrapped(y + t * d[1], edge);
            if flight < to_face {
                z += t * d[2];
                let layer = (z as usize).min(self.slab.layers - 1);
                let voxel = (layer * self.slab.edge + y as usize) * self.slab.edge + x as usize;
                visit(voxel);
                weight *= f64::from(self.albedo[voxel]);
                if weight < self.slab.roulette {
                    if uniform(rng) * self.slab.roulette >= weight {
                        return 0.0;
                    }
                    weight = self.slab.roulette;
                }
                d = direction(1.0 - 2.0 * uniform(rng), rng);
            } else if d[2] < 0.0 {
                if uniform(rng) >= internal_reflectance(-d[2], self.slab.index) {
                    return weight;
                }
                (z, d[2]) = (0.0, -d[2]);
            } else {
                weight *= self.slab.backing;
                if weight == 0.0 {
                    return 0.0;
                }
                z = depth;
                d = direction(-uniform(rng).sqrt(), rng);
            }
        }
    }
}

/// A unit vector with this z, turned by chance.
fn direction(z: f64, rng: &mut impl Rng) -> [f64; 3] {
    let (sin, cos) = (TAU * uniform(rng)).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    [r * cos, r * sin, z]
}

/// Within 0 to below `edge`.
fn wrapped(v: f64, edge: f64) -> f64 {
    if (0.0..edge).contains(&v) {
        return v;
    }
    let v = v - edge * (v / edge).floor();
    // A tiny negative number is rounded up to the edge itself.
    if v < edge { v } else { 0.0 }
}

/// Strictly between 0 and 1.
fn uniform(rng: &mut impl Rng) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::small_slab;
    use pellucid::color::ReflectanceCurve;
    use pellucid_core::random::uniform as number;

    const TEST: Domain = Domain::new("test: slab");

    fn draw(domain: Domain, spp: u32) -> Draw {
        Draw { seed: 3, domain, spp }
    }

    fn mixed(slab: &Slab) -> Albedo {
        Albedo::of(slab, |c, voxel| 0.3 + 0.7 * number(5, TEST, voxel as u64, c as u64))
    }

    /// Weights by point and channel, of both signs.
    fn weights(slab: &Slab) -> Vec<[f64; 3]> {
        let weight = |p: usize, c: usize| number(6, TEST, p as u64, c as u64) - 0.4;
        (0..slab.points()).map(|p| std::array::from_fn(|c| weight(p, c))).collect()
    }

    #[test]
    fn a_thick_slab_is_a_half_space() {
        for index in [1.0, 1.5] {
            let curve = ReflectanceCurve::half_space(index, 0.0, 0.0).unwrap();
            let slab = Slab { layers: 100, index, backing: 0.0, roulette: 0.1, ..small_slab() };
            let albedos = [0.6, 0.9, 0.97];
            let albedo = Albedo::of(&slab, |c, _| albedos[c]);
            let shown = slab.radiance(&albedo, draw(TEST, 4000));
            for c in 0..3 {
                let n = shown.len() as f64;
                let mean = shown.iter().map(|v| v[c]).sum::<f64>() / n;
                let variance = shown.iter().map(|v| (v[c] - mean).powi(2)).sum::<f64>() / (n - 1.0);
                let expected = curve.radiance(albedos[c], 0.0);
                let off = (mean - expected) / (variance / n).sqrt();
                // Of six means with a spread from 16 values each.
                assert!(off.abs() < 4.5, "{index} {c}: {mean} {expected}, {off} standard errors");
            }
        }
    }

    #[test]
    fn nothing_is_lost_without_absorption() {
        let slab = Slab { backing: 1.0, white: [1.0; 3], ..small_slab() };
        let shown = slab.radiance(&Albedo::of(&slab, |_, _| 1.0), draw(TEST, 20));
        assert!(shown.iter().flatten().all(|v| (v - 1.0).abs() < 1e-12));
    }

    /// Without roulette a path's weight is a polynomial of the albedos for given random numbers, so that differences
    /// have no noise.
    #[test]
    fn derivatives_are_differences() {
        let slab = small_slab();
        let (albedo, weights) = (mixed(&slab), weights(&slab));
        let draw = draw(TEST.pass(1), 24);
        let gradient = slab.pullback(&albedo, &weights, draw);
        let objective = |albedo: &Albedo| -> f64 {
            let shown = slab.radiance(albedo, draw);
            let terms = shown.iter().zip(&weights);
            terms.map(|(l, d)| (0..3).map(|c| l[c] * d[c]).sum::<f64>()).sum()
        };
        let mut largest: f64 = 0.0;
        for c in 0..3 {
            for voxel in (0..slab.voxels()).step_by(5) {
                let moved = |by: f64| {
                    Albedo::of(&slab, |k, v| {
                        f64::from(albedo.channel(k)[v]) + if (k, v) == (c, voxel) { by } else { 0.0 }
                    })
                };
                let (up, down) = (moved(2e-3), moved(-2e-3));
                let width = f64::from(up.channel(c)[voxel]) - f64::from(down.channel(c)[voxel]);
                let difference = (objective(&up) - objective(&down)) / width;
                let found = gradient[c][voxel];
                largest = largest.max(found.abs());
                // The third derivative's share, and at the ends of the range the second's.
                assert!(
                    (found - difference).abs() < 1e-5 + 5e-3 * found.abs(),
                    "{c} {voxel}: {found} {difference}"
                );
            }
        }
        assert!(largest > 0.05, "some derivative is not small: {largest}");
    }

    #[test]
    fn roulette_changes_no_mean() {
        let plain = small_slab();
        let slab = Slab { roulette: 0.3, ..plain.clone() };
        let (albedo, weights) = (mixed(&slab), weights(&slab));
        let batches = |slab: &Slab, from: u32| -> Vec<f64> {
            let sum =
                |i: u32| slab.pullback(&albedo, &weights, draw(TEST.pass(from + i), 40))[1].iter().sum();
            (0..40).map(sum).collect()
        };
        let moments = |values: &[f64]| {
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            [mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n * (n - 1.0))]
        };
        let ([a, var_a], [b, var_b]) = (moments(&batches(&plain, 10)), moments(&batches(&slab, 100)));
        let off = (a - b) / (var_a + var_b).sqrt();
        assert!(off.abs() < 3.5, "{a} {b}: {off} standard errors");
        assert!(var_a.sqrt() < 0.1 * a.abs(), "fine enough to see a difference: {a} {var_a}");
    }

    #[test]
    fn threads_change_no_bit() {
        let slab = Slab { roulette: 0.1, ..small_slab() };
        let (albedo, weights) = (mixed(&slab), weights(&slab));
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let draw = draw(TEST, 8);
            pool.install(|| (slab.radiance(&albedo, draw), slab.pullback(&albedo, &weights, draw)))
        };
        assert_eq!(run(1), run(3));
    }

    #[test]
    fn numbers_are_uniform_from_path_to_path() {
        let paths = 40_000;
        let mut sums = [0.0; 6];
        for sample in 0..paths {
            let rng = &mut draw(TEST, paths).path(7, sample);
            sums.iter_mut().for_each(|sum| *sum += uniform(rng));
        }
        for sum in sums {
            let off = (sum / f64::from(paths) - 0.5) * (12.0 * f64::from(paths)).sqrt();
            assert!(off.abs() < 4.0, "{off} standard errors");
        }
    }

    #[test]
    fn positions_wrap() {
        for (v, expected) in [(3.5, 3.5), (4.0, 0.0), (-0.5, 3.5), (9.0, 1.0), (-1e-30, 0.0)] {
            assert_eq!(wrapped(v, 4.0), expected);
        }
    }
}
