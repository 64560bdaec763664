//! Spectral radiance to colour: bands at any wavelengths from 360 to 830 nm, and the usual 31 from 400 to 700 nm in
//! steps of 10 nm.
//!
//! Uses the tabulated observers and illuminants of the CIE (`CIE 15`), not analytic fits. What an [`Illuminant`] does by
//! itself is for the CIE 1931 observer with Bradford's adaptation; [`Conditions`] have any.

use pellucid_voxel::Channels;

mod cie;
mod conditions;
mod illuminant;
mod lamps;

use crate::ColorError;
use crate::space::Xyz;

pub use cie::VISIBLE_NM;
pub use conditions::{Adaptation, Conditions, Observer};
pub use illuminant::Illuminant;

/// Number of bands of the usual spectra.
pub const BANDS: usize = 31;

/// Wavelength of one of the [`BANDS`] in nm.
///
/// ```
/// assert_eq!(pellucid_color::spectrum::wavelength_nm(15), 550.0);
/// ```
pub fn wavelength_nm(band: usize) -> f64 {
    400.0 + 10.0 * band as f64
}

impl Illuminant {
    /// Rows X, Y, Z over the 31 bands: the weights of a reflectance or radiance factor, scaled so
    /// that a factor of 1 in every band has Y = 1.
    pub fn xyz_weights(self) -> [[f64; BANDS]; 3] {
        let weights = Conditions::from(self).xyz_over(&std::array::from_fn::<_, BANDS, _>(wavelength_nm));
        std::array::from_fn(|i| std::array::from_fn(|band| weights[i][band]))
    }

    /// Tristimulus values of the illuminant itself over the 31 bands.
    pub fn white(self) -> Xyz {
        xyz_of(&self.xyz_weights(), &[1.0; BANDS])
    }

    /// Rows of the matrix from the 31 bands to linear Rec.709: XYZ, Bradford-adapted from this
    /// illuminant's white over the bands to D65. A factor of 1 in every band gives exactly white.
    pub fn linear_rgb_weights(self) -> [[f64; BANDS]; 3] {
        let conditions = Conditions::from(self);
        let weights = conditions.xyz_over(&std::array::from_fn::<_, BANDS, _>(wavelength_nm));
        let rows = to_linear_rgb(&weights, conditions.adaptation);
        std::array::from_fn(|i| std::array::from_fn(|band| rows[i][band]))
    }

