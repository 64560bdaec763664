//! How channels become colour, and back: the only place that knows three.

use pellucid_voxel::{Channels, MaterialTable};

use crate::ColorError;
use crate::intent::MediaWhite;
use crate::plane_parallel::Solver;
use crate::spectrum::Conditions;

/// Turns the radiance of a print, by channel, into linear Rec.709 relative to the print's white.
///
/// ```
/// use pellucid_color::{Viewing, intent::MediaWhite};
/// let viewing = Viewing::rgb(MediaWhite::new([0.5, 0.8, 0.4])?);
/// assert_eq!(viewing.relative_rgb(&[0.5, 0.4, 0.1]), [1.0, 0.5, 0.25]);
/// # Ok::<(), pellucid_color::ColorError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Viewing {
    /// Linear RGB by channel; channels that are R, G, B themselves need none.
    rows: Option<[Vec<f32>; 3]>,
    white: [f32; 3],
}

impl Viewing {
    /// Any channels under an illuminant (or other [`Conditions`]), relative to a white whose radiance (0 to 1, one value a channel) is
    /// `white_radiance`, such as a thick block's.
    ///
    /// R, G, B stay themselves under any illuminant. Bands are seen by the CIE 1931 observer unless the conditions name
    /// another, and adapted to D65 ([`Conditions::weights_for`]), so that a radiance of 1 in every band is absolute white. One channel, and
    /// channels that are not known to be colours, are grey: their mean.
    ///
    /// ```
    /// use pellucid_color::{Viewing, spectrum::Illuminant};
    /// use pellucid_voxel::Channels;
    /// let bands = Channels::Bands { start_nm: 420.0, step_nm: 65.0, count: 5 };
    /// let viewing = Viewing::new(&bands, Illuminant::D50, &[0.6, 0.7, 0.8, 0.8, 0.8])?;
    /// let rgb = viewing.relative_rgb(&[0.3, 0.35, 0.4, 0.4, 0.4]);
    /// assert!(rgb.iter().all(|v| (v - 0.5).abs() < 1e-6)); // half as bright as the white
    /// let grey = Viewing::new(&Channels::Named(vec!["grey".into()]), Illuminant::D65, &[0.8])?;
    /// assert_eq!(grey.relative_rgb(&[0.4]), [0.5; 3]);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// [`ColorError::Invalid`] for another number of values than channels, or a white that is not light;
    /// [`ColorError::Unsupported`] for bands that tell no colour.
    pub fn new(
        channels: &Channels,
        conditions: impl Into<Conditions>,
        white_radiance: &[f64],
    ) -> Result<Self, ColorError> {
        if white_radiance.len() != channels.count() {
            return Err(ColorError::invalid(
                "white radiance",
                format!("{} values for {} channels", white_radiance.len(), channels.count()),
            ));
        }
        let rows = conditions.into().rows_for(channels)?;
        let white =
            [0, 1, 2].map(|c| rows[c].iter().zip(white_radiance).map(|(w, v): (&f64, &f64)| w * v).sum());
        Self::from_rows(rows, MediaWhite::new(white)?)
    }

