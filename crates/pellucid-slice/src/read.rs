//! Reads a stack of slices back into the label grid it was made from.

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicU64;

use pellucid_voxel::{AIR, Control, LabelGrid, TILE, TILE_VOXELS, Tile};
use png::{BitDepth, ColorType, Decoder, Reader};
use rayon::prelude::*;

use crate::SliceError;
use crate::manifest::{self, Manifest};

/// Deflate packs at most this many bytes into one.
const MAX_DEFLATE_RATIO: u64 = 1032;

/// Reads `manifest.json` and the slices it names from an output folder of [`crate::export()`].
///
/// Labels, frame and voxel counts come back exactly. Every image is checked against the manifest
/// before it is decoded, a file too short or too long for its claimed size is refused before
/// anything is allocated for it, and colours outside the palette, material in the padding layers
/// or voxel counts other than the manifest's are errors. Memory: the grid, and per thread the
/// compressed files of 16 layers. Progress counts layers.
///
/// # Errors
/// [`SliceError::Io`] for a missing file, [`SliceError::Invalid`] naming the file for anything
/// inconsistent or corrupted, [`SliceError::Unsupported`] for a later format,
/// [`SliceError::Cancelled`].
pub fn read_stack(dir: &Path, control: &Control) -> Result<(LabelGrid, Manifest), SliceError> {
    let manifest = Manifest::load(dir)?;
    let stack = Stack::new(dir, &manifest);
    (0..manifest.layers).into_par_iter().try_for_each(|layer| stack.check_length(layer).map(drop))?;
    let total = u64::from(manifest.layers);
    let done = AtomicU64::new(0);
    let slabs = (0..manifest.layers.div_ceil(TILE as u32))
        .into_par_iter()
        .map(|slab| {
            control.check()?;
            let first = slab * TILE as u32;
            let layers = first..manifest.layers.min(first + TILE as u32);
            let count = u64::from(layers.end - layers.start);
            let tiles = stack.read_slab(layers)?;
            control.advance(&done, count, total);
            Ok(tiles)
        })
        .collect::<Result<Vec<Vec<Mutex<Tile>>>, SliceError>>()?;
    let frame = manifest.frame()?;
    let columns = frame.size()[0].div_ceil(TILE as u32) as usize;
    let grid = LabelGrid::from_tiles(frame, |[x, y, z]| {
        let tile = &slabs[z as usize][y as usize * columns + x as usize];
        let mut tile = tile.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        std::mem::replace(&mut *tile, Tile::Constant(AIR))
    });
    let counts = grid.histogram();
    for m in &manifest.materials {
        let found = counts[usize::from(m.label)];
        if found != m.voxels {
            return Err(SliceError::file(
                &dir.join(manifest::MANIFEST_FILE),
                format!("says {} voxels of {:?} and the slices hold {found}; export again", m.voxels, m.name),
            ));
        }
    }
    Ok((grid, manifest))
}

/// The images of one manifest.
struct Stack<'a> {
    dir: &'a Path,
    manifest: &'a Manifest,
    labels: BTreeMap<[u8; 4], u8>,
}

impl<'a> Stack<'a> {
    fn new(dir: &'a Path, manifest: &'a Manifest) -> Self {
        let materials = manifest.materials.iter().map(|m| (m.rgba, m.label));
        Self { dir, manifest, labels: materials.chain([(manifest.background, AIR)]).collect() }
    }

    /// Bytes of an image before compression: four a pixel and a filter byte a row.
    fn raw_bytes(&self) -> u64 {
        let [width, height, _] = self.manifest.size.map(u64::from);
        height * (4 * width + 1)
    }

    /// Whether a file can hold the image the manifest claims.
    fn check_length(&self, layer: u32) -> Result<u64, SliceError> {
        let path = self.manifest.slice_path(self.dir, layer);
        let length = fs::metadata(&path).map_err(SliceError::io("read", &path))?.len();
        let raw = self.raw_bytes();
        if length.saturating_mul(MAX_DEFLATE_RATIO) < raw || length > raw + raw / 8 + (1 << 20) {
            let [width, height, _] = self.manifest.size;
            return Err(SliceError::file(
                &path,
                format!("has {length} bytes, which cannot be an image of {width} x {height} pixels"),
            ));
        }
        Ok(length)
    }

    /// The compressed bytes of a layer, no more than its checked length.
    fn load(&self, layer: u32) -> Result<Vec<u8>, SliceError> {
        let path = self.manifest.slice_path(self.dir, layer);
        let length = self.check_length(layer)?;
        let mut bytes = Vec::new();
        fs::File::open(&path)
            .and_then(|file| file.take(length).read_to_end(&mut bytes))
            .map_err(SliceError::io("read", &path))?;
        Ok(bytes)
    }

