//! What a print is looked at under, and by whom.

use pellucid_voxel::Channels;

use super::cie::{self, ENTRIES, MATCHING, STEP_NM};
use super::lamps::MATCHING_10;
use super::{BANDS, Illuminant, check_wavelengths, row_sums, to_linear_rgb, wavelength_nm};
use crate::ColorError;

use crate::space::Xyz;

/// Whose eyes see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Observer {
    /// The CIE 1931 standard observer, for details of 1 to 4 degrees.
    #[default]
    Cie1931,
    /// The CIE 1964 standard observer, for larger fields.
    Cie1964,
}

impl Observer {
    fn matching(self) -> &'static [[f64; 3]; ENTRIES] {
        match self {
            Self::Cie1931 => &MATCHING,
            Self::Cie1964 => &MATCHING_10,
        }
    }
}

/// How eyes adapt to the colour of a light: completely, by scaling the responses of three kinds of cones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Adaptation {
    /// Bradford's cones, as ICC profiles have it.
    #[default]
    Bradford,
    /// The cones of CAT16 (Li et al. 2017), with the degree of adaptation at 1.
    Cat16,
}

/// A light, an observer, and how that one adapts to it.
///
/// ```
/// use pellucid_color::spectrum::{Conditions, Illuminant, Observer};
/// let lamp = Conditions { observer: Observer::Cie1964, ..Illuminant::Led.into() };
/// let rows = lamp.weights_for(&[420.0, 485.0, 550.0, 615.0, 680.0])?;
/// for row in &rows {
///     assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-12); // 1 in every band is white under any light
/// }
/// # Ok::<(), pellucid_color::ColorError>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Conditions {
    /// The light.
    pub illuminant: Illuminant,
    /// Who sees.
    pub observer: Observer,
    /// How the light's own colour is discounted.
    pub adaptation: Adaptation,
}

impl From<Illuminant> for Conditions {
    /// For the CIE 1931 observer, by Bradford's cones.
    fn from(illuminant: Illuminant) -> Self {
        Self { illuminant, ..Self::default() }
    }
}

impl Conditions {
    /// Tristimulus values of the light itself over the whole table, before adaptation, with Y = 1.
    ///
    /// ```
    /// use pellucid_color::spectrum::{Conditions, Illuminant};
    /// let white = Conditions::from(Illuminant::A).white();
    /// assert!((white.x - 1.0985).abs() < 1e-3 && (white.z - 0.3558).abs() < 1e-3);
    /// ```
    pub fn white(self) -> Xyz {
        let nm: Vec<f64> = (0..ENTRIES).map(|i| cie::VISIBLE_NM.start() + STEP_NM * i as f64).collect();
        row_sums(&self.xyz_over(&nm))
    }

    /// [`Illuminant::linear_rgb_weights`] for bands at any wavelengths in nm, ascending or descending.
    ///
    /// Between bands the spectrum is taken as a straight line, and beyond the ends as level for half a step. Bands of
    /// up to 10 nm are weighed at their own wavelengths where the light's power hardly changes within them; else, and
    /// wider ones, by integrating over that line, so that five bands serve as well as a spectrum of five points can.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] when wavelengths do not ascend or descend strictly; [`ColorError::Unsupported`]
    /// outside [`VISIBLE_NM`](super::VISIBLE_NM), and for bands that tell no colour: fewer than 2, or so few or so far to
    /// one end that their white is not near the illuminant's.
    pub fn weights_for(self, wavelengths_nm: &[f64]) -> Result<[Vec<f64>; 3], ColorError> {
        check_wavelengths(wavelengths_nm)?;
        let ascending = wavelengths_nm[0] < wavelengths_nm[1];
        let mut nm = wavelengths_nm.to_vec();
        if !ascending {
            nm.reverse();
        }
        let weights = self.xyz_over(&nm);
        let usual = self.xyz_over(&std::array::from_fn::<_, BANDS, _>(wavelength_nm));
        let (white, own) = (row_sums(&weights), row_sums(&usual));
        let near = |a: f64, b: f64| (0.5..=2.0).contains(&(a / b));
        if !near(white.x, own.x) || !near(white.z, own.z) {
            let (low, high) = (nm[0], nm[nm.len() - 1]);
            return Err(ColorError::unsupported(
                "bands",
                format!(
                    "{} from {low} to {high} nm do not span what an eye sees; cover about 430 to 670 nm, or give rows \
                     of your own",
                    nm.len()
                ),
            ));
        }
        let mut rows = to_linear_rgb(&weights, self.adaptation);
        if !ascending {
            rows.iter_mut().for_each(|row| row.reverse());
        }
        Ok(rows)
    }

