//! Spectral radiance to colour: 31 bands, 400 to 700 nm in steps of 10 nm.
//!
//! Uses the tabulated CIE 1931 2° observer and illuminants (`CIE 15`), not an analytic fit.

use crate::ColorError;
use crate::space::Xyz;
use crate::spectrum_data::{D50, D65, MATCHING};

/// Number of bands.
pub const BANDS: usize = 31;

/// Wavelength of a band in nm.
///
/// ```
/// assert_eq!(pellucid_color::spectrum::wavelength_nm(15), 550.0);
/// ```
pub fn wavelength_nm(band: usize) -> f64 {
    400.0 + 10.0 * band as f64
}

/// The light a print is seen under.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Illuminant {
    /// Average daylight.
    #[default]
    D65,
    /// Horizon daylight, the graphic arts' viewing light.
    D50,
    /// Equal energy.
    E,
}

impl Illuminant {
    fn power(self, band: usize) -> f64 {
        match self {
            Self::D65 => D65[band],
            Self::D50 => D50[band],
            Self::E => 100.0,
        }
    }

    /// Rows X, Y, Z over the bands: the weights of a reflectance or radiance factor, scaled so
    /// that a factor of 1 in every band has Y = 1.
    pub fn xyz_weights(self) -> [[f64; BANDS]; 3] {
        let luminance: f64 = (0..BANDS).map(|band| MATCHING[band][1] * self.power(band)).sum();
        std::array::from_fn(|i| std::array::from_fn(|band| MATCHING[band][i] * self.power(band) / luminance))
    }

    /// Tristimulus values of the illuminant itself over these bands.
    pub fn white(self) -> Xyz {
        xyz_of(&self.xyz_weights(), &[1.0; BANDS])
    }

    /// Rows of the matrix from the bands to linear Rec.709: XYZ, Bradford-adapted from this
    /// illuminant's white over the bands to D65. A factor of 1 in every band gives exactly white.
    pub fn linear_rgb_weights(self) -> [[f64; BANDS]; 3] {
        let weights = self.xyz_weights();
        let white = self.white();
        let mut rows = [[0.0; BANDS]; 3];
        for band in 0..BANDS {
            let column = Xyz { x: weights[0][band], y: weights[1][band], z: weights[2][band] };
            let rgb = column.adapt(white, Xyz::D65).to_linear_rgb();
            for (row, value) in rows.iter_mut().zip(rgb) {
                row[band] = value;
            }
        }
        rows
    }
}

fn xyz_of(weights: &[[f64; BANDS]; 3], factor: &[f64]) -> Xyz {
    let [x, y, z] = weights.map(|row| row.iter().zip(factor).map(|(w, v)| w * v).sum());
    Xyz { x, y, z }
}

fn check_bands(factor: &[f64]) -> Result<(), ColorError> {
    if factor.len() == BANDS {
        return Ok(());
    }
    Err(ColorError::invalid(
        "spectrum",
        format!("has {} bands; resample to {BANDS}, 400 to 700 nm in steps of 10 nm", factor.len()),
    ))
}

/// XYZ of a reflectance or radiance factor over the 31 bands under an illuminant.
///
/// # Errors
/// [`ColorError::Invalid`] unless there are 31 bands.
pub fn spectrum_to_xyz(factor: &[f64], illuminant: Illuminant) -> Result<Xyz, ColorError> {
    check_bands(factor)?;
    Ok(xyz_of(&illuminant.xyz_weights(), factor))
}

/// Linear Rec.709 (D65) of a reflectance or radiance factor over the 31 bands.
///
/// # Errors
/// [`ColorError::Invalid`] unless there are 31 bands.
pub fn spectrum_to_linear_rgb(factor: &[f64], illuminant: Illuminant) -> Result<[f64; 3], ColorError> {
    check_bands(factor)?;
    Ok(illuminant.linear_rgb_weights().map(|row| row.iter().zip(factor).map(|(w, v)| w * v).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whites_are_near_the_standard_ones() {
        // The bands end at 400 and 700 nm, so the sums differ from the full tables' by 0.3 %.
        for (illuminant, white) in
            [(Illuminant::D65, Xyz::D65), (Illuminant::D50, Xyz::D50), (Illuminant::E, Xyz::E)]
        {
            let ours = illuminant.white();
            assert!((ours.y - 1.0).abs() < 1e-12);
            assert!((ours.x - white.x).abs() < 3e-3 && (ours.z - white.z).abs() < 3e-3, "{ours:?} {white:?}");
        }
    }

    #[test]
    fn perfect_white_is_white_and_scales() {
        for illuminant in [Illuminant::D65, Illuminant::D50, Illuminant::E] {
            for level in [1.0, 0.25] {
                let rgb = spectrum_to_linear_rgb(&[level; BANDS], illuminant).unwrap();
                assert!(rgb.iter().all(|v| (v - level).abs() < 1e-12), "{rgb:?}");
            }
        }
    }

    #[test]
    fn monochromatic_chromaticities() {
        // Of the spectral locus as tabulated by the CIE.
        for (nm, x, y) in [(450, 0.15664, 0.01771), (520, 0.07430, 0.83380), (600, 0.62704, 0.37249)] {
            let mut factor = [0.0; BANDS];
            factor[(nm - 400) / 10] = 1.0;
            let xyz = spectrum_to_xyz(&factor, Illuminant::E).unwrap();
            let sum = xyz.x + xyz.y + xyz.z;
            assert!((xyz.x / sum - x).abs() < 1e-4 && (xyz.y / sum - y).abs() < 1e-4, "{nm}");
        }
    }

    #[test]
    fn refuses_other_band_counts() {
        let error = spectrum_to_xyz(&[1.0; 36], Illuminant::E).unwrap_err();
        assert!(error.to_string().contains("36 bands"));
    }
}
