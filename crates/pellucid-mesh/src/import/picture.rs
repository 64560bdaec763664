//! PNG and JPEG (and, with the feature `webp`, WebP) decoding within the limits: header first, pixels after.

use std::io::Cursor;
use std::sync::Arc;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::icc::{Codes, codes_of};
use super::source::{Source, quoted};
use crate::MeshError;
use crate::texture::Image;

pub(super) const PLAIN: &str = "export the model with its textures as PNG or JPEG";

/// What a decoder may allocate beside the pixels.
const DECODER_BYTES: u64 = 64 << 20;

/// A decoded picture.
#[derive(Clone)]
pub(super) struct Decoded {
    pub image: Arc<Image>,
    /// Its alpha, if opacity counts and it is not 1 everywhere.
    pub opacity: Option<Arc<Image>>,
}

/// What the ICC profiles of textures are to a format.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Profiles {
    /// They say what colours are.
    #[cfg_attr(
        not(any(feature = "obj", feature = "ply", feature = "3mf")),
        allow(dead_code, reason = "glTF heeds none, and STL has no textures")
    )]
    Heeded,
    /// Colours are sRGB whatever they say.
    Ignored,
}

/// Decodes an image that errors call `object`, charging its size to `budget` (bytes left for all
/// textures).
pub(super) fn decode(
    source: &Source,
    object: &str,
    bytes: &[u8],
    profiles: Profiles,
    budget: &mut u64,
) -> Result<Decoded, MeshError> {
    let counts = source.options.opacity;
    let (picture, codes) = open(source, object, bytes, profiles, budget, |width, height, color, deep| {
        let alpha = if counts && color.has_alpha() { Image::grey_bytes(width, height) } else { 0 };
        Image::bytes(width, height, deep) + alpha
    })?;
    let (width, height) = (picture.width(), picture.height());
    let opacity = match counts && picture.color().has_alpha() {
        true => alphas(&picture).filter(|a| a.iter().any(|&a| a < u8::MAX)),
        false => None,
    };
    let opacity = opacity.map(|alphas| Image::from_linear_grey8(width, height, alphas)).transpose()?;
    let image = if let Some(codes) = codes {
        // Eight bits times 257 are the same share of sixteen.
        let texels: Vec<[u16; 3]> = picture.into_rgb16().pixels().map(|p| p.0).collect();
        Image::from_linear16(width, height, codes.linear(&texels))
    } else if is_deep(picture.color()) {
        let texels = picture.into_rgb16().pixels().map(|p| p.0.map(linear16)).collect();
        Image::from_linear16(width, height, texels)
    } else {
        let texels = picture.into_rgb8().into_raw();
        let (rgb, _) = texels.as_chunks::<3>();
        Image::from_srgb8(width, height, rgb.to_vec())
    };
    Ok(Decoded { image: Arc::new(image?), opacity: opacity.map(Arc::new) })
}

/// Decodes an image of opacities: its alpha, or its values, as they stand, where it has none.
#[cfg(feature = "obj")]
pub(super) fn decode_opacity(
    source: &Source,
    object: &str,
    bytes: &[u8],
    budget: &mut u64,
) -> Result<Image, MeshError> {
    let cost = |width, height, _, _| Image::grey_bytes(width, height);
    let (picture, _) = open(source, object, bytes, Profiles::Ignored, budget, cost)?;
    let (width, height) = (picture.width(), picture.height());
    let texels = alphas(&picture).unwrap_or_else(|| picture.into_luma8().into_raw());
    Image::from_linear_grey8(width, height, texels)
}

/// The alpha of each pixel, of pictures that have it.
fn alphas(picture: &DynamicImage) -> Option<Vec<u8>> {
    let deep = |v: u16| ((u32::from(v) + 128) / 257) as u8;
    Some(match picture {
        DynamicImage::ImageLumaA8(p) => p.pixels().map(|p| p.0[1]).collect(),
        DynamicImage::ImageRgba8(p) => p.pixels().map(|p| p.0[3]).collect(),
        DynamicImage::ImageLumaA16(p) => p.pixels().map(|p| deep(p.0[1])).collect(),
        DynamicImage::ImageRgba16(p) => p.pixels().map(|p| deep(p.0[3])).collect(),
        _ => return None,
    })
}

