//! Errors of a slab by fresh paths.

use pellucid::color::delta_e_2000;
use pellucid::color::space::Lab;
use pellucid::refine::Sharpness;
use pellucid_core::random::Domain;

use super::field::Gaussian;
use super::loss::VIEWED_MM;
use super::tracer::Draw;
use super::{Albedo, Slab};

/// Standard deviation in mm of the mean that local contrast leaves out.
const LOCAL_MM: f64 = 1.0;
const JUDGE: Domain = Domain::new("slab: judge");

/// What a slab shows, and how far that is off its target.
#[derive(Clone, Debug, PartialEq)]
pub struct Judged {
    /// Root mean square difference of linear colours relative to white, voxel by voxel, without the judge's noise.
    pub rmse: f64,
    /// Mean CIEDE2000 at 0.1 mm.
    pub delta_e: f64,
    /// Slope of the shown local contrast on the target's, as [`Sharpness`]; `None` where the target has no edges.
    pub sharpness: Option<f64>,
    /// Linear RGB relative to white, `[y][x]`.
    pub shown: Vec<[f64; 3]>,
}

/// Judges albedos of one slab against one target.
pub struct Judge<'a> {
    slab: &'a Slab,
    white: [f64; 3],
    target: &'a [[f64; 3]],
    viewed: Gaussian,
    local: Gaussian,
    target_lab: Vec<Lab>,
    target_contrast: Vec<f64>,
}

impl<'a> Judge<'a> {
    /// Of a slab whose surface should show `target`, `[y][x]`, linear RGB relative to the radiance `white`.
    pub fn new(slab: &'a Slab, white: [f64; 3], target: &'a [[f64; 3]]) -> Self {
        let viewed = Gaussian::new(slab, VIEWED_MM);
        let local = Gaussian::new(slab, LOCAL_MM);
        let target_lab: Vec<Lab> = viewed.apply(target).into_iter().map(Lab::from_linear_rgb).collect();
        let target_contrast = contrast(&local, &target_lab);
        Self { slab, white, target, viewed, local, target_lab, target_contrast }
    }

    /// Traces so many paths a point and channel, in two halves; `pass` tells independent judgements apart.
    pub fn judge(&self, albedo: &Albedo, spp: u32, pass: u32) -> Judged {
        let half = |k: u32| {
            let draw = Draw { seed: 0, domain: JUDGE.pass(2 * pass + k), spp: spp.div_ceil(2) };
            relative(self.slab.radiance(albedo, draw), self.white)
        };
        let halves = [half(0), half(1)];
        let pairs = || halves[0].iter().zip(&halves[1]);
        // The product of two independent errors has no noise of its own in the mean.
        let products =
            pairs().zip(self.target).flat_map(|((a, b), t)| (0..3).map(|c| (a[c] - t[c]) * (b[c] - t[c])));
        let mean_square = products.sum::<f64>() / (3 * self.target.len()) as f64;
        let shown: Vec<[f64; 3]> =
            pairs().map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect();
        let lab: Vec<Lab> = self.viewed.apply(&shown).into_iter().map(Lab::from_linear_rgb).collect();
        let differences = lab.iter().zip(&self.target_lab).map(|(a, b)| delta_e_2000(*a, *b));
        let delta_e = differences.sum::<f64>() / lab.len() as f64;
        let sharpness = slope(&contrast(&self.local, &lab), &self.target_contrast);
        Judged { rmse: mean_square.max(0.0).sqrt(), delta_e, sharpness, shown }
    }
}

/// Radiances as colours relative to that of white.
pub fn relative(mut radiance: Vec<[f64; 3]>, white: [f64; 3]) -> Vec<[f64; 3]> {
    radiance.iter_mut().for_each(|v| (0..3).for_each(|c| v[c] /= white[c]));
    radiance
}

/// L* less its local mean.
fn contrast(local: &Gaussian, lab: &[Lab]) -> Vec<f64> {
    let lightness: Vec<[f64; 1]> = lab.iter().map(|lab| [lab.l]).collect();
    lightness.iter().zip(local.apply(&lightness)).map(|(l, mean)| l[0] - mean[0]).collect()
}

/// Regression slope through zero where the target has contrast enough.
fn slope(shown: &[f64], target: &[f64]) -> Option<f64> {
    let edges = shown.iter().zip(target).filter(|(_, t)| t.abs() >= f64::from(Sharpness::LEAST_CONTRAST));
    let (products, squares) = edges.fold((0.0, 0.0), |(p, q), (s, t)| (p + s * t, q + t * t));
    (squares > 0.0).then(|| products / squares)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slab::small_slab;

    /// Without absorption every path leaves with weight 1, so that the judge has no noise.
    #[test]
    fn known_errors_are_found() {
        let slab = Slab { edge: 16, backing: 1.0, white: [1.0; 3], ..small_slab() };
        let white = Albedo::of(&slab, |_, _| 1.0);
        let target: Vec<[f64; 3]> =
            (0..256).map(|p| if p / 16 < 8 { [1.0, 1.0, 1.0] } else { [0.4, 1.0, 0.7] }).collect();
        let judged = Judge::new(&slab, [1.0; 3], &target).judge(&white, 4, 0);
        assert!((judged.rmse - (0.5 * (0.36 + 0.09) / 3.0f64).sqrt()).abs() < 1e-12);
        assert!(judged.delta_e > 5.0 && judged.sharpness.unwrap().abs() < 1e-9, "{judged:?}");
        let same = vec![[1.0; 3]; 256];
        let judged = Judge::new(&slab, [1.0; 3], &same).judge(&white, 4, 0);
        assert!(judged.rmse < 1e-9 && judged.delta_e < 1e-9 && judged.sharpness.is_none());
    }

    #[test]
    fn noise_is_no_error() {
        let slab = small_slab();
        let albedo = Albedo::of(&slab, |c, voxel| 0.7 + 0.05 * c as f64 + 0.001 * voxel as f64);
        let draw = Draw { seed: 1, domain: Domain::new("test: judge"), spp: 40_000 };
        let truth = slab.radiance(&albedo, draw);
        let judged = Judge::new(&slab, [1.0; 3], &truth).judge(&albedo, 64, 1);
        // 48 values whose halves have a standard error near 0.25 / sqrt(32).
        let noise: f64 = 0.25 * 0.25 / 32.0;
        assert!(judged.rmse.powi(2) < 4.0 * noise / 48f64.sqrt(), "{}", judged.rmse);
    }
}
