//! PNG and JPEG (and, with the feature `webp`, WebP) decoding within the limits: header first, pixels after.

use std::io::Cursor;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};

use super::icc::codes_of;
use super::source::{Source, quoted};
use crate::MeshError;
use crate::texture::Image;

pub(super) const PLAIN: &str = "export the model with its textures as PNG or JPEG";

/// What a decoder may allocate beside the pixels.
const DECODER_BYTES: u64 = 64 << 20;

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
) -> Result<Image, MeshError> {
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
    let deep = matches!(
        decoder.color_type(),
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16
    );
    let codes = match profiles {
        Profiles::Ignored => None,
        Profiles::Heeded => codes_of(source, object, decoder.icc_profile().map_err(undecodable)?)?,
    };
    let cost = Image::bytes(width, height, deep || codes.is_some());
    if cost > *budget {
        let reason = format!("it takes {cost} bytes decoded; {budget} of {} are left", limits.texture_bytes);
        return Err(too_large(reason, "texture_bytes"));
    }
    *budget -= cost;
    let picture = DynamicImage::from_decoder(decoder).map_err(undecodable)?;
    if let Some(codes) = codes {
        // Eight bits times 257 are the same share of sixteen.
        let texels: Vec<[u16; 3]> = picture.into_rgb16().pixels().map(|p| p.0).collect();
        return Image::from_linear16(width, height, codes.linear(&texels));
    }
    if deep {
        let texels = picture.into_rgb16().pixels().map(|p| p.0.map(linear16)).collect();
        Image::from_linear16(width, height, texels)
    } else {
        let texels = picture.into_rgb8().into_raw();
        let (rgb, _) = texels.as_chunks::<3>();
        Image::from_srgb8(width, height, rgb.to_vec())
    }
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
