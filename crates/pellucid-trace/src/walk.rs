//! The path walk in plain double precision, over any geometry: the reference the kernel is
//! checked against, and the estimator of analytic scenes.

use rand_core::Rng;

use crate::fresnel::internal_reflectance;
use crate::phase;

/// Optical coefficients of one material in one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Optics {
    /// Scattering coefficient, 1/mm.
    pub sigma_s: f64,
    /// Absorption coefficient, 1/mm.
    pub sigma_a: f64,
    /// Henyey-Greenstein mean cosine.
    pub g: f64,
}

/// Where a flight ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Flight {
    /// Inside, after the whole distance.
    Inside([f64; 3]),
    /// At the surface, with the outward normal there.
    Surface([f64; 3], [f64; 3]),
}

/// A geometry filled with materials.
pub(crate) trait Scene {
    /// Flies from `p` in the scene along the unit vector `d` for `t` mm at most.
    fn fly(&self, p: [f64; 3], d: [f64; 3], t: f64) -> Flight;
    /// The material at a point inside.
    fn optics(&self, p: [f64; 3]) -> Optics;
    /// At least the extinction of every material.
    fn majorant(&self) -> f64;
}

/// Most tentative collisions and reflections of a path, which then counts as having left.
const MAX_EVENTS: u32 = 1 << 22;

/// Throughput of one path that starts at `p` along `d`: its weight on leaving, 0 if absorbed.
pub(crate) fn walk(
    scene: &impl Scene,
    index: Option<f64>,
    roulette: f64,
    mut p: [f64; 3],
    mut d: [f64; 3],
    rng: &mut impl Rng,
) -> f64 {
    let majorant = scene.majorant();
    let mut weight = 1.0;
    for _ in 0..MAX_EVENTS {
        let t = if majorant > 0.0 { -uniform(rng).ln() / majorant } else { f64::INFINITY };
        match scene.fly(p, d, t) {
            Flight::Surface(at, normal) => {
                p = at;
                let cosine: f64 = (0..3).map(|a| d[a] * normal[a]).sum();
                match index {
                    Some(n) if uniform(rng) < internal_reflectance(cosine, n) => {
                        d = std::array::from_fn(|a| d[a] - 2.0 * cosine * normal[a]);
                    }
                    _ => return weight,
                }
            }
            Flight::Inside(at) => {
                p = at;
                let m = scene.optics(p);
                weight *= 1.0 - m.sigma_a / majorant;
                if weight < roulette.max(1e-6) {
                    if uniform(rng) >= weight {
                        return 0.0;
                    }
                    weight = 1.0;
                }
                if uniform(rng) * (majorant - m.sigma_a) < m.sigma_s {
                    d = phase::deflect(d, phase::sample_cosine(uniform(rng), m.g), uniform(rng));
                }
            }
        }
    }
    weight
}

/// Strictly between 0 and 1.
fn uniform(rng: &mut impl Rng) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}
