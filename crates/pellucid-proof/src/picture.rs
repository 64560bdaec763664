//! Linear pictures.

use pellucid_core::Control;
use std::path::Path;

use crate::values::check_values;
use crate::{ProofError, SrgbImage};

/// A linear RGBA picture: Rec.709 colours, not premultiplied, and coverage.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    width: u32,
    height: u32,
    rgba: Vec<f32>,
}

impl Picture {
    /// Takes `[y][x][rgba]`, rows from the top.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] for an edge of 0 or another number of values than 4 a pixel.
    pub fn new(width: u32, height: u32, rgba: Vec<f32>) -> Result<Self, ProofError> {
        check_values("picture", width, height, rgba.len())?;
        Ok(Self { width, height, rgba })
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// `[y][x][rgba]`, linear Rec.709 and coverage, rows from the top.
    pub fn rgba(&self) -> &[f32] {
        &self.rgba
    }

    /// Red, green, blue and coverage of a pixel; nothing outside.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[f32; 4]> {
        let inside = x < self.width && y < self.height;
        let at = y as usize * self.width as usize + x as usize;
        if inside { self.rgba.as_chunks().0.get(at).copied() } else { None }
    }

    /// Eight bits a channel: colours sRGB-encoded, clipped to 0..=1; coverage as alpha.
    ///
    /// # Errors
    /// [`ProofError::Cancelled`].
    pub fn to_srgb(&self, control: &Control<'_>) -> Result<SrgbImage, ProofError> {
        SrgbImage::of_linear(self.width, self.height, control, |x, y, pixel| {
            let at = (y * self.width as usize + x) * 4;
            pixel.copy_from_slice(&self.rgba[at..at + 4]);
        })
    }

    /// Writes [`Self::to_srgb`] as a PNG file, whole or not at all.
    ///
    /// # Errors
    /// [`ProofError::Io`], [`ProofError::Cancelled`].
    pub fn write_png(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        self.to_srgb(control)?.write_png(path, control)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_that_do_not_fit_are_refused() {
        assert!(Picture::new(2, 1, vec![0.0; 8]).is_ok());
        for (w, h, n) in [(0, 1, 0), (1, 0, 0), (2, 1, 7), (2, 1, 12), (u32::MAX, u32::MAX, 4)] {
            assert!(matches!(Picture::new(w, h, vec![0.0; n]), Err(ProofError::Invalid(_))), "{w} {h} {n}");
        }
    }

    #[test]
    fn pixels_are_found_by_row_and_column() {
        let picture = Picture::new(2, 2, (0..16).map(|v| v as f32).collect()).unwrap();
        assert_eq!(picture.pixel(1, 0), Some([4.0, 5.0, 6.0, 7.0]));
        assert_eq!(picture.pixel(0, 1), Some([8.0, 9.0, 10.0, 11.0]));
        assert_eq!((picture.pixel(2, 0), picture.pixel(0, 2)), (None, None));
    }
}
