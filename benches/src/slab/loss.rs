//! What descent lowers.

use pellucid::color::space::{Lab, lab_derivative_of_linear_rgb};

use super::Slab;
use super::field::Gaussian;

/// Standard deviation in mm of the Gaussian that the perceptual loss looks through.
pub const VIEWED_MM: f64 = 0.1;

/// A kind of loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LossKind {
    /// Squared differences of linear colours, voxel by voxel.
    Mse,
    /// Squared differences in CIELAB over 100 after smoothing by [`VIEWED_MM`].
    Perceptual,
}

impl LossKind {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Mse, Self::Perceptual];

    /// The name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mse => "MSE",
            Self::Perceptual => "perceptual",
        }
    }
}

/// A loss against a target; colours are linear RGB relative to white.
pub struct Loss {
    kind: LossKind,
    target: Vec<[f64; 3]>,
    /// Of the smoothed target.
    target_lab: Vec<[f64; 3]>,
    gaussian: Gaussian,
}

/// CIELAB, over 100.
fn lab(rgb: [f64; 3]) -> [f64; 3] {
    let lab = Lab::from_linear_rgb(rgb);
    [lab.l, lab.a, lab.b].map(|v| v / 100.0)
}

impl Loss {
    /// Of a slab whose surface should show `target`, `[y][x]`.
    pub fn new(slab: &Slab, kind: LossKind, target: &[[f64; 3]]) -> Self {
        let gaussian = Gaussian::new(slab, VIEWED_MM);
        let target_lab = gaussian.apply(target).into_iter().map(lab).collect();
        Self { kind, target: target.to_vec(), target_lab, gaussian }
    }

    /// The loss, and its derivatives by the colours shown, `[y][x]`.
    pub fn of(&self, shown: &[[f64; 3]]) -> (f64, Vec<[f64; 3]>) {
        let difference = |a: &[f64; 3], b: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|c| a[c] - b[c]) };
        let half_squares = |all: &[[f64; 3]]| 0.5 * all.iter().flatten().map(|v| v * v).sum::<f64>();
        match self.kind {
            LossKind::Mse => {
                let off: Vec<_> = shown.iter().zip(&self.target).map(|(s, t)| difference(s, t)).collect();
                (half_squares(&off), off)
            }
            LossKind::Perceptual => {
                let smoothed = self.gaussian.apply(shown);
                let seen = smoothed.iter().map(|&rgb| lab(rgb));
                let off: Vec<_> = seen.zip(&self.target_lab).map(|(s, t)| difference(&s, t)).collect();
                let by_smoothed = smoothed.iter().zip(&off).map(|(rgb, off)| {
                    let slopes = lab_derivative_of_linear_rgb(rgb.map(|v| v as f32));
                    std::array::from_fn(|c| {
                        (0..3).map(|row| f64::from(slopes[row][c]) * off[row] / 100.0).sum()
                    })
                });
                let by_smoothed: Vec<[f64; 3]> = by_smoothed.collect();
                (half_squares(&off), self.gaussian.apply(&by_smoothed))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::small_slab;
    use pellucid_core::random::{Domain, uniform};

    #[test]
    fn derivatives_are_differences() {
        let slab = Slab { edge: 6, voxel_mm: 0.08, ..small_slab() };
        let field = |seed: u64| -> Vec<[f64; 3]> {
            let value = |p: u64, c: u64| 0.1 + 0.8 * uniform(seed, Domain::new("test: loss"), p, c);
            (0..36).map(|p| std::array::from_fn(|c| value(p, c as u64))).collect()
        };
        let (shown, target) = (field(1), field(2));
        for kind in LossKind::ALL {
            let loss = Loss::new(&slab, kind, &target);
            assert!(loss.of(&target).0 < 1e-20);
            let (_, gradient) = loss.of(&shown);
            for (point, c) in [(0, 0), (7, 1), (20, 2), (35, 0)] {
                let moved = |by: f64| {
                    let mut shown = shown.clone();
                    shown[point][c] += by;
                    loss.of(&shown).0
                };
                let expected = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                let found = gradient[point][c];
                assert!(
                    (found - expected).abs() < 1e-5 * (1.0 + expected.abs()),
                    "{kind:?}: {found} {expected}"
                );
            }
        }
    }
}
