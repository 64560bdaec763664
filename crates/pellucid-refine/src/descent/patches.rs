//! Step lengths of patches of the surface: each is as long as the errors there let it be.

use std::collections::HashMap;

use pellucid_voxel::Surface;
use serde::{Deserialize, Serialize};

/// Edge in mm of the cubes that cut the surface into patches.
const EDGE_MM: f64 = 1.0;
/// Step length at first, in those that a quadratic bound of the loss makes safe if all inks moved at once. What
/// changes sign within the reach of scattered light, contrast, has far less curvature, and would hardly move.
pub(super) const FIRST: f32 = 10.0;
/// The shortest step.
pub(super) const LEAST: f32 = 0.05;
/// How much a step shrinks where the loss rose, and grows again, up to the first, where it did not.
const SHRINKAGE: f32 = 0.5;
const GROWTH: f32 = 1.1;
/// A loss above the least so far by less than this part may be so by the prediction's noise.
const NOISE: f32 = 0.3;

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
    /// Sum of its points' losses when last seen.
    pub loss: f32,
    /// The least so far.
    pub least: f32,
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
            let first = |&s: &f64| Patch { length: FIRST, loss: s as f32, least: s as f32, rose: false };
            *known = sums.iter().map(first).collect();
            return;
        }
        for (patch, sum) in known.iter_mut().zip(sums) {
            let loss = sum as f32;
            patch.rose = loss > patch.loss && loss > patch.least * (1.0 + NOISE);
            let factor = if patch.rose { SHRINKAGE } else { GROWTH };
            patch.length = (patch.length * factor).clamp(LEAST, FIRST);
            patch.loss = loss;
            patch.least = patch.least.min(loss);
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
        patches.judge(&mut known, &losses([0.5, 1.5, 1.2]));
        let lengths = |known: &[Patch]| known.iter().map(|p| p.length).collect::<Vec<_>>();
        assert_eq!(lengths(&known), [FIRST, FIRST * SHRINKAGE, FIRST]);
        assert_eq!(known.iter().map(|p| p.rose).collect::<Vec<_>>(), [false, true, false]);
        // It lies above the least, but falls.
        patches.judge(&mut known, &losses([0.7, 1.4, 1.0]));
        assert_eq!(lengths(&known), [FIRST * SHRINKAGE, FIRST * SHRINKAGE * GROWTH, FIRST]);
        for i in 0..100 {
            patches.judge(&mut known, &losses([0.1, 2.0 + i as f32, 1.0]));
        }
        assert_eq!(lengths(&known), [FIRST, LEAST, FIRST]);
    }
}