    /// Rows of the matrix from any channels to linear Rec.709: R, G, B are themselves under every illuminant, two or
    /// more bands as [`Conditions::weights_for`], one channel and channels without a wavelength the mean as grey.
    ///
    /// # Errors
    /// As [`Conditions::weights_for`]; [`ColorError::Unsupported`] for wavelengths that are named but not evenly
    /// spaced.
    pub fn rows_for(self, channels: &Channels) -> Result<[Vec<f64>; 3], ColorError> {
        let grey = |count: usize| std::array::from_fn(|_| vec![1.0 / count as f64; count]);
        match channels {
            Channels::Rgb => Ok([vec![1.0, 0.0, 0.0], vec![0.0, 1.0, 0.0], vec![0.0, 0.0, 1.0]]),
            Channels::Bands { count: 1, .. } => Ok(grey(1)),
            Channels::Bands { .. } => self.weights_for(&channels.wavelengths_nm().collect::<Vec<_>>()),
            Channels::Named(names) if names.len() > 1 && names.iter().all(|n| n.trim().ends_with("nm")) => {
                Err(ColorError::unsupported(
                    "channel names",
                    "wavelengths that are not evenly spaced; resample them, or give rows of your own",
                ))
            }
            Channels::Named(names) => Ok(grey(names.len())),
        }
    }

    /// Rows X, Y, Z over ascending wavelengths, scaled so that 1 in every band has Y = 1.
    pub(super) fn xyz_over(self, nm: &[f64]) -> [Vec<f64>; 3] {
        let (matching, illuminant) = (self.observer.matching(), self.illuminant);
        let weighed = |at: f64| cie::matching(matching, at).map(|v| v * illuminant.power(at));
        let mut rows: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; nm.len()]);
        let mut add = |band: usize, weight: f64, xyz: [f64; 3]| {
            rows.iter_mut().zip(xyz).for_each(|(row, v)| row[band] += v * weight);
        };
        let last = nm.len() - 1;
        let gap = |k: usize| nm[k + 1] - nm[k];
        if illuminant.is_smooth() && (0..last).all(|k| gap(k) <= STEP_NM * (1.0 + 1e-9)) {
            for (k, &at) in nm.iter().enumerate() {
                let width = 0.5 * (gap(k.saturating_sub(1)) + gap(k.min(last - 1)));
                add(k, width / gap(0), weighed(at));
            }
        } else {
            let (low, high) = (nm[0] - 0.5 * gap(0), nm[last] + 0.5 * gap(last - 1));
            // Steps of 1 nm at most, each taken at its middle.
            let steps = (high - low).ceil();
            let mut k = 0;
            for i in 0..steps as usize {
                let at = low + (high - low) * (i as f64 + 0.5) / steps;
                if !cie::VISIBLE_NM.contains(&at) {
                    continue;
                }
                while k + 1 < last && at > nm[k + 1] {
                    k += 1;
                }
                let part = ((at - nm[k]) / gap(k)).clamp(0.0, 1.0);
                add(k, 1.0 - part, weighed(at));
                add(k + 1, part, weighed(at));
            }
        }
        let luminance: f64 = rows[1].iter().sum();
        rows.map(|row| row.into_iter().map(|v| v / luminance).collect())
    }
}
