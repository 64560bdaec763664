//! Rules of descent.

use rayon::prelude::*;

use super::tracer::Gradient;
use super::{Albedo, LEAST, Slab};

/// Shares of the past in Adam's running means (Kingma and Ba 2015).
const MEANS: [f64; 2] = [0.9, 0.999];
/// Keeps Adam from dividing by nothing.
const TINY: f64 = 1e-12;

/// How a derivative becomes a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Against the derivative, by one rate.
    Sgd,
    /// By running means of derivatives and of their squares.
    Adam,
}

impl Rule {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Sgd, Self::Adam];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sgd => "SGD",
            Self::Adam => "Adam",
        }
    }

    /// Rates to choose from. SGD's are in albedo by derivative of a loss that sums over the surface.
    pub fn rates(self) -> [f64; 5] {
        match self {
            Self::Sgd => [0.1, 0.3, 1.0, 3.0, 10.0],
            Self::Adam => [0.003, 0.01, 0.03, 0.1, 0.3],
        }
    }
}

/// A descent on its way.
pub struct Descent {
    rule: Rule,
    rate: f64,
    steps: u32,
    /// After so many steps the rate is half of what it was.
    half_life: f64,
    /// Running means by `[channel][voxel]`: of derivatives, of squares.
    means: [Vec<[f64; 2]>; 3],
}

impl Descent {
    /// Begins. The rate falls as 1 / (1 + steps / `half_life`).
    pub fn new(slab: &Slab, rule: Rule, rate: f64, half_life: f64) -> Self {
        let means = std::array::from_fn(|_| match rule {
            Rule::Sgd => Vec::new(),
            Rule::Adam => vec![[0.0; 2]; slab.voxels()],
        });
        Self { rule, rate, steps: 0, half_life, means }
    }

    /// Moves the albedos, which stay in their range.
    pub fn step(&mut self, slab: &Slab, albedo: &mut Albedo, gradient: &Gradient) {
        let rate = self.rate / (1.0 + f64::from(self.steps) / self.half_life);
        self.steps += 1;
        let whole = MEANS.map(|share| 1.0 - share.powf(f64::from(self.steps)));
        for c in 0..3 {
            let values = albedo.values[c].par_iter_mut().zip(&gradient[c]);
            let within = |v: f64| (v as f32).clamp(LEAST, slab.white[c]);
            match self.rule {
                Rule::Sgd => values.for_each(|(v, d)| *v = within(f64::from(*v) - rate * d)),
                Rule::Adam => values.zip(&mut self.means[c]).for_each(|((v, d), means)| {
                    for (k, value) in [*d, d * d].into_iter().enumerate() {
                        means[k] = MEANS[k] * means[k] + (1.0 - MEANS[k]) * value;
                    }
                    let (mean, square) = (means[0] / whole[0], means[1] / whole[1]);
                    *v = within(f64::from(*v) - rate * mean / (square.sqrt() + TINY));
                }),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::small_slab;

    #[test]
    fn both_rules_find_a_minimum_and_keep_to_the_range() {
        let slab = small_slab();
        // Of Σ k (v - aim)² / 2; one aim lies out of range.
        let aim = |c: usize, voxel: usize| if voxel == 0 { 1.4 } else { 0.3 + 0.2 * c as f64 };
        for (rule, rate) in [(Rule::Sgd, 0.3), (Rule::Adam, 0.03)] {
            let mut albedo = Albedo::of(&slab, |_, _| 0.9);
            let mut descent = Descent::new(&slab, rule, rate, 100.0);
            for _ in 0..200 {
                let by = |c: usize| {
                    let each = albedo.channel(c).iter().enumerate();
                    each.map(|(voxel, v)| (1.0 + c as f64) * (f64::from(*v) - aim(c, voxel))).collect()
                };
                let gradient = std::array::from_fn(by);
                descent.step(&slab, &mut albedo, &gradient);
            }
            for c in 0..3 {
                assert_eq!(albedo.channel(c)[0], slab.white[c]);
                let off = albedo.channel(c).iter().enumerate().skip(1);
                assert!(off.clone().all(|(i, v)| (f64::from(*v) - aim(c, i)).abs() < 0.01), "{rule:?} {c}");
            }
        }
    }

    #[test]
    fn adams_first_step_is_its_rate() {
        let slab = small_slab();
        let mut albedo = Albedo::of(&slab, |_, _| 0.5);
        let gradient = [vec![3.0; 48], vec![-1e-4; 48], vec![0.0; 48]];
        Descent::new(&slab, Rule::Adam, 0.05, 10.0).step(&slab, &mut albedo, &gradient);
        for (c, expected) in [0.45, 0.55, 0.5].into_iter().enumerate() {
            assert!((albedo.channel(c)[7] - expected).abs() < 1e-6);
        }
    }
}
