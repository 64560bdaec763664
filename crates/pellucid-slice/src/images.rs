//! Stacks of images of other tools, without a manifest.

use std::collections::{BTreeMap, btree_map::Entry};
use std::path::PathBuf;
use std::sync::Mutex;

use pellucid_core::Fault;
use pellucid_voxel::{AIR, Control, Frame, LabelGrid, MaterialTable, Pitch};
use png::{BitDepth, Transformations};
use rayon::prelude::*;

use crate::decode::{Header, Image};
use crate::slab::{LayerRows, read_layers};
use crate::{PrintTarget, RowOrder, SliceError};

/// So many different unknown colours are kept of each layer.
const KEPT: usize = 64;
/// So many of them are told.
const TOLD: usize = 8;

/// What the images of a stack do not say of themselves: the voxels' size and which colour is which material.
///
/// ```
/// use pellucid_slice::{ImageStack, PrintTarget};
/// use pellucid_voxel::{MaterialTable, Pitch};
/// // White on black, as a mask.
/// let mask = ImageStack::new(Pitch::new([0.05; 3])?, [([0, 0, 0, 255], 0), ([255; 4], 5)])?.with_tolerance(100)?;
/// // A printer's colours.
/// let slices = ImageStack::for_target(&PrintTarget::j750(), &MaterialTable::cmykw())?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ImageStack {
    pitch: Pitch,
    origin_mm: [f64; 3],
    row_order: RowOrder,
    colors: BTreeMap<[u8; 4], u8>,
    tolerance: u8,
}

impl ImageStack {
    /// Voxels of a pitch, and the label of each RGBA colour; label 0 is air, and so is whatever has alpha 0. Grey and
    /// colours without alpha have alpha 255. The lower corner lies at 0, the first row holds the highest y.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when no colour stands for a material, one stands for two labels, or a material's has
    /// alpha 0.
    pub fn new(pitch: Pitch, colors: impl IntoIterator<Item = ([u8; 4], u8)>) -> Result<Self, SliceError> {
        let mut labels = BTreeMap::new();
        for (rgba, label) in colors {
            if rgba[3] == 0 && label != AIR {
                let reason = format!("{rgba:?} has alpha 0, which is air, and cannot be label {label}");
                return Err(SliceError::invalid("colours", reason));
            }
            match labels.entry(rgba) {
                Entry::Vacant(entry) => drop(entry.insert(label)),
                Entry::Occupied(entry) if *entry.get() == label => {}
                Entry::Occupied(entry) => {
                    let reason = format!("{rgba:?} stands for both label {} and label {label}", entry.get());
                    return Err(SliceError::invalid("colours", reason));
                }
            }
        }
        if labels.values().all(|&label| label == AIR) {
            return Err(SliceError::invalid("colours", "none stands for a material"));
        }
        Ok(Self {
            pitch,
            origin_mm: [0.0; 3],
            row_order: RowOrder::HighestYFirst,
            colors: labels,
            tolerance: 0,
        })
    }

    /// Pitch, row order and colours of a print target, for those of its materials that a table has. Its background is
    /// air with and without alpha.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when the table has none of the palette's materials.
    pub fn for_target(target: &PrintTarget, materials: &MaterialTable) -> Result<Self, SliceError> {
        let known =
            target.palette().iter().filter_map(|(name, &rgba)| Some((rgba, materials.label_of(name)?)));
        let [r, g, b, _] = target.background();
        let air = [(target.background(), AIR), ([r, g, b, 255], AIR)];
        Ok(Self::new(target.pitch(), known.chain(air))?.with_row_order(target.row_order()))
    }

    /// The same with the lower corner of the first layer's corner voxel at another place, in millimetres.
    pub fn with_origin_mm(mut self, origin_mm: [f64; 3]) -> Self {
        self.origin_mm = origin_mm;
        self
    }

    /// The same with the other end of the y axis in the first row.
    pub fn with_row_order(mut self, row_order: RowOrder) -> Self {
        self.row_order = row_order;
        self
    }

