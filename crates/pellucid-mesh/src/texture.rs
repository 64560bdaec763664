//! Linear-light texture look-up: sRGB decoding, wrap modes, mip chain, anisotropic footprints.

use std::sync::{Arc, LazyLock};

use rayon::prelude::*;

use crate::MeshError;

/// How a coordinate outside 0..1 maps to the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Wrap {
    /// The image repeats.
    #[default]
    Repeat,
    /// The image repeats, every second copy mirrored.
    Mirrored,
    /// The edge texels extend outwards.
    Clamp,
}

/// How texels of one level are combined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Filter {
    /// The nearest texel.
    Nearest,
    /// Bilinear.
    #[default]
    Linear,
}

/// How levels of the mip chain are combined when the footprint is larger than a texel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Mip {
    /// The nearest level.
    Nearest,
    /// Between the two nearest levels.
    ///
    /// glTF's modes without a mip chain map to this too: they save time on a screen, while a
    /// print would only show the aliasing.
    #[default]
    Linear,
}

/// Wrap and filter modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Sampler {
    /// Wrap mode along u.
    pub wrap_u: Wrap,
    /// Wrap mode along v.
    pub wrap_v: Wrap,
    /// Filter when the footprint is at most one texel.
    pub magnify: Filter,
    /// Filter within a level when the footprint is larger than one texel.
    pub minify: Filter,
    /// Filter between levels.
    pub mip: Mip,
}

/// Most probes along the long axis of an anisotropic footprint.
const MAX_PROBES: f64 = 16.0;

static SRGB_TO_LINEAR: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f64 / 255.0) as f32));

pub(crate) fn srgb_to_linear(s: f64) -> f64 {
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

#[derive(Debug, Clone, PartialEq)]
enum Texels {
    /// sRGB-encoded, 8 bits a channel.
    Srgb8(Vec<[u8; 3]>),
    /// Linear, 16 bits a channel.
    Linear16(Vec<[u16; 3]>),
    /// Linear, the same in every channel.
    Grey8(Vec<u8>),
}

#[derive(Debug, Clone, PartialEq)]
struct Level {
    width: u32,
    height: u32,
    texels: Texels,
}

impl Level {
    fn texel(&self, x: u32, y: u32) -> [f64; 3] {
        let i = y as usize * self.width as usize + x as usize;
        match &self.texels {
            Texels::Srgb8(t) => t[i].map(|c| f64::from(SRGB_TO_LINEAR[usize::from(c)])),
            Texels::Linear16(t) => t[i].map(|c| f64::from(c) / 65535.0),
            Texels::Grey8(t) => [f64::from(t[i]) / 255.0; 3],
        }
    }

    /// The next level: half the size, each texel the area-weighted mean of what it covers.
    fn halved(&self) -> Level {
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let columns: Vec<_> = (0..width).map(|x| taps(x, self.width, width)).collect();
        let mut texels = vec![[0; 3]; width as usize * height as usize];
        texels.par_chunks_mut(width as usize).zip(0..height).for_each(|(row, y)| {
            let (top, heights) = taps(y, self.height, height);
            for (texel, (left, widths)) in row.iter_mut().zip(&columns) {
                let mut sum = [0.0; 3];
                for (dy, wy) in heights.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                    for (dx, wx) in widths.iter().enumerate().filter(|(_, w)| **w > 0.0) {
                        let t = self.texel(left + dx as u32, top + dy as u32);
                        (0..3).for_each(|c| sum[c] += wx * wy * t[c]);
                    }
                }
                *texel = sum.map(|c| (c * 65535.0).round() as u16);
            }
        });
        let texels = match self.texels {
            Texels::Grey8(_) => {
                Texels::Grey8(texels.iter().map(|t| ((u32::from(t[0]) + 128) / 257) as u8).collect())
            }
            _ => Texels::Linear16(texels),
        };
        Level { width, height, texels }
    }
}

/// First source texel and weights of target texel `i` when `from` texels become `to`.
fn taps(i: u32, from: u32, to: u32) -> (u32, [f64; 4]) {
    let scale = f64::from(from) / f64::from(to);
    let (start, end) = (f64::from(i) * scale, (f64::from(i) + 1.0) * scale);
    let first = start.floor() as u32;
    let weights = std::array::from_fn(|k| {
        let texel = f64::from(first) + k as f64;
        if first as usize + k >= from as usize {
            return 0.0;
        }
        ((end.min(texel + 1.0) - start.max(texel)) / scale).max(0.0)
    });
    (first, weights)
}

/// An image with its mip chain; shared by the textures that differ in the sampler only.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    levels: Vec<Level>,
}