    /// [`Illuminant::linear_rgb_weights`] for bands at any wavelengths in nm, ascending or descending.
    ///
    /// ```
    /// use pellucid_color::spectrum::Illuminant;
    /// let rows = Illuminant::D50.weights_for(&[420.0, 485.0, 550.0, 615.0, 680.0])?;
    /// for row in &rows {
    ///     assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12); // 1 in every band is white
    /// }
    /// assert!(rows[0][3] > 0.5 && rows[2][0] > 0.1); // red sees 615 nm, blue 420 nm
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Conditions::weights_for`].
    pub fn weights_for(self, wavelengths_nm: &[f64]) -> Result<[Vec<f64>; 3], ColorError> {
        Conditions::from(self).weights_for(wavelengths_nm)
    }

    /// Rows of the matrix from any channels to linear Rec.709, as [`Conditions::rows_for`].
    ///
    /// # Errors
    /// As there.
    pub fn rows_for(self, channels: &Channels) -> Result<[Vec<f64>; 3], ColorError> {
        Conditions::from(self).rows_for(channels)
    }
}

fn check_wavelengths(nm: &[f64]) -> Result<(), ColorError> {
    if let Some(bad) = nm.iter().find(|v| !VISIBLE_NM.contains(v)) {
        return Err(ColorError::unsupported(
            "bands",
            format!(
                "{bad} nm; from {} to {} nm the eye's response is known",
                VISIBLE_NM.start(),
                VISIBLE_NM.end()
            ),
        ));
    }
    if nm.len() < 2 {
        return Err(ColorError::unsupported("bands", format!("{}; a colour needs at least 2", nm.len())));
    }
    let strict = |rising: bool| nm.windows(2).all(|w| w[0] != w[1] && (w[0] < w[1]) == rising);
    if strict(true) || strict(false) {
        return Ok(());
    }
    Err(ColorError::invalid("bands", "their wavelengths must ascend, or descend, without repeats"))
}

/// Tristimulus values of 1 in every band.
fn row_sums(weights: &[Vec<f64>; 3]) -> Xyz {
    let [x, y, z] = std::array::from_fn(|i| weights[i].iter().sum());
    Xyz { x, y, z }
}

/// From rows X, Y, Z to rows R, G, B, adapted from the rows' own white to D65.
fn to_linear_rgb(weights: &[Vec<f64>; 3], adaptation: Adaptation) -> [Vec<f64>; 3] {
    let white = row_sums(weights);
    let mut rows: [Vec<f64>; 3] = std::array::from_fn(|_| Vec::with_capacity(weights[0].len()));
    for ((&x, &y), &z) in weights[0].iter().zip(&weights[1]).zip(&weights[2]) {
        let rgb = Xyz { x, y, z }.adapt_by(adaptation, white, Xyz::D65).to_linear_rgb();
        rows.iter_mut().zip(rgb).for_each(|(row, value)| row.push(value));
    }
    rows
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
    use super::cie::{D50, D65, MATCHING};
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

    /// The formula for 31 bands written out: the values that older results were made with.
    fn written_out(illuminant: Illuminant) -> [[f64; BANDS]; 3] {
        let power = |band: usize| match illuminant {
            Illuminant::D65 => D65[band + 4],
            Illuminant::D50 => D50[band + 4],
            _ => 100.0,
        };
        let luminance: f64 = (0..BANDS).map(|band| MATCHING[band + 4][1] * power(band)).sum();
        let weights: [[f64; BANDS]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|band| MATCHING[band + 4][i] * power(band) / luminance)
        });
        let white = xyz_of(&weights, &[1.0; BANDS]);
        let mut rows = [[0.0; BANDS]; 3];
        for band in 0..BANDS {
            let column = Xyz { x: weights[0][band], y: weights[1][band], z: weights[2][band] };
            let rgb = column.adapt(white, Xyz::D65).to_linear_rgb();
            (0..3).for_each(|i| rows[i][band] = rgb[i]);
        }
        rows
    }

    const ALL: [Illuminant; 3] = [Illuminant::D65, Illuminant::D50, Illuminant::E];

    #[test]
    fn thirty_one_bands_are_what_they_were() {
        let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
        for illuminant in ALL {
            let expected = written_out(illuminant);
            assert_eq!(illuminant.linear_rgb_weights(), expected);
            let rows = illuminant.rows_for(&bands).unwrap();
            (0..3).for_each(|i| assert_eq!(rows[i], expected[i]));
            let mut down: Vec<f64> = bands.wavelengths_nm().collect();
            down.reverse();
            let mut rows = illuminant.weights_for(&down).unwrap();
            rows.iter_mut().for_each(|row| row.reverse());
            (0..3).for_each(|i| assert_eq!(rows[i], expected[i]));
        }
    }

    #[test]
    fn the_whole_table_has_the_standard_whites() {
        let nm: Vec<f64> = (0..=94).map(|i| 360.0 + 5.0 * f64::from(i)).collect();
        for (illuminant, white) in ALL.into_iter().zip([Xyz::D65, Xyz::D50, Xyz::E]) {
            let ours = row_sums(&Conditions::from(illuminant).xyz_over(&nm));
            // The standard whites are rounded to four digits of chromaticity, the table is one of 10 nm.
            assert!(
                (ours.x - white.x).abs() < 5e-4 && (ours.z - white.z).abs() < 1.5e-3,
                "{ours:?} {white:?}"
            );
        }
    }

    /// A smooth spectrum, as of a pigment.
    fn pigment(nm: f64) -> f64 {
        0.2 + 0.6 / (1.0 + ((560.0 - nm) / 30.0).exp())
    }

    #[test]
    fn other_bands_agree_as_far_as_they_resolve_the_spectrum() {
        for illuminant in ALL {
            let colour = |nm: &[f64], spectrum: &dyn Fn(f64) -> f64| {
                let rows = illuminant.weights_for(nm).unwrap();
                rows.map(|row| row.iter().zip(nm).map(|(w, &at)| w * spectrum(at)).sum::<f64>())
            };
            let at = |start: f64, step: f64, count: usize| {
                (0..count).map(|i| start + step * i as f64).collect::<Vec<_>>()
            };
            let exact = colour(&at(380.0, 1.0, 401), &pigment);
            // Apart by what a straight line between bands misses of the spectrum's edge.
            for (nm, tolerance) in [
                (at(400.0, 10.0, 31), 0.004),
                (at(405.0, 10.0, 30), 0.004),
                (at(400.0, 5.0, 61), 0.004),
                (at(400.0, 12.0, 26), 0.004),
                (at(400.0, 20.0, 16), 0.01),
                (at(420.0, 40.0, 7), 0.03),
                (at(400.0, 75.0, 5), 0.08),
            ] {
                let found = colour(&nm, &pigment);
                for (a, b) in found.iter().zip(exact) {
                    assert!(
                        (a - b).abs() < tolerance,
                        "{illuminant:?} {} bands: {found:?} {exact:?}",
                        nm.len()
                    );
                }
            }
            // What is straight between five bands is the same seen through many.
            let five = at(400.0, 75.0, 5);
            let tent = |nm: f64| (1.0 - ((nm - 550.0) / 75.0).abs()).max(0.0);
            let fine = colour(&at(365.0, 1.0, 373), &tent);
            for (a, b) in colour(&five, &tent).iter().zip(fine) {
                assert!((a - b).abs() < 2e-3, "{illuminant:?}: {a} {b}");
            }
        }
    }

    #[test]
    fn bands_that_tell_no_colour_are_refused() {
        let refused = |nm: &[f64]| Illuminant::D65.weights_for(nm).unwrap_err();
        assert!(matches!(refused(&[]), ColorError::Unsupported(_)));
        assert!(matches!(refused(&[550.0]), ColorError::Unsupported(_)));
        assert!(refused(&[350.0, 550.0]).to_string().contains("350 nm"));
        assert!(refused(&[600.0, 620.0, 640.0]).to_string().contains("600 to 640 nm"));
        assert!(matches!(refused(&[450.0, 550.0, 550.0]), ColorError::Invalid(_)));
        assert!(matches!(refused(&[450.0, 650.0, 550.0]), ColorError::Invalid(_)));
        assert!(matches!(refused(&[450.0, f64::NAN]), ColorError::Unsupported(_)));
        let uneven = Channels::Named(["450 nm", "500 nm", "600 nm"].map(str::to_owned).to_vec());
        assert!(Illuminant::D65.rows_for(&uneven).unwrap_err().to_string().contains("evenly"));
    }

    /// Chromaticities of the CIE's whites, x and y, for either observer (CIE 15).
    #[test]
    fn lights_have_their_chromaticities() {
        use Illuminant::{A, D50, D65, F11, Led};
        use Observer::{Cie1931, Cie1964};
        for (illuminant, observer, x, y) in [
            (A, Cie1931, 0.447_58, 0.407_45),
            (F11, Cie1931, 0.380_54, 0.376_92),
            (Led, Cie1931, 0.3756, 0.3723),
            (D65, Cie1964, 0.313_82, 0.331),
            (D50, Cie1964, 0.347_73, 0.359_52),
            (A, Cie1964, 0.451_17, 0.405_94),
            (F11, Cie1964, 0.385_41, 0.371_23),
        ] {
            let white = Conditions { illuminant, observer, ..Conditions::default() }.white();
            let sum = white.x + white.y + white.z;
            let (found_x, found_y) = (white.x / sum, white.y / sum);
            // The observers' tables are of 10 nm, which narrow bands ask a little more of.
            let off = (found_x - x).abs().max((found_y - y).abs());
            assert!(
                off < if illuminant.is_smooth() { 3e-4 } else { 8e-4 },
                "{illuminant:?} {found_x} {found_y}"
            );
        }
    }

    #[test]
    fn every_light_and_observer_sees_white_as_white() {
        for illuminant in Illuminant::ALL {
            for observer in [Observer::Cie1931, Observer::Cie1964] {
                for adaptation in [Adaptation::Bradford, Adaptation::Cat16] {
                    let conditions = Conditions { illuminant, observer, adaptation };
                    for nm in [(0..31).map(wavelength_nm).collect(), vec![420.0, 485.0, 550.0, 615.0, 680.0]]
                    {
                        let rows = conditions.weights_for(&nm).unwrap();
                        assert!(rows.iter().all(|row| (row.iter().sum::<f64>() - 1.0).abs() < 1e-9));
                    }
                }
            }
            assert_eq!(Illuminant::from_name(&illuminant.name().to_lowercase()), Some(illuminant));
        }
    }

    #[test]
    fn narrow_lines_are_seen_through_bands_of_10_nm() {
        // A smooth spectrum under the three-band lamp: 31 bands agree with 401.
        let colour = |nm: &[f64]| {
            let rows = Illuminant::F11.weights_for(nm).unwrap();
            rows.map(|row| row.iter().zip(nm).map(|(w, &at)| w * pigment(at)).sum::<f64>())
        };
        let fine: Vec<f64> = (0..401).map(|i| 380.0 + f64::from(i)).collect();
        let bands: Vec<f64> = (0..31).map(wavelength_nm).collect();
        for (a, b) in colour(&bands).iter().zip(colour(&fine)) {
            assert!((a - b).abs() < 0.004, "{a} {b}");
        }
    }

    #[test]
    fn refuses_other_band_counts() {
        let error = spectrum_to_xyz(&[1.0; 36], Illuminant::E).unwrap_err();
        assert!(error.to_string().contains("36 bands"));
    }
}