    /// The same where a colour may differ by a distance of up to `tolerance`, in 8-bit RGBA, from the one that it
    /// stands for, for images that went through lossy tools.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when a colour could then stand for two labels.
    pub fn with_tolerance(mut self, tolerance: u8) -> Result<Self, SliceError> {
        let reach = 4 * u32::from(tolerance) * u32::from(tolerance);
        let colors: Vec<_> = self.colors.iter().collect();
        for (i, (a, label)) in colors.iter().enumerate() {
            if let Some((b, _)) = colors[..i].iter().find(|(b, l)| l != label && distance(a, b) <= reach) {
                let most = (f64::from(distance(a, b)).sqrt() / 2.0).ceil() - 1.0;
                let fault = Fault::new("tolerance", format!("{tolerance} makes {a:?} and {b:?} overlap"))
                    .remedy(format!("at most {most} keeps these apart"));
                return Err(SliceError::Invalid(fault));
            }
        }
        self.tolerance = tolerance;
        Ok(self)
    }

    /// The label a colour stands for.
    fn label_of(&self, rgba: [u8; 4]) -> Option<u8> {
        if let Some(&label) = self.colors.get(&rgba) {
            return Some(label);
        }
        if rgba[3] == 0 {
            return Some(AIR);
        }
        let reach = u32::from(self.tolerance) * u32::from(self.tolerance);
        let near = self.colors.iter().find(|(color, _)| distance(color, &rgba) <= reach);
        near.map(|(_, &label)| label)
    }
}

/// Square of the distance of two colours.
fn distance(a: &[u8; 4], b: &[u8; 4]) -> u32 {
    a.iter().zip(b).map(|(&a, &b)| u32::from(a.abs_diff(b)).pow(2)).sum()
}

/// Reads images, the lowest layer first, as [`crate::list_images`] gives them, into a label grid of one voxel a pixel.
///
/// PNG files with up to 8 bits a sample: grey, RGB or indexed, with or without alpha. Nothing is allocated for a size
/// that a file's length cannot hold. All images are read before unknown colours are told, with how often they are
/// found and where first. Memory: the grid, and per thread the compressed files of 16 layers. Progress counts layers.
///
/// # Errors
/// [`SliceError::Invalid`] for no images, images of several sizes, files that are damaged or no PNG, and unknown
/// colours; [`SliceError::Unsupported`] for 16 bits a sample, interlaced images, and more than a grid holds;
/// [`SliceError::Io`]; [`SliceError::Cancelled`].
pub fn read_images(
    files: &[PathBuf],
    stack: &ImageStack,
    control: &Control<'_>,
) -> Result<LabelGrid, SliceError> {
    let headers = files
        .par_iter()
        .map(|path| {
            control.check()?;
            let header = Header::read(path)?;
            check_kind(&header).map_err(|error| error.in_file(path))?;
            header.check_file(path)?;
            Ok(header)
        })
        .collect::<Result<Vec<_>, SliceError>>()?;
    let Some(first) = headers.first() else {
        return Err(SliceError::invalid("images", "there are none; a stack has at least one layer"));
    };
    if let Some(at) = headers.iter().position(|h| h.size != first.size) {
        let ([w, h], [width, height]) = (headers[at].size, first.size);
        let reason = format!("is {w} x {h} pixels, and {} {width} x {height}", files[0].display());
        return Err(SliceError::file(&files[at], reason));
    }
    let [width, height] = first.size;
    let layers = u32::try_from(files.len()).unwrap_or(u32::MAX);
    let frame = Frame::new(stack.origin_mm, stack.pitch, [width, height, layers])?;
    let unknown = Mutex::new(Vec::new());
    let open = |layer: u32| {
        let at = layer as usize;
        let image = Image::open(&files[at], headers[at], Transformations::EXPAND)?;
        Ok(ForeignLayer { image, stack, layer, strange: Strange::default(), unknown: &unknown })
    };
    let grid = read_layers(frame, layers, stack.row_order, open, control)?;
    let mut unknown = unknown.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
    unknown.sort_by_key(|(layer, _)| *layer);
    if unknown.is_empty() { Ok(grid) } else { Err(unknown_colors(files, &unknown)) }
}

