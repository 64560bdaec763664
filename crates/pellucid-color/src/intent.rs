//! From texture colours to print targets: media white, rendering intent, black point.

use crate::ColorError;

/// Linear RGB of the unprinted (white) print, every component positive.
///
/// Thick white resin is neither bright nor neutral, so colours are handled relative to it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct MediaWhite([f64; 3]);

impl MediaWhite {
    /// Checks and wraps.
    ///
    /// # Errors
    /// [`ColorError::Invalid`] unless every component is positive and finite.
    pub fn new(rgb: [f64; 3]) -> Result<Self, ColorError> {
        match rgb.iter().find(|v| !v.is_finite() || **v <= 0.0) {
            Some(bad) => {
                Err(ColorError::invalid("media white", format!("{bad} must be positive and finite")))
            }
            None => Ok(Self(rgb)),
        }
    }

    /// The components.
    pub fn rgb(self) -> [f64; 3] {
        self.0
    }

    /// Absolute to media-relative colour.
    pub fn relative(self, absolute: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| absolute[i] / self.0[i])
    }

    /// Media-relative to absolute colour.
    pub fn absolute(self, relative: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| relative[i] * self.0[i])
    }
}

/// What a texture's white becomes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum RenderingIntent {
    /// The print's white (ICC's media-relative colorimetric).
    #[default]
    RelativeColorimetric,
    /// A perfect diffuser's white: light colours then lie outside a thick print's gamut.
    AbsoluteColorimetric,
}

/// How texture colours become targets relative to the media white.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Rendering {
    /// What white becomes.
    pub intent: RenderingIntent,
    /// Scales luminance so that the texture's black becomes the print's (ICC black point
    /// compensation): keeps detail in shadows at the price of lighter ones. Off, colours darker
    /// than the print's black all become it. Relative intent only.
    pub black_point_compensation: bool,
}

impl Rendering {
    /// The target, relative to the media white, of a texture's linear RGB colour. `black` is the
    /// luminance (0 to 1, relative to the media) of the darkest print.
    ///
    /// ```
    /// use pellucid_color::intent::{MediaWhite, Rendering, RenderingIntent};
    /// let white = MediaWhite::new([0.8, 0.9, 0.8])?;
    /// let absolute = Rendering { intent: RenderingIntent::AbsoluteColorimetric, ..Rendering::default() };
    /// assert_eq!(Rendering::default().target([1.0; 3], white, 0.01), [1.0; 3]);
    /// assert_eq!(absolute.target([0.8, 0.9, 0.4], white, 0.01), [1.0, 1.0, 0.5]);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    pub fn target(&self, rgb: [f64; 3], white: MediaWhite, black: f64) -> [f64; 3] {
        match self.intent {
            RenderingIntent::AbsoluteColorimetric => white.relative(rgb),
            RenderingIntent::RelativeColorimetric if self.black_point_compensation => {
                let black = if black.is_finite() { black.clamp(0.0, 1.0) } else { 0.0 };
                rgb.map(|v| black + (1.0 - black) * v)
            }
            RenderingIntent::RelativeColorimetric => rgb,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_round_trips_and_refuses_black() {
        let white = MediaWhite::new([0.8, 0.88, 0.79]).unwrap();
        for (a, b) in white.absolute(white.relative([0.3, 0.2, 0.1])).iter().zip([0.3, 0.2, 0.1]) {
            assert!((a - b).abs() < 1e-15);
        }
        assert!(MediaWhite::new([0.8, 0.0, 0.8]).is_err());
        assert!(MediaWhite::new([0.8, f64::NAN, 0.8]).is_err());
    }

    #[test]
    fn black_point_compensation_moves_black_only() {
        let white = MediaWhite::new([0.8; 3]).unwrap();
        let rendering = Rendering { black_point_compensation: true, ..Rendering::default() };
        assert_eq!(rendering.target([0.0; 3], white, 0.013), [0.013; 3]);
        assert_eq!(rendering.target([1.0; 3], white, 0.013), [1.0; 3]);
    }
}
