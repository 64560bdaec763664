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

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

/// Writes colours.
///
/// # Errors
/// The serialiser's.
pub fn serialize<S: Serializer>(colors: &[[f32; 3]], serializer: S) -> Result<S::Ok, S::Error> {
    let bytes: Vec<u8> = colors.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    serializer.serialize_str(&STANDARD.encode(bytes))
}

/// Reads colours.
///
/// # Errors
/// The deserialiser's, and when the text is not base64 of whole colours.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[f32; 3]>, D::Error> {
    let values = values::<D, 4>(deserializer)?;
    if values.len() % 3 != 0 {
        return Err(D::Error::custom("packed colours end within a colour"));
    }
    Ok(values.chunks_exact(3).map(|v| std::array::from_fn(|c| f32::from_le_bytes(v[c]))).collect())
}

fn values<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<Vec<[u8; N]>, D::Error> {
    let text = std::borrow::Cow::<'de, str>::deserialize(deserializer)?;
    let bytes = STANDARD.decode(text.as_bytes()).map_err(D::Error::custom)?;
    let (values, rest) = bytes.as_chunks::<N>();
    if !rest.is_empty() {
        return Err(D::Error::custom("packed values end within a value"));
    }
    Ok(values.to_vec())
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
                let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
                serializer.serialize_str(&STANDARD.encode(bytes))
            }

            pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
                deserializer: D,
            ) -> Result<Vec<$type>, D::Error> {
                let values = values::<D, $bytes>(deserializer)?;
                Ok(values.into_iter().map(<$type>::from_le_bytes).collect())
            }
        }
    };
}

numbers!(bytes, u8, 1, "bytes");
numbers!(words, u16, 2, "shares");
numbers!(moves, i16, 2, "moves");
numbers!(floats, f32, 4, "derivatives");

/// The same of what a predictor learned, whose values are f64.
pub(crate) mod learned {
    use pellucid_predict::Learned;
    use serde::Serialize;

    use super::*;

    #[derive(Serialize, Deserialize)]
    struct Packed {
        predictor: String,
        passes: Vec<u32>,
        values: String,
    }

    pub(crate) fn serialize<S: Serializer>(learned: &Learned, serializer: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = learned.values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let packed = Packed {
            predictor: learned.predictor.clone(),
            passes: learned.passes.clone(),
            values: STANDARD.encode(bytes),
        };
        packed.serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Learned, D::Error> {
        let packed = Packed::deserialize(deserializer)?;
        let bytes = STANDARD.decode(packed.values).map_err(D::Error::custom)?;
        let (values, rest) = bytes.as_chunks::<8>();
        if !rest.is_empty() {
            return Err(D::Error::custom("packed values end within a value"));
        }
        let values = values.iter().map(|&v| f64::from_le_bytes(v)).collect();
        Ok(Learned { predictor: packed.predictor, passes: packed.passes, values })
    }
}