fn check_kind(header: &Header) -> Result<(), SliceError> {
    let unsupported =
        |reason: &str, remedy: &str| Err(SliceError::Unsupported(Fault::new("image", reason).remedy(remedy)));
    if header.depth == BitDepth::Sixteen {
        return unsupported("has 16 bits a sample", "save it with 8");
    }
    if header.interlaced {
        return unsupported("is interlaced", "save it without");
    }
    Ok(())
}

/// Colours of a layer that stand for nothing: number of pixels, and where the first is.
#[derive(Default)]
struct Strange {
    colors: BTreeMap<[u8; 4], (u64, [u32; 2])>,
    /// Pixels of colours past those that are kept.
    others: u64,
}

impl Strange {
    fn add(&mut self, rgba: [u8; 4], at: [u32; 2]) {
        let room = self.colors.len() < KEPT;
        match self.colors.entry(rgba) {
            Entry::Occupied(mut entry) => entry.get_mut().0 += 1,
            Entry::Vacant(entry) if room => drop(entry.insert((1, at))),
            Entry::Vacant(_) => self.others += 1,
        }
    }
}

/// One image of another tool.
struct ForeignLayer<'a> {
    image: Image,
    stack: &'a ImageStack,
    layer: u32,
    strange: Strange,
    unknown: &'a Mutex<Vec<(u32, Strange)>>,
}

impl LayerRows for ForeignLayer<'_> {
    fn read_row(&mut self, row: u32, labels: &mut [u8]) -> Result<(), SliceError> {
        let samples = self.image.samples();
        let mut last = ([0; 4], self.stack.label_of([0; 4]));
        for (x, (pixel, out)) in self.image.row(row)?.chunks_exact(samples).zip(labels).enumerate() {
            let rgba = match *pixel {
                [v] => [v, v, v, 255],
                [v, a] => [v, v, v, a],
                [r, g, b] => [r, g, b, 255],
                [r, g, b, a] => [r, g, b, a],
                _ => [0; 4],
            };
            if rgba != last.0 {
                last = (rgba, self.stack.label_of(rgba));
            }
            *out = last.1.unwrap_or_else(|| {
                self.strange.add(rgba, [x as u32, row]);
                AIR
            });
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<(), SliceError> {
        self.image.finish()?;
        if !self.strange.colors.is_empty() {
            let mut unknown = self.unknown.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            unknown.push((self.layer, std::mem::take(&mut self.strange)));
        }
        Ok(())
    }
}

/// Names the most frequent unknown colours of all layers, with the file and pixel of the first of each.
fn unknown_colors(files: &[PathBuf], layers: &[(u32, Strange)]) -> SliceError {
    let mut all: BTreeMap<[u8; 4], (u64, u32, [u32; 2])> = BTreeMap::new();
    let mut pixels = 0;
    for (layer, strange) in layers {
        pixels += strange.others;
        for (&rgba, &(count, at)) in &strange.colors {
            pixels += count;
            all.entry(rgba).or_insert((0, *layer, at)).0 += count;
        }
    }
    let mut all: Vec<_> = all.into_iter().collect();
    all.sort_by_key(|(_, (count, layer, at))| (std::cmp::Reverse(*count), *layer, at[1], at[0]));
    let told = all.iter().take(TOLD).map(|(rgba, (count, layer, [x, y]))| {
        format!("{rgba:?} {count} times, first in {} at pixel ({x}, {y})", files[*layer as usize].display())
    });
    let mut reason = format!("{pixels} pixels have colours that stand for nothing: ");
    reason.push_str(&told.collect::<Vec<_>>().join("; "));
    if all.len() > TOLD || layers.iter().any(|(_, strange)| strange.others > 0) {
        reason.push_str("; and more colours");
    }
    SliceError::Invalid(Fault::new("images", reason).remedy("give their labels, or a tolerance"))
}
