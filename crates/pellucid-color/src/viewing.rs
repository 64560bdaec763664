//! How channels become colour, and back: the only place that knows three.

use crate::ColorError;
use crate::intent::MediaWhite;

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
        let rows = rows.map(|row| row.into_iter().map(|v| v as f32).collect());
        Ok(Self { rows: Some(rows), white: white.rgb().map(|v| v as f32) })
    }

    /// Channels of a radiance.
    pub fn channels(&self) -> usize {
        self.rows.as_ref().map_or(3, |rows| rows[0].len())
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
    fn refuses_rows_that_differ_in_length() {
        let white = MediaWhite::new([1.0; 3]).unwrap();
        assert!(Viewing::from_rows([vec![1.0], vec![1.0], vec![]], white).is_err());
        assert!(Viewing::from_rows([vec![], vec![], vec![]], white).is_err());
        assert!(Viewing::from_rows([vec![1.0], vec![f64::NAN], vec![1.0]], white).is_err());
    }
}
