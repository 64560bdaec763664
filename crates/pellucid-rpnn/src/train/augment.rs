//! From raw stencils to the network's inputs, each sample mirrored along random axes.
//!
//! Radiance does not change when the volume and the point are mirrored together, so every sample stands
//! for eight. A mirrored stencil is the stencil's cells in another order.

use rand_core::Rng;
use rand_pcg::Pcg64;

use crate::transform::InputForm;
use crate::variant::{CELLS, CELLS_XYZ, FEATURES, INPUTS, OCTANTS, STENCIL};

/// Position within a level of every cell mirrored along the axes whose bits are set (bit 0 is x).
fn mirrored_cells(axes: usize) -> [u16; CELLS] {
    let [nx, ny, _] = CELLS_XYZ;
    std::array::from_fn(|cell| {
        STENCIL.mirrored_index([cell % nx, cell / nx % ny, cell / nx / ny], axes) as u16
    })
}

/// Makes network inputs of raw stencils.
#[derive(Clone, Debug)]
pub struct Augment {
    form: InputForm,
    mirror: bool,
    seed: u64,
    cells: [[u16; CELLS]; OCTANTS],
    scratch: Box<[f32; INPUTS]>,
}

impl Augment {
    /// Mirrors are addressed by (seed, step, sample).
    pub fn new(form: InputForm, mirror: bool, seed: u64) -> Self {
        Self {
            form,
            mirror,
            seed,
            cells: std::array::from_fn(mirrored_cells),
            scratch: Box::new([0.0; INPUTS]),
        }
    }

    /// The axes along which the samples of a step are mirrored, three bits each.
    pub fn axes(&self, step: u64) -> impl Iterator<Item = usize> + use<> {
        let mut rng = Pcg64::new(
            u128::from(self.seed) << 64 | u128::from(step),
            u128::from(step).wrapping_mul(0x9e37_79b9_7f4a_7c15_f39c_c060_5ced_c835),
        );
        // The first outputs of neighbouring streams resemble each other.
        (0..4).for_each(|_| {
            rng.next_u64();
        });
        let mirror = self.mirror;
        std::iter::repeat_with(move || if mirror { (rng.next_u64() >> 61) as usize } else { 0 })
    }

    /// Transforms and mirrors samples of a step, from number `first` on, in place; `stencils` is `[sample][2430]`.
    pub fn apply(&mut self, step: u64, first: usize, stencils: &mut [f32]) {
        let axes = self.axes(step).skip(first);
        for (sample, axes) in stencils.as_chunks_mut::<INPUTS>().0.iter_mut().zip(axes) {
            self.form.apply(sample);
            if axes == 0 {
                continue;
            }
            self.scratch.copy_from_slice(sample);
            let levels = sample.chunks_exact_mut(CELLS * FEATURES);
            for (level, from) in levels.zip(self.scratch.chunks_exact(CELLS * FEATURES)) {
                let from = from.as_chunks::<FEATURES>().0;
                for (cell, &at) in level.as_chunks_mut::<FEATURES>().0.iter_mut().zip(&self.cells[axes]) {
                    *cell = from[usize::from(at)];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::variant::octant_gather;

    #[test]
    fn a_mirrored_sample_exchanges_its_octants() {
        let mut augment = Augment::new(InputForm::default(), true, 5);
        let raw: Vec<f32> = (0..64 * INPUTS).map(|i| (i * 7919 % 10_007) as f32).collect();
        let mut plain = raw.clone();
        Augment::new(InputForm::default(), false, 5).apply(3, 0, &mut plain);
        let mut mirrored = raw.clone();
        augment.apply(3, 0, &mut mirrored);
        let mut seen = [0; 8];
        for ((p, m), axes) in
            plain.chunks_exact(INPUTS).zip(mirrored.chunks_exact(INPUTS)).zip(augment.axes(3))
        {
            seen[axes] += 1;
            for octant in 0..OCTANTS {
                for (a, b) in octant_gather(octant).into_iter().zip(octant_gather(octant ^ axes)) {
                    for level in 0..9 {
                        assert_eq!(m[level * 270 + usize::from(a)], p[level * 270 + usize::from(b)]);
                    }
                }
            }
        }
        assert!(seen.iter().all(|&n| n > 0), "{seen:?}");
        let mut later = raw[5 * INPUTS..].to_vec();
        augment.apply(3, 5, &mut later);
        assert_eq!(later, mirrored[5 * INPUTS..]);
        let axes = |step| augment.axes(step).take(64).collect::<Vec<_>>();
        assert_eq!(axes(3), axes(3));
        assert_ne!(axes(3), axes(4));
    }
}
