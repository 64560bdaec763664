//! Eight-bit pictures.

use std::sync::atomic::AtomicU64;

use pellucid_color::space::srgb_encode_u8;
use pellucid_core::Control;
use rayon::prelude::*;

use crate::ProofError;
use crate::values::check_values;

/// A picture of eight bits a channel: sRGB colours, not premultiplied, and alpha.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SrgbImage {
    width: u32,
    height: u32,
    rgba: Vec<u8>,
}

impl SrgbImage {
    /// Takes `[y][x][rgba]`, rows from the top.
    ///
    /// # Errors
    /// [`ProofError::Invalid`] for an edge of 0 or another number of values than 4 a pixel.
    pub fn new(width: u32, height: u32, rgba: Vec<u8>) -> Result<Self, ProofError> {
        check_values("picture", width, height, rgba.len())?;
        Ok(Self { width, height, rgba })
    }

    /// Encodes the linear values that `linear` gives for a column and row; neither edge is 0. Progress is in rows.
    pub(crate) fn of_linear(
        width: u32,
        height: u32,
        control: &Control<'_>,
        linear: impl Fn(usize, usize, &mut [f32; 4]) + Sync,
    ) -> Result<Self, ProofError> {
        let row_bytes = width as usize * 4;
        let mut rgba = vec![0; row_bytes * height as usize];
        let done = AtomicU64::new(0);
        rgba.par_chunks_mut(row_bytes).enumerate().try_for_each(|(y, row)| {
            control.check()?;
            for (x, pixel) in row.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                let mut values = [0.0; 4];
                linear(x, y, &mut values);
                let [r, g, b, a] = values;
                let alpha = (a.clamp(0.0, 1.0) * 255.0).round() as u8;
                let [r, g, b] = [r, g, b].map(|v| srgb_encode_u8(f64::from(v)));
                *pixel = [r, g, b, alpha];
            }
            control.advance(&done, 1, u64::from(height));
            Ok::<(), ProofError>(())
        })?;
        Self::new(width, height, rgba)
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// `[y][x][rgba]`, rows from the top.
    pub fn rgba(&self) -> &[u8] {
        &self.rgba
    }

    /// Red, green, blue and alpha of a pixel; nothing outside.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 4]> {
        let inside = x < self.width && y < self.height;
        let at = y as usize * self.width as usize + x as usize;
        if inside { self.rgba.as_chunks().0.get(at).copied() } else { None }
    }
}
