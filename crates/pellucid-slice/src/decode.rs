//! Reading PNG files without trust in what they claim.

use std::fs::{self, File};
use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use pellucid_core::FileError;
use png::{Decoder, DecodingError, Reader, Transformations};

use crate::SliceError;

/// Deflate packs at most this many bytes into one.
pub(crate) const MAX_DEFLATE_RATIO: u64 = 1032;

/// What a PNG file says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Header {
    pub size: [u32; 2],
    pub color: png::ColorType,
    pub depth: png::BitDepth,
    pub interlaced: bool,
}

impl Header {
    /// Reads a file's header only.
    pub fn read(path: &Path) -> Result<Self, SliceError> {
        let file = File::open(path).map_err(FileError::at("read", path))?;
        let mut decoder = Decoder::new(BufReader::with_capacity(64, file));
        Ok(Self::of(decoder.read_header_info().map_err(unreadable(path))?))
    }

    fn of(info: &png::Info<'_>) -> Self {
        Self {
            size: [info.width, info.height],
            color: info.color_type,
            depth: info.bit_depth,
            interlaced: info.interlaced,
        }
    }

    /// Length of a file, if one of that length can hold the image that the header claims.
    pub fn check_file(&self, path: &Path) -> Result<u64, SliceError> {
        let length = fs::metadata(path).map_err(FileError::at("read", path))?.len();
        self.check_length(length, path)
    }

    /// The length again, if so many bytes can hold the image that the header claims.
    pub fn check_length(&self, length: u64, path: &Path) -> Result<u64, SliceError> {
        let [width, height] = self.size.map(u64::from);
        let bits = width * self.color.samples() as u64 * self.depth as u64;
        // A filter byte a row.
        let raw = height.saturating_mul(bits.div_ceil(8) + 1);
        if length.saturating_mul(MAX_DEFLATE_RATIO) < raw || length > raw.saturating_add(raw / 8 + (1 << 20))
        {
            let reason = format!("has {length} bytes, which cannot be an image of {width} x {height} pixels");
            return Err(SliceError::file(path, reason));
        }
        Ok(length)
    }
}

/// An image of which rows are read.
pub(crate) struct Image {
    pub path: PathBuf,
    reader: Reader<Cursor<Vec<u8>>>,
}

impl Image {
    /// Opens an image that must have a header, its samples transformed.
    pub fn open(path: &Path, header: Header, transformations: Transformations) -> Result<Self, SliceError> {
        let length = header.check_file(path)?;
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(length).read_to_end(&mut bytes))
            .map_err(FileError::at("read", path))?;
        Self::of_bytes(bytes, path, header, transformations)
    }

    /// The same of a file's bytes; `path` is what errors call it.
    pub fn of_bytes(
        bytes: Vec<u8>,
        path: &Path,
        header: Header,
        transformations: Transformations,
    ) -> Result<Self, SliceError> {
        let mut decoder = Decoder::new(Cursor::new(bytes));
        decoder.set_transformations(transformations);
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        decoder.ignore_checksums(false);
        let found = Header::of(decoder.read_header_info().map_err(unreadable(path))?);
        if found.size != header.size {
            let ([w, h], [width, height]) = (found.size, header.size);
            let reason = format!("is {w} x {h} pixels, and the stack {width} x {height}");
            return Err(SliceError::file(path, reason));
        }
        if found != header {
            let kind = |h: &Header| {
                let interlaced = if h.interlaced { ", interlaced" } else { "" };
                format!("{:?} with {} bits{interlaced}", h.color, h.depth as u8)
            };
            let reason = format!("is {}, and must be {}", kind(&found), kind(&header));
            return Err(SliceError::file(path, reason));
        }
        let reader = decoder.read_info().map_err(unreadable(path))?;
        // The decoder panics where it expands such a one.
        if reader.info().palette.as_ref().is_some_and(|palette| !palette.len().is_multiple_of(3)) {
            return Err(SliceError::file(path, "is not a readable PNG: its palette ends within a colour"));
        }
        Ok(Self { path: path.to_owned(), reader })
    }

    /// Samples a pixel of the rows.
    pub fn samples(&self) -> usize {
        self.reader.output_color_type().0.samples()
    }

    /// The next row's samples, number `row`.
    pub fn row(&mut self, row: u32) -> Result<&[u8], SliceError> {
        let path = &self.path;
        match self.reader.next_row() {
            Ok(Some(line)) => Ok(line.data()),
            Ok(None) => Err(SliceError::file(path, format!("ends before row {row}"))),
            Err(error) => Err(SliceError::file(path, format!("row {row}: {error}"))),
        }
    }

    /// Checks what follows the last row.
    pub fn finish(&mut self) -> Result<(), SliceError> {
        self.reader.finish().map_err(|e| SliceError::file(&self.path, format!("after the last row: {e}")))
    }
}

fn unreadable(path: &Path) -> impl Fn(DecodingError) -> SliceError {
    move |error| match error {
        DecodingError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            FileError::at("read", path)(source).into()
        }
        other => SliceError::file(path, format!("is not a readable PNG: {other}")),
    }
}
