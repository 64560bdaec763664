//! Rows of elements, of words or of bytes.

use super::header::{Element, Encoding, Kind, Scalar};
use crate::import::source::quoted;
use crate::import::text;

/// Why a row cannot be read.
pub(super) enum Reading {
    Damaged(String),
    TooLong(String),
}

/// A row's values; those of properties that nobody asked for are missing.
pub(super) struct Row {
    pub wanted: Vec<bool>,
    /// One a property; 0 for lists.
    pub scalars: Vec<f64>,
    /// One a property; empty for scalars.
    pub lists: Vec<Vec<f64>>,
}

/// What is left of the file.
pub(super) struct Body<'b> {
    encoding: Encoding,
    rest: &'b [u8],
    longest_list: u64,
}

impl<'b> Body<'b> {
    pub fn new(encoding: Encoding, rest: &'b [u8], longest_list: u64) -> Self {
        Self { encoding, rest, longest_list }
    }

    pub fn left(&self) -> usize {
        self.rest.len()
    }

    /// Bytes that a row takes at least.
    pub fn least_bytes(&self, element: &Element) -> u64 {
        let least = |kind: &Kind| match (self.encoding, kind) {
            (Encoding::Ascii, _) => 1,
            (_, Kind::Scalar(scalar)) => scalar.size() as u64,
            (_, Kind::List { count, .. }) => count.size() as u64,
        };
        element.properties.iter().map(|p| least(&p.kind)).sum()
    }

    /// Reads the next row.
    pub fn row(&mut self, element: &Element, row: &mut Row) -> Result<(), Reading> {
        for (k, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::Scalar(scalar) => row.scalars[k] = self.value(scalar, row.wanted[k])?,
                Kind::List { count, item } => {
                    let length = self.value(count, true)?;
                    let list = &mut row.lists[k];
                    list.clear();
                    self.list(length, item, row.wanted[k].then_some(list))?;
                }
            }
        }
        Ok(())
    }

    fn list(&mut self, length: f64, item: Scalar, into: Option<&mut Vec<f64>>) -> Result<(), Reading> {
        let least = if self.encoding == Encoding::Ascii { 1 } else { item.size() };
        let fits = length >= 0.0 && length.fract() == 0.0 && length * least as f64 <= self.rest.len() as f64;
        if !fits {
            let reason = format!("a list of {length} values, {} bytes are left", self.rest.len());
            return Err(Reading::Damaged(reason));
        }
        match into {
            None if self.encoding != Encoding::Ascii => {
                self.rest = &self.rest[length as usize * item.size()..];
            }
            None => {
                for _ in 0..length as u64 {
                    self.value(item, false)?;
                }
            }
            Some(list) => {
                if length > self.longest_list as f64 {
                    return Err(Reading::TooLong(format!("a list of {length} values")));
                }
                for _ in 0..length as u64 {
                    list.push(self.value(item, true)?);
                }
            }
        }
        Ok(())
    }

    /// The next value; may be NaN or infinite. What is not wanted is passed over.
    fn value(&mut self, scalar: Scalar, wanted: bool) -> Result<f64, Reading> {
        let ended = || Reading::Damaged("the file ends within it".into());
        let (little, size) = match self.encoding {
            Encoding::Ascii => {
                let start = self.rest.trim_ascii_start();
                let end = start.iter().position(u8::is_ascii_whitespace).unwrap_or(start.len());
                let (word, rest) = start.split_at(end);
                self.rest = rest;
                return match word {
                    [] => Err(ended()),
                    _ if !wanted => Ok(0.0),
                    _ => text::number(word).ok_or_else(|| {
                        Reading::Damaged(format!("{} is no finite number", quoted(&text::string(word))))
                    }),
                };
            }
            Encoding::LittleEndian => (true, scalar.size()),
            Encoding::BigEndian => (false, scalar.size()),
        };
        let (bytes, rest) = self.rest.split_at_checked(size).ok_or_else(ended)?;
        self.rest = rest;
        // The value's bytes, least first, the others zero.
        let mut value = [0; 8];
        value[..size].copy_from_slice(bytes);
        if !little {
            value[..size].reverse();
        }
        let [a, b, c, d, ..] = value;
        Ok(match scalar {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(value),
        })
    }
}
