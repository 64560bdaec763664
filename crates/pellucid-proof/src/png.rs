//! PNG files.

use std::io::{self, Write};
use std::path::Path;

use pellucid_core::{Control, files};

use crate::{ProofError, SrgbImage};

impl SrgbImage {
    /// Writes a PNG stream.
    ///
    /// # Errors
    /// What `out` fails with.
    pub fn encode_png(&self, out: &mut dyn Write) -> io::Result<()> {
        encode(self, out, &Control::none())
    }

    /// Writes a PNG file, whole or not at all. Progress is in rows.
    ///
    /// # Errors
    /// [`ProofError::Io`], [`ProofError::Cancelled`].
    pub fn write_png(&self, path: impl AsRef<Path>, control: &Control<'_>) -> Result<(), ProofError> {
        write(self, path.as_ref(), control)
    }
}

/// What colours are, in the words of ITU-T H.273: primaries of Rec.709 (1), sRGB's curve (13), R, G, B (0), full range (1).
pub(crate) const SRGB_CODE_POINTS: [u8; 4] = [1, 13, 0, 1];

/// Writes a file by way of a temporary one.
fn write(image: &SrgbImage, path: &Path, control: &Control<'_>) -> Result<(), ProofError> {
    control.check()?;
    let written = files::write_whole(path, |out| encode(image, out, control));
    // A cancelled encoder ends with an error of its own, which says less.
    if written.is_err() {
        control.check()?;
    }
    Ok(written?)
}

/// Encodes row by row; a cancelled one ends with an error.
fn encode(image: &SrgbImage, out: &mut dyn Write, control: &Control<'_>) -> io::Result<()> {
    let mut encoder = png::Encoder::new(out, image.width(), image.height());
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    let mut writer = encoder.write_header()?;
    writer.write_chunk(png::chunk::cICP, &SRGB_CODE_POINTS)?;
    let mut stream = writer.stream_writer()?;
    let rows = image.rgba().chunks(image.width() as usize * 4);
    for (y, row) in rows.enumerate() {
        control.check().map_err(io::Error::other)?;
        stream.write_all(row)?;
        control.report(y as u64 + 1, u64::from(image.height()));
    }
    stream.finish()?;
    writer.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Picture;
    use proptest::prelude::*;
    use std::sync::atomic::AtomicBool;

    fn decode(bytes: &[u8]) -> SrgbImage {
        let mut reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Rgba, png::BitDepth::Eight));
        pixels.truncate(info.buffer_size());
        SrgbImage::new(info.width, info.height, pixels).unwrap()
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(width in 1u32..40, height in 1u32..40, seed in any::<u32>()) {
            let values = (0..width * height * 4).map(|i| (i.wrapping_add(seed).wrapping_mul(0x9e37_79b9) >> 24) as u8);
            let image = SrgbImage::new(width, height, values.collect()).unwrap();
            let mut bytes = Vec::new();
            image.encode_png(&mut bytes).unwrap();
            prop_assert_eq!(decode(&bytes), image);
        }
    }

    #[test]
    fn a_picture_read_back_is_srgb_of_its_values() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        // Linear values of sRGB 128 and 188, by IEC 61966-2-1.
        let picture = Picture::new(2, 1, vec![0.21586, 0.50289, 1.7, 1.0, -0.2, 0.0033, 1.0, 0.25]).unwrap();
        picture.write_png(&path, &Control::none()).unwrap();
        let read = decode(&std::fs::read(&path).unwrap());
        assert_eq!(read.pixel(0, 0), Some([128, 188, 255, 255]));
        assert_eq!(read.pixel(1, 0), Some([0, 11, 255, 64]));
    }

    #[test]
    fn a_file_says_that_it_is_srgb() {
        let mut bytes = Vec::new();
        SrgbImage::new(1, 1, vec![1, 2, 3, 255]).unwrap().encode_png(&mut bytes).unwrap();
        let reader = png::Decoder::new(io::Cursor::new(bytes)).read_info().unwrap();
        let info = reader.info();
        assert_eq!(info.srgb, Some(png::SrgbRenderingIntent::RelativeColorimetric));
        let points = info.coding_independent_code_points.unwrap();
        assert_eq!((points.color_primaries, points.transfer_function), (1, 13));
        assert_eq!((points.matrix_coefficients, points.is_video_full_range_image), (0, true));
    }

    #[test]
    fn a_cancelled_or_failed_file_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let image = SrgbImage::new(300, 200, vec![7; 240_000]).unwrap();
        let stop = AtomicBool::new(false);
        let cut = |done: u64, _: u64| stop.store(done == 50, std::sync::atomic::Ordering::Relaxed);
        let control = Control::none().with_cancel(&stop).with_progress(&cut);
        let error = image.write_png(folder.path().join("a.png"), &control).unwrap_err();
        assert!(matches!(error, ProofError::Cancelled), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let error = image.write_png(folder.path().join("none/a.png"), &Control::none()).unwrap_err();
        assert!(matches!(error, ProofError::Io(_)));
    }
}