impl Image {
    /// From sRGB texels `[y][x]`, row 0 at v = 0.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] if a side is 0 or the length is not width x height.
    pub fn from_srgb8(width: u32, height: u32, texels: Vec<[u8; 3]>) -> Result<Self, MeshError> {
        Self::new(width, height, texels.len(), Texels::Srgb8(texels))
    }

    /// From linear texels `[y][x]` (65535 is 1), row 0 at v = 0.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] if a side is 0 or the length is not width x height.
    pub fn from_linear16(width: u32, height: u32, texels: Vec<[u16; 3]>) -> Result<Self, MeshError> {
        Self::new(width, height, texels.len(), Texels::Linear16(texels))
    }

    /// From linear grey texels `[y][x]` (255 is 1), row 0 at v = 0: opacities, read as three equal channels.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] if a side is 0 or the length is not width x height.
    pub fn from_linear_grey8(width: u32, height: u32, texels: Vec<u8>) -> Result<Self, MeshError> {
        Self::new(width, height, texels.len(), Texels::Grey8(texels))
    }

    fn new(width: u32, height: u32, len: usize, texels: Texels) -> Result<Self, MeshError> {
        if width == 0 || height == 0 || (width as usize).checked_mul(height as usize) != Some(len) {
            return Err(MeshError::invalid(
                "texture",
                "texels",
                format!("{len} texels for {width} x {height}"),
                "give width x height texels, both sides at least 1",
            ));
        }
        let mut levels = vec![Level { width, height, texels }];
        while let Some(last) = levels.last().filter(|l| l.width > 1 || l.height > 1) {
            let next = last.halved();
            levels.push(next);
        }
        Ok(Self { levels })
    }

    /// Upper bound on the bytes of an image of this size with its mip chain.
    pub fn bytes(width: u32, height: u32, sixteen_bit: bool) -> u64 {
        let pixels = u64::from(width) * u64::from(height);
        // Each level has at most a quarter of the one above, or half of it once a side is 1.
        let chain = pixels.div_ceil(3) + u64::from(width.max(height));
        pixels * if sixteen_bit { 6 } else { 3 } + chain * 6
    }

    /// Upper bound on the bytes of an image of grey texels with its mip chain.
    pub fn grey_bytes(width: u32, height: u32) -> u64 {
        Self::bytes(width, height, true) / 6 + 1
    }

    /// Width and height of level 0 in texels.
    pub fn size(&self) -> [u32; 2] {
        [self.levels[0].width, self.levels[0].height]
    }
}

/// An image with wrap and filter modes, read in linear Rec.709.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    image: Arc<Image>,
    sampler: Sampler,
}

impl Texture {
    /// An image seen through a sampler.
    pub fn new(image: Arc<Image>, sampler: Sampler) -> Self {
        Self { image, sampler }
    }

    /// Width and height in texels.
    pub fn size(&self) -> [u32; 2] {
        self.image.size()
    }

    /// Adds sampler and texels to a digest.
    pub(crate) fn add_to(&self, digest: &mut pellucid_core::Digest) {
        let s = self.sampler;
        digest.add(&[s.wrap_u as u8, s.wrap_v as u8, s.magnify as u8, s.minify as u8, s.mip as u8]);
        self.size().iter().for_each(|side| digest.add(&side.to_le_bytes()));
        match &self.image.levels[0].texels {
            Texels::Srgb8(texels) => texels.iter().for_each(|texel| digest.add(texel)),
            Texels::Linear16(texels) => {
                texels.iter().flatten().for_each(|v| digest.add(&v.to_le_bytes()));
            }
            Texels::Grey8(texels) => digest.add(texels),
        }
    }

    /// Wrap and filter modes.
    pub fn sampler(&self) -> Sampler {
        self.sampler
    }

    /// Linear RGB at `uv` (v = 0 is the first row), averaged over a footprint `footprint_texels`
    /// wide and high; 0 reads a point.
    pub fn sample(&self, uv: [f32; 2], footprint_texels: f64) -> [f32; 3] {
        let p = self.texel_position(uv);
        self.lookup(p, footprint_texels).map(|c| c as f32)
    }

