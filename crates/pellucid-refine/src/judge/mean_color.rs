//! Mean colours of many voxels.

use serde::{Deserialize, Serialize};

/// The mean colour of some surface voxels at 0.2 mm, in CIELAB (D65) relative to the print's white.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct MeanColor {
    /// Mean L\*, 0 to 100; above 100 where the voxels are brighter than the print's white.
    pub lightness: f64,
    /// Mean of the voxels' chroma, from 0. Colours that differ in hue do not cancel.
    pub chroma: f64,
    /// Angle of the mean (a\*, b\*) in degrees, 0 to 360 without 360; says little where chroma is below 10.
    pub hue_deg: f64,
}

impl MeanColor {
    /// Of `[L*, a*, b*]` with what noise adds to each squared chroma on average; all 0 of none.
    pub(super) fn of(colors: impl Iterator<Item = ([f32; 3], f32)>) -> Self {
        let (mut lab, mut chroma, mut count) = ([0.0f64; 3], 0.0, 0u64);
        for (color, noise) in colors {
            let [l, a, b] = color.map(f64::from);
            lab.iter_mut().zip([l, a, b]).for_each(|(sum, v)| *sum += v);
            chroma += (a * a + b * b - f64::from(noise)).max(0.0).sqrt();
            count += 1;
        }
        let scale = 1.0 / count.max(1) as f64;
        // An angle just below 0 is rounded to 360.
        let hue = lab[2].atan2(lab[1]).to_degrees().rem_euclid(360.0);
        Self {
            lightness: lab[0] * scale,
            chroma: chroma * scale,
            hue_deg: if hue < 360.0 { hue } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hue_is_the_means_and_chroma_the_voxels() {
        let of = |colors: &[[f32; 3]]| MeanColor::of(colors.iter().map(|&c| (c, 0.0)));
        // Across 0 degrees.
        let mean = of(&[[40.0, 30.0, 10.0], [60.0, 30.0, -20.0]]);
        assert_eq!(mean.lightness, 50.0);
        assert!((mean.chroma - 0.5 * (1000f64.sqrt() + 1300f64.sqrt())).abs() < 1e-12);
        assert!((mean.hue_deg - (360.0 - (5.0f64 / 30.0).atan().to_degrees())).abs() < 1e-9);
        let opposite = of(&[[50.0, 20.0, 0.0], [50.0, -20.0, 0.0]]);
        assert_eq!((opposite.chroma, opposite.hue_deg), (20.0, 0.0));
        assert_eq!(of(&[[50.0, 20.0, -1e-30]]).hue_deg, 0.0, "never 360");
        assert_eq!(of(&[]), MeanColor::default());
        // Of (3, 4) with a noise of 16, 3 is left.
        assert_eq!(MeanColor::of([([9.0, 3.0, 4.0], 16.0)].into_iter()).chroma, 3.0);
        assert_eq!(MeanColor::of([([9.0, 3.0, 4.0], 26.0)].into_iter()).chroma, 0.0);
    }
}
