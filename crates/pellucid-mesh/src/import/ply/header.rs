//! The header: encoding, elements and their properties, names of textures.

use super::REEXPORT;
use crate::MeshError;
use crate::import::source::{Source, quoted};
use crate::import::text;

/// Most elements, most properties of one, and most textures.
const MOST: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value that stands for a colour of 1.
    pub fn full(self) -> f64 {
        match self {
            Self::F32 | Self::F64 => 1.0,
            Self::I16 | Self::U16 => 65535.0,
            Self::I8 | Self::U8 | Self::I32 | Self::U32 => 255.0,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

#[derive(Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
}

#[derive(Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: u64,
    pub properties: Vec<Property>,
}

impl Element {
    /// Its name as errors say it.
    pub fn label(&self) -> String {
        let plain =
            self.name.len() <= 20 && self.name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        if plain { self.name.clone() } else { quoted(&self.name) }
    }

    /// Position of the first property of one of these names.
    pub fn position(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&p.name.as_str()))
    }
}

#[derive(Debug)]
pub(super) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    pub textures: Vec<String>,
}

impl Header {
    /// The header, and what follows it.
    pub fn read<'b>(source: &Source, bytes: &'b [u8]) -> Result<(Self, &'b [u8]), MeshError> {
        let mut lines = text::Lines::new(bytes);
        let mut encoding = None;
        let (mut elements, mut textures) = (Vec::<Element>::new(), Vec::new());
        while let Some((number, line)) = lines.next() {
            let fail = |reason: &str| {
                let reason = format!("{}: {reason}", quoted(&text::string(line)));
                Err(source.invalid(format!("header, line {number}"), reason, REEXPORT))
            };
            let words: Vec<&[u8]> = text::words(line).take(6).collect();
            match words.as_slice() {
                [] | [b"ply"] | [b"obj_info", ..] => {}
                [b"comment", rest @ ..] => {
                    if rest.first() == Some(&&b"TextureFile"[..]) && textures.len() < MOST {
                        textures.extend(texture_name(line));
                    }
                }
                [b"format", name, ..] => {
                    encoding = match *name {
                        b"ascii" => Some(Encoding::Ascii),
                        b"binary_little_endian" => Some(Encoding::LittleEndian),
                        b"binary_big_endian" => Some(Encoding::BigEndian),
                        _ => return fail("no known encoding"),
                    };
                }
                [b"element", name, count] => {
                    let count = std::str::from_utf8(count).ok().and_then(|c| c.parse().ok());
                    let Some(count) = count.filter(|_| elements.len() < MOST) else {
                        return fail("no count of rows, or too many elements");
                    };
                    elements.push(Element { name: text::string(name), count, properties: Vec::new() });
                }
                [b"property", rest @ ..] => {
                    let Some(element) = elements.last_mut().filter(|e| e.properties.len() < MOST) else {
                        return fail("a property without an element, or too many of them");
                    };
                    let Some(property) = property(rest) else { return fail("no property") };
                    element.properties.push(property);
                }
                [b"end_header"] => {
                    let Some(encoding) = encoding else { return fail("no format was given") };
                    return Ok((Self { encoding, elements, textures }, lines.rest()));
                }
                _ => return fail("no line of a PLY header"),
            }
        }
        Err(source.invalid("header", "it has no end (end_header)", REEXPORT))
    }
}

fn property(words: &[&[u8]]) -> Option<Property> {
    let (kind, name) = match words {
        [b"list", count, item, name] => {
            let count = Scalar::from_name(count).filter(|c| !matches!(c, Scalar::F32 | Scalar::F64))?;
            (Kind::List { count, item: Scalar::from_name(item)? }, name)
        }
        [kind, name] => (Kind::Scalar(Scalar::from_name(kind)?), name),
        _ => return None,
    };
    Some(Property { name: text::string(name), kind })
}

/// All that follows `comment TextureFile`: a name may hold spaces.
fn texture_name(line: &[u8]) -> Option<String> {
    let line = text::string(line);
    let (_, name) = line.split_once("TextureFile")?;
    let name = name.trim();
    let name = name.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(name);
    (!name.is_empty()).then(|| name.to_owned())
}
