//! One layer of labels as one PNG.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use pellucid_core::{Control, FileError};
use png::{BitDepth, ColorType, DeflateCompression, EncodingError, Filter, PixelDimensions, Unit};

use crate::{Manifest, RowOrder, SliceError};

/// What every image of a stack has in common.
pub(crate) struct LayerFormat {
    pub width: u32,
    pub height: u32,
    pub dpi: [f64; 2],
    pub rows: RowOrder,
    /// RGBA of every label.
    pub colors: [[u8; 4]; 256],
}

impl LayerFormat {
    /// The images of a stack.
    pub fn of(manifest: &Manifest) -> Self {
        let mut colors = [manifest.background; 256];
        for m in &manifest.materials {
            colors[usize::from(m.label)] = m.rgba;
        }
        let ([width, height, _], [x, y, _]) = (manifest.size, manifest.dpi);
        Self { width, height, dpi: [x, y], rows: manifest.row_order, colors }
    }

    /// Writes a layer of labels, ordered `[y][x]`, as an RGBA PNG with its resolution in `pHYs`.
    ///
    /// The bytes depend on the arguments only. Rows are not filtered: labels of a halftone do not
    /// predict each other, and repeated four-byte pixels are what deflate finds by itself.
    ///
    /// # Errors
    /// [`SliceError::Io`], and [`SliceError::Cancelled`] within a row.
    pub fn write(&self, labels: &[u8], path: &Path, control: &Control<'_>) -> Result<(), SliceError> {
        let file = File::create(path).map_err(FileError::at("create", path))?;
        let mut file = BufWriter::with_capacity(1 << 16, file);
        self.encode_to(labels, &mut file, path, control)?;
        file.flush().map_err(|e| FileError::at("write", path)(e).into())
    }

    /// The same to a writer; `path` is what errors call it.
    pub fn encode_to(
        &self,
        labels: &[u8],
        out: impl Write,
        path: &Path,
        control: &Control<'_>,
    ) -> Result<(), SliceError> {
        self.encode(labels, out, control).map_err(|error| match error {
            _ if control.cancelled() => SliceError::Cancelled,
            EncodingError::IoError(source) => FileError::at("write", path)(source).into(),
            other => SliceError::file(path, other.to_string()),
        })
    }

    fn encode(&self, labels: &[u8], out: impl Write, control: &Control<'_>) -> Result<(), EncodingError> {
        let mut encoder = png::Encoder::new(out, self.width, self.height);
        encoder.set_color(ColorType::Rgba);
        encoder.set_depth(BitDepth::Eight);
        let per_metre = |dpi: f64| (dpi / 0.0254).round() as u32;
        encoder.set_pixel_dims(Some(PixelDimensions {
            xppu: per_metre(self.dpi[0]),
            yppu: per_metre(self.dpi[1]),
            unit: Unit::Meter,
        }));
        encoder.set_deflate_compression(DeflateCompression::Level(1));
        encoder.set_filter(Filter::NoFilter);
        let mut writer = encoder.write_header()?;
        let mut stream = writer.stream_writer_with_size(1 << 18)?;
        let width = self.width as usize;
        let mut pixels = vec![0u8; width * 4];
        for row in 0..self.height {
            control.check().map_err(std::io::Error::other)?;
            let y = self.rows.y_of_row(row, self.height) as usize;
            let line = &labels[y * width..(y + 1) * width];
            for (pixel, &label) in pixels.chunks_exact_mut(4).zip(line) {
                pixel.copy_from_slice(&self.colors[usize::from(label)]);
            }
            stream.write_all(&pixels)?;
        }
        stream.finish()?;
        writer.finish()
    }
}