    /// How a print of these materials looks under an illuminant, relative to a thick block of its material `white`.
    /// The block's radiance comes from the exact solution of the transfer equation: milliseconds a channel.
    ///
    /// ```
    /// use pellucid_color::{Viewing, spectrum::Illuminant};
    /// use pellucid_voxel::MaterialTable;
    /// let viewing = Viewing::of_print(&MaterialTable::cmykw(), "white", 1.5, Illuminant::D65)?;
    /// let white = viewing.media_white();
    /// assert!(white[1] > white[0] && white[0] > 0.7); // thick white resin is not neutral
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Viewing::new`] and [`Solver::thick_block`]; [`ColorError::Invalid`] when no material has the name.
    pub fn of_print(
        table: &MaterialTable,
        white: &str,
        refractive_index: f64,
        conditions: impl Into<Conditions>,
    ) -> Result<Self, ColorError> {
        let material = table
            .label_of(white)
            .and_then(|label| table.get(label))
            .ok_or_else(|| ColorError::invalid("white", format!("no material is named {white:?}")))?;
        Self::new(table.spectrum(), conditions, &Solver::new(refractive_index)?.thick_block(material)?)
    }

    /// Three channels that are linear R, G, B.
    pub fn rgb(white: MediaWhite) -> Self {
        Self { rows: None, white: white.rgb().map(|v| v as f32) }
    }

    /// Any channels, whose radiance is weighed by `rows` (R, G, B over the channels) to linear RGB. `white` is that
    /// RGB of the print's white.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] unless the rows are equally long, not empty, and finite.
    pub fn from_rows(rows: [Vec<f64>; 3], white: MediaWhite) -> Result<Self, ColorError> {
        let channels = rows[0].len();
        if channels == 0 || rows.iter().any(|r| r.len() != channels || r.iter().any(|v| !v.is_finite())) {
            return Err(ColorError::invalid(
                "viewing",
                "needs three rows of finite weights, one weight a channel",
            ));
        }
        let unit = |c: usize| (0..3).all(|k| rows[c][k] == f64::from(u8::from(c == k)));
        if channels == 3 && (0..3).all(unit) {
            return Ok(Self::rgb(white));
        }
        let rows = rows.map(|row| row.into_iter().map(|v| v as f32).collect());
        Ok(Self { rows: Some(rows), white: white.rgb().map(|v| v as f32) })
    }

    /// Channels of a radiance.
    pub fn channels(&self) -> usize {
        self.rows.as_ref().map_or(3, |rows| rows[0].len())
    }

    /// The channel that weighs most in each of R, G and B.
    pub fn leading_channels(&self) -> [usize; 3] {
        let Some(rows) = &self.rows else { return [0, 1, 2] };
        let weight = |row: &[f32], channel: usize| row[channel].abs();
        std::array::from_fn(|c| {
            let row = &rows[c];
            (0..row.len()).reduce(|a, b| if weight(row, b) > weight(row, a) { b } else { a }).unwrap_or(0)
        })
    }

    /// Absolute linear RGB of the print's white: what media-relative 1 stands for.
    pub fn media_white(&self) -> [f32; 3] {
        self.white
    }

    /// Media-relative linear RGB of a radiance, one value a channel. Channels that are missing count as dark, further
    /// ones as unseen.
    pub fn relative_rgb(&self, radiance: &[f32]) -> [f32; 3] {
        let absolute: [f32; 3] = match &self.rows {
            None => std::array::from_fn(|c| radiance.get(c).copied().unwrap_or(0.0)),
            Some(rows) => std::array::from_fn(|c| rows[c].iter().zip(radiance).map(|(w, v)| w * v).sum()),
        };
        std::array::from_fn(|c| absolute[c] / self.white[c])
    }

    /// The transpose: adds to `d_radiance` the derivative by each channel of a function whose derivative by
    /// [`Viewing::relative_rgb`] is `d_rgb`.
    pub fn pullback(&self, d_rgb: [f32; 3], d_radiance: &mut [f32]) {
        let d: [f32; 3] = std::array::from_fn(|c| d_rgb[c] / self.white[c]);
        match &self.rows {
            None => d_radiance.iter_mut().zip(d).for_each(|(out, d)| *out += d),
            Some(rows) => {
                for (channel, out) in d_radiance.iter_mut().enumerate() {
                    *out += (0..3).map(|c| rows[c].get(channel).copied().unwrap_or(0.0) * d[c]).sum::<f32>();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::Illuminant;

    #[test]
    fn the_pullback_is_the_transpose() {
        let white = MediaWhite::new([0.7, 0.9, 0.6]).unwrap();
        let rows: [Vec<f64>; 3] =
            std::array::from_fn(|c| (0..5).map(|k| 0.1 + 0.05 * (c as f64 + 2.0) * k as f64).collect());
        for viewing in [Viewing::from_rows(rows, white).unwrap(), Viewing::rgb(white)] {
            let n = viewing.channels();
            let radiance: Vec<f32> = (0..n).map(|k| 0.3 + 0.1 * k as f32).collect();
            let d_rgb = [0.5, -1.0, 2.0];
            let mut d_radiance = vec![0.0; n];
            viewing.pullback(d_rgb, &mut d_radiance);
            let forward: f32 = viewing.relative_rgb(&radiance).iter().zip(d_rgb).map(|(a, b)| a * b).sum();
            let back: f32 = d_radiance.iter().zip(&radiance).map(|(a, b)| a * b).sum();
            assert!((forward - back).abs() < 1e-5, "{forward} {back}");
        }
    }

    #[test]
    fn channels_tell_how_they_are_seen() {
        let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };
        let white: Vec<f64> = (0..31).map(|k| 0.6 + 0.01 * f64::from(k)).collect();
        let radiance: Vec<f32> = (0..31).map(|k| 0.4 - 0.01 * k as f32).collect();
        for illuminant in [Illuminant::D65, Illuminant::D50, Illuminant::E] {
            let viewing = Viewing::new(&bands, illuminant, &white).unwrap();
            assert_eq!(viewing.channels(), 31);
            let rows = illuminant.linear_rgb_weights();
            let seen = viewing.relative_rgb(&radiance);
            for c in 0..3 {
                let sum = |v: &dyn Fn(usize) -> f64| (0..31).map(|k| rows[c][k] * v(k)).sum::<f64>();
                let expected = sum(&|k| f64::from(radiance[k])) / sum(&|k| white[k]);
                assert!((f64::from(seen[c]) - expected).abs() < 1e-6, "{seen:?} {expected}");
            }
            let own = white.iter().map(|&v| v as f32).collect::<Vec<_>>();
            assert!(viewing.relative_rgb(&own).iter().all(|v| (v - 1.0).abs() < 1e-6));
        }
        let rgb = Viewing::new(&Channels::Rgb, Illuminant::D50, &[0.5, 0.8, 0.4]).unwrap();
        assert_eq!(rgb, Viewing::rgb(MediaWhite::new([0.5, 0.8, 0.4]).unwrap()));
        let named = Channels::Named(["a", "b"].map(str::to_owned).to_vec());
        let grey = Viewing::new(&named, Illuminant::D65, &[0.5, 1.0]).unwrap();
        assert_eq!(grey.relative_rgb(&[0.25, 0.125]), [0.25; 3]);
        let one = Channels::Bands { start_nm: 633.0, step_nm: 1.0, count: 1 };
        assert_eq!(Viewing::new(&one, Illuminant::E, &[0.5]).unwrap().relative_rgb(&[0.25]), [0.5; 3]);
        assert!(Viewing::new(&Channels::Rgb, Illuminant::D65, &[0.5; 4]).is_err());
        assert!(Viewing::new(&Channels::Rgb, Illuminant::D65, &[0.5, 0.0, 0.5]).is_err());
        assert!(Viewing::of_print(&MaterialTable::cmykw(), "ivory", 1.5, Illuminant::D65).is_err());
    }

    #[test]
    fn refuses_rows_that_differ_in_length() {
        let white = MediaWhite::new([1.0; 3]).unwrap();
        assert!(Viewing::from_rows([vec![1.0], vec![1.0], vec![]], white).is_err());
        assert!(Viewing::from_rows([vec![], vec![], vec![]], white).is_err());
        assert!(Viewing::from_rows([vec![1.0], vec![f64::NAN], vec![1.0]], white).is_err());
    }
}
