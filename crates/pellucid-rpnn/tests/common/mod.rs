//! Inputs and weights of tests.
#![allow(dead_code, reason = "each test binary uses its own part")]

use pellucid_rpnn::variant::{Head, INPUTS};
use pellucid_rpnn::{Variant, Weights};
use rand_core::Rng;
use rand_pcg::Pcg64;

pub fn uniform(rng: &mut Pcg64) -> f32 {
    (rng.next_u32() >> 8) as f32 / (1 << 24) as f32
}

/// Stencil-like inputs: non-negative, some cells empty.
pub fn inputs(n: usize, seed: u64) -> Vec<f32> {
    let mut rng = Pcg64::new(u128::from(seed), 7);
    (0..n * INPUTS).map(|_| (uniform(&mut rng) - 0.3).max(0.0)).collect()
}

/// Weights with biases everywhere, so that no activation is zero by construction.
pub fn weights(variant: Variant, head: Head, seed: u64) -> Weights {
    let mut weights = Weights::initial(variant, head, seed, 0.8);
    let layout = weights.layout().clone();
    let mut rng = Pcg64::new(u128::from(seed), 11);
    for layer in layout.layers.iter().filter(|l| l.name != "end3") {
        for b in &mut weights.values_mut()[layer.bias.clone()] {
            *b = 0.1 * (uniform(&mut rng) - 0.4);
        }
    }
    weights
}