    /// Decodes up to 16 layers side by side, a band of tiles at a time, into tiles `[y][x]`.
    fn read_slab(&self, layers: std::ops::Range<u32>) -> Result<Vec<Mutex<Tile>>, SliceError> {
        let [width, height, depth] = self.manifest.size;
        let columns = width.div_ceil(TILE as u32) as usize;
        let bands = height.div_ceil(TILE as u32);
        let files = layers.clone().map(|layer| self.load(layer)).collect::<Result<Vec<_>, _>>()?;
        let mut images = layers
            .clone()
            .zip(&files)
            .map(|(layer, bytes)| Layer::open(self, layer, bytes))
            .collect::<Result<Vec<_>, _>>()?;
        let mut tiles: Vec<Mutex<Tile>> = Vec::new();
        tiles.resize_with(columns * bands as usize, || Mutex::new(Tile::Constant(AIR)));
        // Labels of one band of tiles, ordered [column][z][y][x].
        let mut band = vec![[AIR; TILE_VOXELS]; columns];
        for row in 0..height {
            let y = self.manifest.row_order.y_of_row(row, height);
            for (lz, image) in images.iter_mut().enumerate() {
                image.read_row(self, row, depth, |x, label| {
                    band[x / TILE][(lz * TILE + y as usize % TILE) * TILE + x % TILE] = label;
                })?;
            }
            let next =
                (row + 1 < height).then(|| self.manifest.row_order.y_of_row(row + 1, height) / TILE as u32);
            if next != Some(y / TILE as u32) {
                for (column, labels) in band.iter_mut().enumerate() {
                    if labels.iter().any(|&l| l != AIR) {
                        let tile = &mut tiles[(y / TILE as u32) as usize * columns + column];
                        *tile = Mutex::new(Tile::Dense(Box::new(*labels)));
                        labels.fill(AIR);
                    }
                }
            }
        }
        for image in &mut images {
            image.finish()?;
        }
        Ok(tiles)
    }
}

/// One image being decoded.
struct Layer<'a> {
    path: std::path::PathBuf,
    layer: u32,
    reader: Reader<Cursor<&'a [u8]>>,
}

impl<'a> Layer<'a> {
    /// Reads the header and checks it against the manifest.
    fn open(stack: &Stack, layer: u32, bytes: &'a [u8]) -> Result<Self, SliceError> {
        let path = stack.manifest.slice_path(stack.dir, layer);
        let bad = |e: png::DecodingError| SliceError::file(&path, format!("is not a readable PNG: {e}"));
        let mut decoder = Decoder::new(Cursor::new(bytes));
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        decoder.ignore_checksums(false);
        let info = decoder.read_header_info().map_err(bad)?;
        let [width, height, _] = stack.manifest.size;
        if (info.width, info.height) != (width, height) {
            let reason =
                format!("is {} x {} pixels; the manifest says {width} x {height}", info.width, info.height);
            return Err(SliceError::file(&path, reason));
        }
        if (info.color_type, info.bit_depth, info.interlaced) != (ColorType::Rgba, BitDepth::Eight, false) {
            return Err(SliceError::file(&path, "must be RGBA with 8 bits a channel, not interlaced"));
        }
        let reader = decoder.read_info().map_err(bad)?;
        Ok(Self { path, layer, reader })
    }

    /// Decodes the next row and hands on every x and label.
    fn read_row(
        &mut self,
        stack: &Stack,
        row: u32,
        depth: u32,
        mut put: impl FnMut(usize, u8),
    ) -> Result<(), SliceError> {
        let path = &self.path;
        let pixels = self
            .reader
            .next_row()
            .map_err(|e| SliceError::file(path, format!("row {row}: {e}")))?
            .ok_or_else(|| SliceError::file(path, format!("ends before row {row}")))?;
        let mut last = (stack.manifest.background, AIR);
        for (x, pixel) in pixels.data().chunks_exact(4).enumerate() {
            let rgba = [pixel[0], pixel[1], pixel[2], pixel[3]];
            if rgba != last.0 {
                let label = stack.labels.get(&rgba).ok_or_else(|| {
                    SliceError::file(
                        path,
                        format!("pixel ({x}, {row}) is {rgba:?}, which is no material's colour"),
                    )
                })?;
                last = (rgba, *label);
            }
            if last.1 != AIR {
                if self.layer >= depth {
                    return Err(SliceError::file(
                        path,
                        format!("holds material at pixel ({x}, {row}) above the object"),
                    ));
                }
                put(x, last.1);
            }
        }
        Ok(())
    }

    /// Checks what follows the last row.
    fn finish(&mut self) -> Result<(), SliceError> {
        self.reader.finish().map_err(|e| SliceError::file(&self.path, format!("after the last row: {e}")))
    }
}
