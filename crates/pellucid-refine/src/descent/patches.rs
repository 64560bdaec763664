//! Step lengths of patches of the surface: each is as long as the errors there let it be.

use std::collections::HashMap;

use pellucid_voxel::Surface;
use serde::{Deserialize, Serialize};

/// Edge in mm of the cubes that cut the surface into patches.
const EDGE_MM: f64 = 1.0;
/// Step length at first, of the one that a quadratic bound of the loss makes safe.
const FIRST: f32 = 2.0;
/// Step lengths stay within these.
const RANGE: [f32; 2] = [0.02, 8.0];
/// How much a step grows after one that lowered the loss, and shrinks after one that raised it.
const GROWTH: f32 = 1.15;
const SHRINKAGE: f32 = 0.5;
/// A loss that rose by less may have done so by the prediction's noise.
const NOISE: f32 = 0.01;

/// Which patch each surface voxel lies in.
pub(super) struct Patches {
    of: Vec<u32>,
    count: usize,
}

/// What is known of a patch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Patch {
    /// Step length.
    pub length: f32,
    /// Sum of its points' losses before the last step.
    pub loss: f32,
    /// The last step raised the loss.
    pub rose: bool,
}

impl Patches {
    /// Cuts a surface.
    pub(super) fn new(surface: &Surface) -> Self {
        let pitch = surface.frame().pitch().mm();
        let mut numbers = HashMap::new();
        let of = surface.voxels().iter().map(|voxel| {
            let cube: [u32; 3] = std::array::from_fn(|a| (f64::from(voxel[a]) * pitch[a] / EDGE_MM) as u32);
            let next = numbers.len() as u32;
            *numbers.entry(cube).or_insert(next)
        });
        let of: Vec<u32> = of.collect();
        Self { of, count: numbers.len() }
    }

    /// The patch of a surface voxel.
    pub(super) fn of(&self, point: usize) -> usize {
        self.of[point] as usize
    }

    /// Takes in the loss of every surface voxel: steps become longer where it fell, shorter where it rose.
    pub(super) fn judge(&self, known: &mut Vec<Patch>, losses: &[f32]) {
        let mut sums = vec![0.0f64; self.count];
        self.of.iter().zip(losses).for_each(|(&patch, &loss)| sums[patch as usize] += f64::from(loss));
        if known.is_empty() {
            *known = sums.iter().map(|&s| Patch { length: FIRST, loss: s as f32, rose: false }).collect();
            return;
        }
        for (patch, sum) in known.iter_mut().zip(sums) {
            let loss = sum as f32;
            patch.rose = loss > patch.loss * (1.0 + NOISE);
            let factor = if patch.rose { SHRINKAGE } else { GROWTH };
            patch.length = (patch.length * factor).clamp(RANGE[0], RANGE[1]);
            patch.loss = loss;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, SurfaceOptions, Tile};

    #[test]
    fn a_patch_steps_by_its_own_losses() {
        let frame = Frame::new([0.0; 3], Pitch::new([0.1; 3]).unwrap(), [30, 10, 10]).unwrap();
        let grid = LabelGrid::from_tiles(frame, |_| Tile::Constant(5));
        let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none()).unwrap();
        let patches = Patches::new(&surface);
        assert_eq!(patches.count, 3);
        let losses = |of: [f32; 3]| -> Vec<f32> { (0..surface.len()).map(|p| of[patches.of(p)]).collect() };
        let mut known = Vec::new();
        patches.judge(&mut known, &losses([1.0; 3]));
        assert!(known.iter().all(|p| p.length == FIRST && !p.rose));
        patches.judge(&mut known, &losses([0.5, 1.5, 1.001]));
        let lengths: Vec<f32> = known.iter().map(|p| p.length).collect();
        assert_eq!(lengths, [FIRST * GROWTH, FIRST * SHRINKAGE, FIRST * GROWTH]);
        assert_eq!(known.iter().map(|p| p.rose).collect::<Vec<_>>(), [false, true, false]);
        for _ in 0..100 {
            let worse = losses([0.1, known[1].loss * 2.0 / 200.0, 1.0]);
            patches.judge(&mut known, &worse);
        }
        assert!(known.iter().all(|p| (RANGE[0]..=RANGE[1]).contains(&p.length)));
    }
}
