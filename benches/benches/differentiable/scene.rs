//! The slab, what it should show, and how much is done.

use pellucid_benches::appearance::Error;
use pellucid_benches::slab::heuristic::Ink;
use pellucid_benches::slab::tracer::Draw;
use pellucid_benches::slab::{Albedo, Slab};
use pellucid_core::random::{Domain, uniform};

const VOXEL_MM: f64 = 0.08;
/// As of the rest of the project: light is reflected inside, and less sharp than with 1.
const INDEX: f64 = 1.5;
const WHITE: Domain = Domain::new("differentiable: white");
const GRAIN: Domain = Domain::new("differentiable: grain");

/// How much is done.
pub struct Effort {
    /// Steps of descent.
    pub iterations: u32,
    /// Steps of the heuristic.
    pub heuristic_iterations: u32,
    /// Steps in which rates are tried.
    pub trial_iterations: u32,
    /// Paths a point and channel in a prediction of descent, and in its derivative, which walks each twice.
    pub spp: u32,
    /// Paths a point and channel in the heuristic's predictions: as many as an iteration of descent walks, and more for
    /// its form without smoothing.
    pub heuristic_spp: [u32; 2],
    /// Paths a point and channel when an iterate is judged.
    pub judge_spp: u32,
    /// When a last one is.
    pub last_spp: u32,
}

/// What is refined towards what.
pub struct Scene {
    pub slab: Slab,
    pub ink: Ink,
    /// Radiance of the white slab.
    pub white: [f64; 3],
    /// Relative to that, `[y][x]`.
    pub target: Vec<[f64; 3]>,
    pub effort: Effort,
}

impl Scene {
    pub fn new(full: bool) -> Result<Self, Error> {
        let [edge, layers] = if full { [48, 20] } else { [24, 16] };
        let slab = Slab::of_white(edge, layers, VOXEL_MM, INDEX).ok_or("no white among the materials")?;
        let effort = Effort {
            iterations: if full { 300 } else { 80 },
            heuristic_iterations: if full { 48 } else { 30 },
            trial_iterations: if full { 24 } else { 12 },
            spp: 8,
            heuristic_spp: [24, if full { 512 } else { 128 }],
            judge_spp: 64,
            last_spp: if full { 1024 } else { 512 },
        };
        let draw = Draw { seed: 0, domain: WHITE, spp: 1 << 20 >> slab.points().ilog2() };
        let all_white = slab.radiance(&Albedo::of(&slab, |_, _| 1.0), draw);
        let points = slab.points() as f64;
        let white = std::array::from_fn(|c| all_white.iter().map(|v| v[c]).sum::<f64>() / points);
        Ok(Self { ink: Ink::new(&slab)?, white, target: texture(edge), slab, effort })
    }

    /// For the record.
    pub fn describe(&self) -> String {
        let (slab, e) = (&self.slab, &self.effort);
        let mm = |voxels: usize| voxels as f64 * slab.voxel_mm;
        format!(
            "{0:.1} mm x {0:.1} mm x {1:.1} mm of {2} mm voxels, repeated sideways, over a diffuse backing of \
             reflectance {3}; refractive index {4}; isotropic; extinction {5:.2?}/mm; white's albedo {6:.4?}; descent by \
             {7} + 2 x {7} paths a point, channel and iteration; every iterate judged by {8}, the last by {9}",
            mm(slab.edge),
            mm(slab.layers),
            slab.voxel_mm,
            slab.backing,
            slab.index,
            slab.extinction,
            slab.white,
            e.spp,
            e.judge_spp,
            e.last_spp
        )
    }
}

/// Fine and coarse detail in four quarters, three different channels: a smooth change of hue, stripes of two to six voxels,
/// a ring with a line of two voxels, grains of three voxels. Colours lie between what inks and white can show at large.
fn texture(edge: usize) -> Vec<[f64; 3]> {
    let half = edge / 2;
    let pixel = |x: usize, y: usize| {
        let (i, j) = (x % half, y % half);
        let [u, v] = [i, j].map(|k| (k as f64 + 0.5) / half as f64);
        match (x < half, y < half) {
            (true, true) => [0.2 + 0.6 * u, 0.65 - 0.4 * v, 0.25 + 0.5 * (1.0 - u) * v],
            (false, true) => {
                let wide = [2, 3, 6][(3 * j / half).min(2)];
                if i / wide % 2 == 0 { [0.55, 0.1, 0.12] } else { [0.85, 0.8, 0.6] }
            }
            (true, false) => {
                let radius = (u - 0.5).hypot(v - 0.5);
                match (i.abs_diff(j) < 2, (0.22..0.4).contains(&radius)) {
                    (true, _) => [0.9, 0.9, 0.85],
                    (_, true) => [0.8, 0.65, 0.12],
                    _ => [0.12, 0.25, 0.55],
                }
            }
            (false, false) => {
                let cell = (j / 3 * half + i / 3) as u64;
                let grain = uniform(0, GRAIN, cell, 0);
                [0.15 + 0.3 * grain, 0.3 + 0.5 * grain, 0.2 + 0.15 * uniform(0, GRAIN, cell, 1)]
            }
        }
    };
    (0..edge * edge).map(|p| pixel(p % edge, p / edge)).collect()
}
