//! The file's outer shape: a GLB container or plain JSON, and the JSON's bounds.

use serde::Deserialize;

use super::schema::{Header, Root};
use crate::MeshError;
use crate::import::format;
use crate::import::source::{Source, quoted};

const MAGIC: &[u8; 4] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_JSON: u32 = 0x4E4F_534A;
const CHUNK_BIN: u32 = 0x004E_4942;

const TRUNCATED: &str = "the file is damaged or cut short; export or download it again";

/// The JSON text and the GLB's binary chunk.
pub(super) struct Container<'a> {
    pub json: &'a [u8],
    pub binary: Option<&'a [u8]>,
}

/// Splits a `.glb`, or takes the whole of a `.gltf`.
pub(super) fn open<'a>(source: &Source, bytes: &'a [u8]) -> Result<Container<'a>, MeshError> {
    if !bytes.starts_with(MAGIC) {
        return Ok(Container { json: format::without_mark(bytes), binary: None });
    }
    let version = word(bytes, 4).ok_or_else(|| source.invalid("GLB header", "it is cut short", TRUNCATED))?;
    if version != 2 {
        return Err(source.unsupported(
            "GLB header",
            format!("container version {version}"),
            "convert the model to glTF 2.0",
        ));
    }
    let length = word(bytes, 8).map(|l| l as usize);
    let Some(body) = length.and_then(|l| bytes.get(HEADER_BYTES..l)) else {
        return Err(source.invalid(
            "GLB header",
            format!("it gives a length of {} bytes, the file has {}", length.unwrap_or(0), bytes.len()),
            TRUNCATED,
        ));
    };
    chunks(source, body)
}

fn chunks<'a>(source: &Source, body: &'a [u8]) -> Result<Container<'a>, MeshError> {
    let (mut json, mut binary) = (None, None);
    let (mut at, mut number) = (0, 0);
    while at < body.len() {
        let object = || format!("GLB chunk {number}");
        let (Some(length), Some(kind)) = (word(body, at), word(body, at + 4)) else {
            return Err(source.invalid(object(), "its header is cut short", TRUNCATED));
        };
        let start = at + 8;
        let Some(data) = start.checked_add(length as usize).and_then(|end| body.get(start..end)) else {
            return Err(source.invalid(
                object(),
                format!("it claims {length} bytes, {} are left", body.len() - start),
                TRUNCATED,
            ));
        };
        match (number, kind) {
            (0, CHUNK_JSON) => json = Some(data),
            (0, _) => break,
            (1, CHUNK_BIN) => binary = Some(data),
            // Later chunks are for extensions.
            _ => {}
        }
        at = start + data.len();
        number += 1;
    }
    match json {
        Some(json) => Ok(Container { json, binary }),
        None => Err(source.invalid("GLB chunk 0", "it is not JSON", TRUNCATED)),
    }
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b))
}

/// Parses the JSON once its size is known to be within the limits.
pub(super) fn parse(source: &Source, json: &[u8]) -> Result<Root, MeshError> {
    // Counted in the raw text, strings included: an upper bound on what parsing allocates.
    let count = |wanted: &[u8]| json.iter().filter(|b| wanted.contains(b)).count() as u64;
    let checks = [
        (count(b"{["), source.limits.items, "objects and arrays", "items"),
        (count(b",[{"), source.limits.json_values, "values", "json_values"),
    ];
    for (found, limit, what, field) in checks {
        if found > limit {
            return Err(source.unsupported(
                "JSON",
                format!("it holds {found} {what}, the limit is {limit}"),
                format!("simplify the model or raise ImportLimits::{field}"),
            ));
        }
    }
    let header: Header = deserialize(source, json)?;
    if !header.asset.version.starts_with("2.") {
        return Err(source.unsupported(
            "asset.version",
            format!("glTF version {}", quoted(&header.asset.version)),
            "convert the model to glTF 2.0",
        ));
    }
    deserialize(source, json)
}

fn deserialize<'a, T: Deserialize<'a>>(source: &Source, json: &'a [u8]) -> Result<T, MeshError> {
    serde_json::from_slice(json).map_err(|error| {
        source.invalid(
            "JSON",
            error.to_string(),
            "the file is not valid glTF 2.0; export it again, or see what the glTF validator says",
        )
    })
}
