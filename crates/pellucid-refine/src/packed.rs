//! Serialises long arrays of colours as one text: base64 of their little-endian bytes. Exact, and a third longer than
//! the bytes where a list of decimals is three times as long.
//!
//! ```
//! use serde::{Deserialize, Serialize};
//! #[derive(Serialize, Deserialize)]
//! struct State {
//!     #[serde(with = "pellucid_refine::packed")]
//!     colors: Vec<[f32; 3]>,
//! }
//! # fn main() {}
//! ```

use std::borrow::Cow;
use std::fmt;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

/// Values that are encoded at a time; three bytes are four letters.
const TOGETHER: usize = 3 * 256;
/// Most bytes of a value.
const WIDEST: usize = 12;

/// Values as the text of their bytes, made as it is written: states are large, and so would a copy be.
struct Text<'a, T, const N: usize>(&'a [T], fn(&T) -> [u8; N]);

impl<T, const N: usize> fmt::Display for Text<'_, T, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const { assert!(N <= WIDEST) };
        let mut bytes = [0; TOGETHER * WIDEST];
        let mut letters = [0; TOGETHER * WIDEST / 3 * 4];
        for values in self.0.chunks(TOGETHER) {
            for (bytes, value) in bytes.as_chunks_mut::<N>().0.iter_mut().zip(values) {
                *bytes = (self.1)(value);
            }
            let length =
                STANDARD.encode_slice(&bytes[..values.len() * N], &mut letters).map_err(|_| fmt::Error)?;
            f.write_str(std::str::from_utf8(&letters[..length]).map_err(|_| fmt::Error)?)?;
        }
        Ok(())
    }
}

/// Values of the text that a deserialiser is at.
fn values<'de, D: Deserializer<'de>, T, const N: usize>(
    deserializer: D,
    value: fn([u8; N]) -> T,
) -> Result<Vec<T>, D::Error> {
    decoded(Cow::<'de, str>::deserialize(deserializer)?, value)
}

/// Values of a text, of which no more is kept than is needed.
fn decoded<T, E: Error, const N: usize>(text: Cow<'_, str>, value: fn([u8; N]) -> T) -> Result<Vec<T>, E> {
    let bytes = STANDARD.decode(text.as_bytes()).map_err(E::custom)?;
    drop(text);
    let (values, rest) = bytes.as_chunks::<N>();
    if !rest.is_empty() {
        return Err(E::custom("packed values end within a value"));
    }
    Ok(values.iter().map(|&bytes| value(bytes)).collect())
}

/// Writes colours.
///
/// # Errors
/// The serialiser's.
pub fn serialize<S: Serializer>(colors: &[[f32; 3]], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&Text(colors, |color| {
        let mut bytes = [0; 12];
        bytes.as_chunks_mut().0.iter_mut().zip(color).for_each(|(bytes, v)| *bytes = v.to_le_bytes());
        bytes
    }))
}

/// Reads colours.
///
/// # Errors
/// The deserialiser's, and when the text is not base64 of whole colours.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[f32; 3]>, D::Error> {
    values(deserializer, |bytes: [u8; 12]| {
        let channels = bytes.as_chunks::<4>().0;
        std::array::from_fn(|c| f32::from_le_bytes(channels[c]))
    })
}

macro_rules! numbers {
    ($name:ident, $type:ty, $bytes:literal, $what:literal) => {
        #[doc = concat!("The same of ", $what, ".")]
        pub(crate) mod $name {
            use super::*;

            pub(crate) fn serialize<S: Serializer>(
                values: &[$type],
                serializer: S,
            ) -> Result<S::Ok, S::Error> {
                serializer.collect_str(&Text::<_, $bytes>(values, |v| v.to_le_bytes()))
            }

            pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
                deserializer: D,
            ) -> Result<Vec<$type>, D::Error> {
                values(deserializer, <$type>::from_le_bytes)
            }
        }
    };
}

numbers!(bytes, u8, 1, "bytes");
numbers!(words, u16, 2, "shares");
numbers!(moves, i16, 2, "moves");
numbers!(floats, f32, 4, "derivatives");

numbers!(doubles, f64, 8, "values");

/// The same of what a predictor learned.
#[derive(serde::Serialize, Deserialize)]
#[serde(remote = "pellucid_predict::Learned")]
pub(crate) struct Learned {
    predictor: String,
    passes: Vec<u32>,
    #[serde(with = "doubles")]
    values: Vec<f64>,
    #[serde(with = "floats", default, skip_serializing_if = "Vec::is_empty")]
    singles: Vec<f32>,
}
