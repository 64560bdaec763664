//! Which format a file is of, told by its content.

use std::path::Path;

use super::source::Source;
use super::{LengthUnit, UpAxis};
use crate::MeshError;

/// Bytes of a text file looked at for a keyword of its format.
const LOOK: usize = 1 << 16;

/// Format of a model file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Format {
    /// glTF 2.0, binary or JSON.
    #[cfg_attr(feature = "serde", serde(rename = "gltf"))]
    Gltf,
    /// Wavefront OBJ with MTL libraries.
    #[cfg_attr(feature = "serde", serde(rename = "obj"))]
    Obj,
    /// 3D Manufacturing Format.
    #[cfg_attr(feature = "serde", serde(rename = "3mf"))]
    ThreeMf,
    /// Polygon file format (Stanford).
    #[cfg_attr(feature = "serde", serde(rename = "ply"))]
    Ply,
    /// Stereolithography, binary or ASCII.
    #[cfg_attr(feature = "serde", serde(rename = "stl"))]
    Stl,
}

/// What a format means by a number and an axis where the file does not say.
pub(super) struct Habit {
    pub unit: LengthUnit,
    pub up: UpAxis,
}

impl Format {
    /// The name in records and of the cargo feature: `gltf`, `obj`, `3mf`, `ply` or `stl`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gltf => "gltf",
            Self::Obj => "obj",
            Self::ThreeMf => "3mf",
            Self::Ply => "ply",
            Self::Stl => "stl",
        }
    }

    /// The name to read.
    pub fn label(self) -> &'static str {
        match self {
            Self::Gltf => "glTF",
            Self::Obj => "OBJ",
            Self::ThreeMf => "3MF",
            Self::Ply => "PLY",
            Self::Stl => "STL",
        }
    }

    pub(super) fn habit(self) -> Habit {
        match self {
            Self::Gltf => Habit { unit: LengthUnit::Metre, up: UpAxis::Y },
            Self::Obj => Habit { unit: LengthUnit::Millimetre, up: UpAxis::Y },
            Self::ThreeMf | Self::Ply | Self::Stl => Habit { unit: LengthUnit::Millimetre, up: UpAxis::Z },
        }
    }

    /// The format of a file: by its content, or where that is too damaged or too plain, by its name.
    pub(super) fn detect(source: &Source, bytes: &[u8]) -> Result<Self, MeshError> {
        if let Some(format) = Self::of_content(bytes) {
            return Ok(format);
        }
        const REMEDY: &str = "give a model as glTF 2.0 (.glb, .gltf), OBJ, 3MF, PLY or STL";
        if let Some(name) = foreign(bytes) {
            return Err(source.unsupported("file", format!("it is a model of the format {name}"), REMEDY));
        }
        let extension = Path::new(source.file).extension().unwrap_or_default().to_ascii_lowercase();
        // The content of the others always tells.
        match extension.to_str() {
            Some("stl") => Ok(Self::Stl),
            Some("obj") => Ok(Self::Obj),
            _ => Err(source.invalid("file", "it is neither glTF nor OBJ, 3MF, PLY or STL", REMEDY)),
        }
    }

    fn of_content(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(b"glTF") {
            return Some(Self::Gltf);
        }
        if bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(b"PK\x05\x06") {
            return Some(Self::ThreeMf);
        }
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            return Some(Self::Ply);
        }
        // Before text: some binary files start with "solid" too.
        if binary_triangles(bytes).is_some_and(|n| bytes.len() as u64 == BINARY_START + BINARY_STRIDE * n) {
            return Some(Self::Stl);
        }
        let text = without_mark(bytes);
        let text = &text[..text.len().min(LOOK)];
        if text.iter().find(|b| !b.is_ascii_whitespace()) == Some(&b'{') {
            return Some(Self::Gltf);
        }
        if text.contains(&0) {
            return None;
        }
        let mut first = text.split(|b| matches!(b, b'\n' | b'\r')).filter_map(|line| {
            let mut words = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
            words.next().filter(|word| word[0] != b'#')
        });
        let word = first.next()?;
        if word.eq_ignore_ascii_case(b"solid") {
            return Some(Self::Stl);
        }
        const OBJ: [&[u8]; 11] =
            [b"v", b"vt", b"vn", b"vp", b"f", b"g", b"o", b"s", b"l", b"mtllib", b"usemtl"];
        OBJ.contains(&word).then_some(Self::Obj)
    }
}

/// Bytes before the triangles of a binary STL, and of each triangle.
pub(super) const BINARY_START: u64 = 84;
pub(super) const BINARY_STRIDE: u64 = 50;

/// The number of triangles that a binary STL claims.
pub(super) fn binary_triangles(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(80..84)?.first_chunk()?;
    Some(u64::from(u32::from_le_bytes(*count)))
}

/// Text without a byte order mark.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes)
}

/// Formats that are known and not read.
fn foreign(bytes: &[u8]) -> Option<&'static str> {
    const KNOWN: [(&[u8], &str); 5] = [
        (b"Kaydara FBX Binary", "FBX"),
        (b"PXR-USDC", "USD"),
        (b"#usda", "USD"),
        (b"BLENDER", "Blender"),
        (b"ISO-10303-21", "STEP"),
    ];
    KNOWN.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, name)| *name)
}
