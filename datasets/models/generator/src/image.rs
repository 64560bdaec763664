//! Textures: painted by functions, written as small PNGs.

use std::collections::BTreeSet;

/// An sRGB colour.
pub type Rgb = [u8; 3];

/// An RGB image, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Pixels, row by row.
    pub pixels: Vec<Rgb>,
}

/// A rectangle of an image that one surface patch is mapped to.
///
/// Patch coordinates u (to the right) and v (upwards) run from 0 to 1 between the centres of the
/// outermost pixels, so bilinear filtering never reaches a neighbouring patch.
#[derive(Clone, Copy, Debug)]
pub struct Rect {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns, at least 2.
    pub width: usize,
    /// Rows, at least 2.
    pub height: usize,
}

impl Image {
    /// An image of one colour.
    pub fn new(width: usize, height: usize, fill: Rgb) -> Self {
        Self { width, height, pixels: vec![fill; width * height] }
    }

    /// Texture coordinates of patch coordinates in a rectangle.
    pub fn uv(&self, rect: Rect, u: f64, v: f64) -> [f64; 2] {
        [
            (rect.x as f64 + 0.5 + u * (rect.width - 1) as f64) / self.width as f64,
            (rect.y as f64 + 0.5 + (1.0 - v) * (rect.height - 1) as f64) / self.height as f64,
        ]
    }

    /// Paints a rectangle by patch coordinates.
    pub fn paint(&mut self, rect: Rect, color: impl Fn(f64, f64) -> Rgb) {
        for j in 0..rect.height {
            let v = 1.0 - j as f64 / (rect.height - 1) as f64;
            for i in 0..rect.width {
                let u = i as f64 / (rect.width - 1) as f64;
                self.pixels[(rect.y + j) * self.width + rect.x + i] = color(u, v);
            }
        }
    }

    /// Bilinear sample at texture coordinates, clamped at the border.
    pub fn sample(&self, uv: [f64; 2]) -> [f64; 3] {
        let at = |x: isize, y: isize| {
            let x = x.clamp(0, self.width as isize - 1) as usize;
            let y = y.clamp(0, self.height as isize - 1) as usize;
            self.pixels[y * self.width + x].map(f64::from)
        };
        let (x, y) = (uv[0] * self.width as f64 - 0.5, uv[1] * self.height as f64 - 0.5);
        let (i, j) = (x.floor(), y.floor());
        let (fx, fy) = (x - i, y - j);
        let (i, j) = (i as isize, j as isize);
        let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
        std::array::from_fn(|k| {
            (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy
        })
    }

    /// The image as PNG, with a palette when 256 colours suffice.
    ///
    /// # Errors
    /// Those of the encoder, which writes to memory.
    pub fn to_png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let colors: Vec<Rgb> =
            self.pixels.iter().copied().collect::<BTreeSet<_>>().into_iter().take(257).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_compression(png::Compression::High);
        if colors.len() > 256 {
            encoder.set_color(png::ColorType::Rgb);
            encoder.write_header()?.write_image_data(self.pixels.as_flattened())?;
            return Ok(bytes);
        }
        let (depth, bits) = match colors.len() {
            0..=2 => (png::BitDepth::One, 1),
            3..=4 => (png::BitDepth::Two, 2),
            5..=16 => (png::BitDepth::Four, 4),
            _ => (png::BitDepth::Eight, 8),
        };
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(depth);
        encoder.set_palette(colors.as_flattened().to_vec());
        encoder.set_filter(png::Filter::NoFilter);
        let mut data = Vec::new();
        for row in self.pixels.chunks_exact(self.width) {
            for group in row.chunks(8 / bits) {
                let packed = group.iter().enumerate().fold(0u8, |byte, (k, pixel)| {
                    let index = colors.binary_search(pixel).unwrap_or_default() as u8;
                    byte | index << (8 - bits * (k + 1))
                });
                data.push(packed);
            }
        }
        encoder.write_header()?.write_image_data(&data)?;
        Ok(bytes)
    }
}

/// Colours that CMYK and white resin can print, moderately saturated.
pub mod paint {
    use super::Rgb;
    /// Paper-like ground.
    pub const CREAM: Rgb = [243, 234, 214];
    /// White.
    pub const WHITE: Rgb = [250, 250, 248];
    /// Dark neutral.
    pub const CHARCOAL: Rgb = [78, 74, 76];
    /// Deep blue.
    pub const INDIGO: Rgb = [48, 78, 148];
    /// Light blue.
    pub const SKY: Rgb = [104, 170, 215];
    /// Warm red.
    pub const BRICK: Rgb = [196, 66, 62];
    /// Pink.
    pub const ROSE: Rgb = [226, 130, 150];
    /// Warm yellow.
    pub const OCHRE: Rgb = [232, 186, 66];
    /// Green.
    pub const LEAF: Rgb = [72, 142, 84];
    /// Light green.
    pub const MINT: Rgb = [150, 200, 150];
    /// Orange.
    pub const ORANGE: Rgb = [226, 134, 60];
    /// Violet.
    pub const PLUM: Rgb = [128, 78, 140];
    /// Brown.
    pub const BROWN: Rgb = [128, 86, 62];
}
