//! Paths as the phase function scatters them, and guided towards where light leaves.
//!
//! A guided path draws directions with density p(ω) f(ω) / ∫ p f, p the Henyey-Greenstein function and f the exit field's
//! 1 + s μ. The integral has a closed form, since p has the mean g ω' where ω' is the direction of arrival: 1 + s g μ'.
//! Candidates of p are taken with a chance in proportion to f, and the path's weight is multiplied by (1 + s g μ') /
//! (1 + s μ), which leaves its expectation as it was (Herholz et al. 2019 draw by such products, of lobes).

use pellucid::trace::phase::{deflect, sample_cosine};
use pellucid::voxel::internal_reflectance;
use rand_core::Rng;

use super::field::{ExitField, Visit};
use super::scene::{Optics, Scene};

const INDEX: f64 = 1.5;
/// The tracer's default threshold of Russian roulette.
const ROULETTE: f64 = 0.6;
const MOST_EVENTS: u32 = 1 << 22;

/// What a path came to.
pub struct Walked {
    pub throughput: f64,
    /// Tentative collisions and reflections.
    pub events: u32,
}

/// Walks one path of a surface voxel. Where scatterings are noted, those within the depth of the field are.
pub fn walk(
    scene: &Scene,
    optics: &Optics,
    field: Option<&ExitField>,
    point: usize,
    rng: &mut impl Rng,
    mut visits: Option<&mut Vec<Visit>>,
) -> Walked {
    let (mut place, mut direction) = scene.start(point);
    let mut weight = 1.0;
    for events in 0..MOST_EVENTS {
        let t = -uniform(rng).ln() / optics.majorant;
        if let Some(axis) = scene.fly(&mut place, direction, t) {
            // The face's own normal: steps of voxels reflect as they are, for either walk.
            if uniform(rng) >= internal_reflectance(direction[axis].abs(), INDEX) {
                return Walked { throughput: weight, events };
            }
            direction[axis] = -direction[axis];
            continue;
        }
        let label = scene.label(place.voxel);
        weight *= 1.0 - optics.sigma_a[label] / optics.majorant;
        if weight < ROULETTE {
            if uniform(rng) >= weight {
                return Walked { throughput: 0.0, events };
            }
            weight = 1.0;
        }
        if uniform(rng) * (optics.majorant - optics.sigma_a[label]) >= optics.sigma_s[label] {
            continue;
        }
        let g = optics.g[label];
        let outward = if field.is_some() || visits.is_some() { scene.outward(place.voxel) } else { None };
        match (field, outward) {
            (Some(field), Some((bin, normal))) => {
                let slope = field.slope(bin);
                let (to, factor) = guide(direction, g, slope, normal, rng);
                direction = to;
                weight *= factor;
            }
            _ => direction = deflect(direction, sample_cosine(uniform(rng), g), uniform(rng)),
        }
        if let (Some(visits), Some((bin, normal))) = (&mut visits, outward) {
            visits.push(Visit { bin, cosine: dot(direction, normal), weight });
        }
    }
    Walked { throughput: weight, events: MOST_EVENTS }
}

/// A new direction by the product of phase function and field, and what it changes the weight by.
fn guide(from: [f64; 3], g: f64, slope: f64, normal: [f64; 3], rng: &mut impl Rng) -> ([f64; 3], f64) {
    let mean = 1.0 + slope * g * dot(from, normal);
    loop {
        let to = deflect(from, sample_cosine(uniform(rng), g), uniform(rng));
        let value = 1.0 + slope * dot(to, normal);
        if uniform(rng) * (1.0 + slope.abs()) < value {
            return (to, mean / value);
        }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Strictly between 0 and 1.
fn uniform(rng: &mut impl Rng) -> f64 {
    (f64::from(rng.next_u32()) + 0.5) / 4_294_967_296.0
}
