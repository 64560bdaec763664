//! Raw stencils that every form of the network is tried on.

use pellucid_rpnn::variant::{INPUTS, LEVELS};
use rand_pcg::Pcg64;

use super::common::uniform;

/// Stencils of one kind, `[sample][9][270]`, 1/mm.
pub struct Case {
    pub name: &'static str,
    pub stencils: Vec<f32>,
}

/// A medium below a plane that cuts the cells of each level at a height of its own; air above.
pub fn half_space(sigma_s: f32, sigma_a: f32) -> Vec<f32> {
    let mut stencil = vec![0.0; INPUTS];
    for (cell, value) in stencil.chunks_exact_mut(2).enumerate() {
        let (level, z) = (cell / 135, cell % 135 / 15);
        let edge = f32::powi(2.0, level as i32);
        let share = ((0.5 - (z as f32 - 4.5) * edge) / edge).clamp(0.0, 1.0);
        value.copy_from_slice(&[sigma_s * share, sigma_a * share]);
    }
    stencil
}

/// Mixtures and air, cell by cell, within what prints have.
fn mixtures() -> Vec<f32> {
    let mut rng = Pcg64::new(17, 7);
    let mut cell = |_| match uniform(&mut rng) < 0.3 {
        true => [0.0; 2],
        false => [24.0 * uniform(&mut rng), 16.0 * uniform(&mut rng).powi(4)],
    };
    (0..7 * INPUTS / 2).flat_map(&mut cell).collect()
}

/// One cell alone, at the corner or in the middle of one level.
fn single_cells() -> Vec<f32> {
    let mut stencils = Vec::new();
    for level in [0, 4, LEVELS - 1] {
        for (cell, value) in [(0, [9.0, 0.0]), (67, [0.0, 5.0]), (134, [20.0, 2.0])] {
            let mut stencil = vec![0.0; INPUTS];
            stencil[(level * 135 + cell) * 2..][..2].copy_from_slice(&value);
            stencils.extend(stencil);
        }
    }
    stencils
}

pub fn all() -> Vec<Case> {
    let scaled = |factor: f32| mixtures()[..2 * INPUTS].iter().map(|v| v * factor).collect();
    vec![
        Case { name: "air", stencils: vec![0.0; INPUTS] },
        Case { name: "half-spaces", stencils: [half_space(5.99, 0.01), half_space(0.4, 8.6)].concat() },
        Case { name: "mixtures", stencils: mixtures() },
        Case { name: "single cells", stencils: single_cells() },
        Case { name: "huge", stencils: scaled(1e6) },
        Case { name: "tiny", stencils: scaled(1e-30) },
    ]
}