fn is_deep(color: ColorType) -> bool {
    matches!(color, ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16)
}

/// Decodes a picture within the limits, and finds what its colours are; `cost` says from its size and kind, and whether it
/// takes sixteen bits, what its textures take.
fn open(
    source: &Source,
    object: &str,
    bytes: &[u8],
    profiles: Profiles,
    budget: &mut u64,
    cost: impl Fn(u32, u32, ColorType, bool) -> u64,
) -> Result<(DynamicImage, Option<Codes>), MeshError> {
    let format = match image::guess_format(bytes) {
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => format,
        Ok(ImageFormat::WebP) if cfg!(feature = "webp") => ImageFormat::WebP,
        other => {
            let reason = match other_format(bytes).or(other.ok().map(|f| f.extensions_str()[0])) {
                Some(name) => format!("the image is of the format {}", quoted(name)),
                None => "the image is neither PNG nor JPEG".to_string(),
            };
            return Err(source.unsupported(object, reason, PLAIN));
        }
    };
    let limits = source.limits;
    let too_large = |reason: String, field: &str| {
        source.unsupported(object, reason, format!("scale the texture down or raise ImportLimits::{field}"))
    };
    let undecodable = |error| match error {
        image::ImageError::Limits(error) => {
            let reason = format!("{error}; the limit is {} pixels a side", limits.texture_edge);
            too_large(reason, "texture_edge")
        }
        other => {
            let reason = format!("the image cannot be decoded: {other}");
            source.invalid(object, reason, "save it again as PNG or JPEG")
        }
    };
    if format == ImageFormat::Png && !palettes_are_whole(bytes) {
        let reason = "the image cannot be decoded: its palette ends within a colour";
        return Err(source.invalid(object, reason, "save it again as PNG or JPEG"));
    }
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut bounds = image::Limits::default();
    bounds.max_image_width = Some(limits.texture_edge);
    bounds.max_image_height = Some(limits.texture_edge);
    // The pixels have their own limits below; this is for rows and metadata.
    bounds.max_alloc = Some(DECODER_BYTES + 8 * u64::from(limits.texture_edge));
    reader.limits(bounds);
    let mut decoder = reader.into_decoder().map_err(undecodable)?;
    let (width, height) = decoder.dimensions();
    let pixels = u64::from(width) * u64::from(height);
    if pixels > limits.texture_pixels {
        let reason = format!("{width} x {height} pixels, the limit is {}", limits.texture_pixels);
        return Err(too_large(reason, "texture_pixels"));
    }
    let codes = match profiles {
        Profiles::Ignored => None,
        Profiles::Heeded => codes_of(source, object, decoder.icc_profile().map_err(undecodable)?)?,
    };
    let deep = is_deep(decoder.color_type()) || codes.is_some();
    let cost = cost(width, height, decoder.color_type(), deep);
    if cost > *budget {
        let reason = format!("it takes {cost} bytes decoded; {budget} of {} are left", limits.texture_bytes);
        return Err(too_large(reason, "texture_bytes"));
    }
    *budget -= cost;
    Ok((DynamicImage::from_decoder(decoder).map_err(undecodable)?, codes))
}

/// True where every palette of a PNG has three bytes a colour: its decoder panics at others.
fn palettes_are_whole(png: &[u8]) -> bool {
    let mut rest = png.get(8..).unwrap_or_default();
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length);
        if after.starts_with(b"PLTE") && !length.is_multiple_of(3) {
            return false;
        }
        // Its kind and its checksum.
        let end = (length as usize).saturating_add(8);
        rest = after.get(end..).unwrap_or_default();
    }
    true
}

/// Linear value of a 16-bit sRGB-encoded one.
fn linear16(encoded: u16) -> u16 {
    (crate::texture::srgb_to_linear(f64::from(encoded) / 65535.0) * 65535.0).round() as u16
}

/// Formats that glTF extensions bring and the image crate does not tell apart.
fn other_format(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\xABKTX 20\xBB\r\n\x1A\n") {
        return Some("ktx2 (Basis Universal)");
    }
    (bytes.get(4..12) == Some(b"ftypavif")).then_some("avif")
}