    /// Linear RGB at `uv`, averaged over the parallelogram-like footprint whose two half axes
    /// reach `axes[0]` and `axes[1]` (each a change of `[u, v]`, full width of the footprint).
    ///
    /// The long axis takes up to 16 probes, each filtered over the short axis.
    pub fn sample_anisotropic(&self, uv: [f32; 2], axes: [[f64; 2]; 2]) -> [f32; 3] {
        let p = self.texel_position(uv);
        let size = self.size().map(f64::from);
        let texel_axes = axes.map(|a| [a[0] * size[0], a[1] * size[1]]);
        let (major, minor) = principal_axes(texel_axes);
        let long = major[0].hypot(major[1]);
        if !(long.is_finite() && minor.is_finite() && long > 0.0) {
            let width = if long.is_nan() || minor.is_nan() { 0.0 } else { long };
            return self.lookup(p, width).map(|c| c as f32);
        }
        // Narrower probes than a texel only repeat what the filter within a level does.
        let probes = (long / minor.max(1.0)).ceil().clamp(1.0, MAX_PROBES);
        let width = minor.max(long / probes);
        let mut sum = [0.0; 3];
        for k in 0..probes as u32 {
            let t = (f64::from(k) + 0.5) / probes - 0.5;
            let texel = self.lookup([p[0] + t * major[0], p[1] + t * major[1]], width);
            (0..3).for_each(|c| sum[c] += texel[c]);
        }
        sum.map(|c| (c / probes) as f32)
    }

    /// Position in texels of level 0; a position that is not finite reads the origin.
    fn texel_position(&self, uv: [f32; 2]) -> [f64; 2] {
        let size = self.size();
        std::array::from_fn(|i| {
            let u = f64::from(uv[i]);
            if u.is_finite() { u * f64::from(size[i]) } else { 0.0 }
        })
    }

    /// Linear RGB at a position in texels of level 0 for a footprint of `width` texels.
    fn lookup(&self, p: [f64; 2], width: f64) -> [f64; 3] {
        if width <= 1.0 {
            return self.within(0, p, self.sampler.magnify);
        }
        let last = self.image.levels.len() - 1;
        let lod = width.log2().min(last as f64);
        match self.sampler.mip {
            Mip::Nearest => {
                self.within((lod + 0.5).floor().min(last as f64) as usize, p, self.sampler.minify)
            }
            Mip::Linear => {
                let fine = lod.floor() as usize;
                let t = lod - fine as f64;
                let a = self.within(fine, p, self.sampler.minify);
                if t == 0.0 {
                    return a;
                }
                let b = self.within((fine + 1).min(last), p, self.sampler.minify);
                std::array::from_fn(|c| a[c] + t * (b[c] - a[c]))
            }
        }
    }

    /// One level, `p` in texels of level 0.
    fn within(&self, level: usize, p: [f64; 2], filter: Filter) -> [f64; 3] {
        let base = self.size();
        let l = &self.image.levels[level];
        let x = p[0] * f64::from(l.width) / f64::from(base[0]);
        let y = p[1] * f64::from(l.height) / f64::from(base[1]);
        let column = |i: f64| wrap(i, l.width, self.sampler.wrap_u);
        let row = |i: f64| wrap(i, l.height, self.sampler.wrap_v);
        match filter {
            Filter::Nearest => l.texel(column(x.floor()), row(y.floor())),
            Filter::Linear => {
                let (x0, y0) = ((x - 0.5).floor(), (y - 0.5).floor());
                let (tx, ty) = (x - 0.5 - x0, y - 0.5 - y0);
                let (c0, c1, r0, r1) = (column(x0), column(x0 + 1.0), row(y0), row(y0 + 1.0));
                let (a, b) = (l.texel(c0, r0), l.texel(c1, r0));
                let (c, d) = (l.texel(c0, r1), l.texel(c1, r1));
                std::array::from_fn(|k| {
                    let top = a[k] + tx * (b[k] - a[k]);
                    let bottom = c[k] + tx * (d[k] - c[k]);
                    top + ty * (bottom - top)
                })
            }
        }
    }
}

/// Texel index of the whole number `i` under a wrap mode; `size` is at least 1.
fn wrap(i: f64, size: u32, mode: Wrap) -> u32 {
    let n = f64::from(size);
    let wrapped = match mode {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Mirrored => {
            let m = i.rem_euclid(2.0 * n);
            if m < n { m } else { 2.0 * n - 1.0 - m }
        }
        Wrap::Clamp => i,
    };
    wrapped.clamp(0.0, n - 1.0) as u32
}

/// Long axis (vector) and short axis (length) of the ellipse spanned by two conjugate axes.
fn principal_axes(axes: [[f64; 2]; 2]) -> ([f64; 2], f64) {
    let [a, b] = axes;
    let (xx, xy, yy) = (a[0] * a[0] + b[0] * b[0], a[0] * a[1] + b[0] * b[1], a[1] * a[1] + b[1] * b[1]);
    let mean = 0.5 * (xx + yy);
    let spread = (0.5 * (xx - yy)).hypot(xy);
    let (large, small) = ((mean + spread).sqrt(), (mean - spread).max(0.0).sqrt());
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    ([large * angle.cos(), large * angle.sin()], small)
}

#[cfg(test)]
mod tests;
