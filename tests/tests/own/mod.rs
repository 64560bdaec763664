//! An ink model of a tool's own, and a foreign tool's slices.

use std::path::Path;

use pellucid::refine::InkModel;

/// Greys only.
pub struct BlackAndWhite {
    pub black: u8,
    pub white: u8,
}

impl InkModel for BlackAndWhite {
    fn labels(&self) -> &[u8] {
        // Most absorbing first, white last.
        if self.black == 4 && self.white == 5 { &[4, 5] } else { &[1, 2] }
    }

    fn fractions(&self, rgb: [f32; 3], fractions: &mut [f32]) -> [f32; 3] {
        let light = (rgb.iter().sum::<f32>() / 3.0).clamp(0.05, 1.0);
        fractions.copy_from_slice(&[1.0 - light, light]);
        self.color(fractions)
    }

    fn color(&self, fractions: &[f32]) -> [f32; 3] {
        [0.05 + 0.95 * fractions[1]; 3]
    }
}

/// A stack of plain RGB pictures as another tool writes them: a cyan block with a magenta face, in white.
pub fn foreign_stack(prefix: &Path) -> std::io::Result<tempfile::TempDir> {
    let folder = tempfile::tempdir()?;
    let (width, height) = (24u32, 12u32);
    for z in 0..30 {
        let file = folder.path().join(format!("{}{z}.png", prefix.display()));
        let mut encoder = png::Encoder::new(std::fs::File::create(file)?, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let pixel = |x: u32, y: u32| match (x, y) {
            (2..=21, 2) => [236, 0, 140],
            (2..=4, 3..=9) => [0, 174, 239],
            (5..=21, 3..=9) => [255, 255, 255],
            _ => [0, 0, 0],
        };
        let data: Vec<u8> = (0..width * height).flat_map(|i| pixel(i % width, i / width)).collect();
        encoder.write_header()?.write_image_data(&data)?;
    }
    Ok(folder)
}
