//! Pictures side by side.

use pellucid_color::space::srgb_decode;
use pellucid_core::Control;

use crate::{Picture, ProofError, SrgbImage};

/// Pixels between pictures, and around them.
const GAP: u32 = 8;
/// Mid grey behind and between pictures, sRGB.
const GREY: u8 = 128;
/// Most pixels of a sheet: 1 GiB of them.
const MAX_PIXELS: u64 = 1 << 28;

/// A row of pictures and where it lies.
struct Row<'a> {
    top: usize,
    /// Left edges, and what lies there.
    pictures: Vec<(usize, &'a Picture)>,
}

/// Pictures side by side in columns and views below each other, as opaque sRGB on mid grey.
///
/// `rows` holds one row of pictures a view. Linear values are clipped to 0..=1. Progress is in rows of pixels.
///
/// # Errors
/// [`ProofError::Unsupported`] for a sheet of more than 2^28 pixels, [`ProofError::Cancelled`].
pub fn contact_sheet(rows: &[Vec<Picture>], control: &Control<'_>) -> Result<SrgbImage, ProofError> {
    let (mut width, mut height) = (1, u64::from(GAP));
    let mut placed = Vec::new();
    for row in rows {
        let top = height as usize;
        let mut left = u64::from(GAP);
        let mut pictures = Vec::new();
        for picture in row {
            pictures.push((left as usize, picture));
            left += u64::from(picture.width() + GAP);
        }
        width = width.max(left);
        height += u64::from(row.iter().map(Picture::height).max().unwrap_or(0) + GAP);
        placed.push(Row { top, pictures });
    }
    let (Ok(width), Ok(height), true) =
        (u32::try_from(width), u32::try_from(height), width.saturating_mul(height) <= MAX_PIXELS)
    else {
        return Err(ProofError::unsupported(
            "contact sheet",
            format!("{width} x {height} pixels; {MAX_PIXELS} at most; make the pictures smaller"),
        ));
    };
    let background = srgb_decode(f64::from(GREY) / 255.0) as f32;
    SrgbImage::of_linear(width, height, control, |x, y, pixel| {
        *pixel = [background, background, background, 1.0];
        if let Some([r, g, b, a]) = look_up(&placed, x, y) {
            for (to, from) in pixel.iter_mut().zip([r, g, b]) {
                *to = from * a + background * (1.0 - a);
            }
        }
    })
}

/// The pixel of the picture at a place of the sheet.
fn look_up(rows: &[Row<'_>], x: usize, y: usize) -> Option<[f32; 4]> {
    let row = &rows[rows.partition_point(|row| row.top <= y).checked_sub(1)?];
    let (left, picture) = row.pictures[row.pictures.partition_point(|p| p.0 <= x).checked_sub(1)?];
    picture.pixel((x - left) as u32, (y - row.top) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(width: u32, height: u32, pixel: [f32; 4]) -> Picture {
        Picture::new(width, height, pixel.repeat((width * height) as usize)).unwrap()
    }

    #[test]
    fn encodes_srgb_over_grey() {
        let picture = Picture::new(1, 2, vec![1.0, 0.0, 0.5, 1.0, 0.9, 0.9, 0.9, 0.0]).unwrap();
        let sheet = contact_sheet(&[vec![picture.clone(), picture]], &Control::none()).unwrap();
        assert_eq!(sheet.pixel(8, 8), Some([255, 0, 188, 255]));
        assert_eq!(sheet.pixel(8, 9), Some([128, 128, 128, 255]));
        assert_eq!(sheet.pixel(17, 8), Some([255, 0, 188, 255]));
    }

    #[test]
    fn pictures_of_many_sizes_stand_in_rows() {
        let rows = [
            vec![flat(3, 2, [1.0, 0.0, 0.0, 1.0]), flat(1, 5, [0.0, 1.0, 0.0, 1.0])],
            vec![],
            vec![flat(20, 1, [0.0, 0.0, 1.0, 1.0])],
        ];
        let sheet = contact_sheet(&rows, &Control::none()).unwrap();
        assert_eq!((sheet.width(), sheet.height()), (36, 8 + 5 + 8 + 8 + 1 + 8));
        let count = |pixel: [u8; 4]| sheet.rgba().as_chunks::<4>().0.iter().filter(|p| **p == pixel).count();
        assert_eq!(count([255, 0, 0, 255]), 6);
        assert_eq!(count([0, 255, 0, 255]), 5);
        assert_eq!(count([0, 0, 255, 255]), 20);
        assert_eq!(count([128, 128, 128, 255]), 36 * 38 - 31);
        assert_eq!(sheet.pixel(8 + 3 + 8, 8 + 4), Some([0, 255, 0, 255]));
        assert_eq!(sheet.pixel(27, 29), Some([0, 0, 255, 255]));
        let empty = contact_sheet(&[], &Control::none()).unwrap();
        assert_eq!((empty.width(), empty.height()), (1, 8));
    }

    #[test]
    fn a_sheet_too_large_is_refused_before_it_is_made() {
        let wide = flat(1 << 18, 1, [0.0; 4]);
        let rows = vec![vec![wide]; 120];
        assert!(matches!(contact_sheet(&rows, &Control::none()), Err(ProofError::Unsupported(_))));
    }
}
