//! Data URIs, and files beside the model: nothing outside its folder is ever opened.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::source::{Source, quoted};
use crate::MeshError;

const BASE64: GeneralPurpose = GeneralPurpose::new(
    &STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true),
);

const PUT_BESIDE: &str = "put the file in the model's folder under that name, or export a .glb";

/// The bytes a URI stands for, at most `budget` of them.
pub(super) fn load(source: &Source, object: &str, uri: &str, budget: u64) -> Result<Vec<u8>, MeshError> {
    if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        return decode_data(source, object, &uri[5..], budget);
    }
    let path = resolve(source, object, uri)?;
    read_bounded(source, object, &path, budget)
}

fn decode_data(source: &Source, object: &str, rest: &str, budget: u64) -> Result<Vec<u8>, MeshError> {
    let broken = |reason: String| source.invalid(object, reason, "export the model again as .glb");
    let (kind, data) = rest.split_once(',').ok_or_else(|| broken("its data URI has no comma".into()))?;
    let base64 = kind.to_ascii_lowercase().ends_with(";base64");
    let size = if base64 { data.len() as u64 / 4 * 3 } else { data.len() as u64 };
    if size > budget {
        return Err(too_large(source, object, size, budget));
    }
    if base64 {
        BASE64.decode(data).map_err(|e| broken(format!("its data URI is not valid base64: {e}")))
    } else {
        percent_decode(data).ok_or_else(|| broken("its data URI has a broken percent escape".into()))
    }
}

/// The file that a relative URI names, after every symbolic link, inside the model's folder.
fn resolve(source: &Source, object: &str, uri: &str) -> Result<PathBuf, MeshError> {
    let outside = |reason: &str| {
        source.invalid(
            object,
            format!("its URI {} {reason}", quoted(uri)),
            "put the file in the model's folder and refer to it by a relative path",
        )
    };
    let Some(folder) = source.folder else {
        return Err(outside("names a file, but the model was given without a folder"));
    };
    let decoded = percent_decode(uri).and_then(|bytes| String::from_utf8(bytes).ok());
    let Some(decoded) = decoded.filter(|d| !d.is_empty() && !d.contains('\0')) else {
        return Err(outside("is not a file name"));
    };
    if decoded.split('/').next().is_some_and(|first| first.contains(':')) {
        return Err(outside("has a scheme or drive"));
    }
    // A backslash separates folders on one system and is part of a name on another.
    let relative = Path::new(&decoded);
    let inside = relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if !inside || decoded.contains('\\') {
        return Err(outside("leaves the model's folder"));
    }
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let io = |e| source.io(format!("{object}, URI {}", quoted(uri)), e, PUT_BESIDE);
    let root = folder.canonicalize().map_err(io)?;
    let path = root.join(relative).canonicalize().map_err(io)?;
    if !path.starts_with(&root) {
        return Err(outside("leaves the model's folder through a link"));
    }
    Ok(path)
}

/// A regular file's bytes, refused before reading if there are more than `budget`.
pub(super) fn read_bounded(
    source: &Source,
    object: &str,
    path: &Path,
    budget: u64,
) -> Result<Vec<u8>, MeshError> {
    let io = |e| source.io(object, e, "check that the file exists and may be read");
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        return Err(source.invalid(object, "it is not a regular file", "give the path of a file"));
    }
    if metadata.len() > budget {
        return Err(too_large(source, object, metadata.len(), budget));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    File::open(path).and_then(|f| f.take(budget + 1).read_to_end(&mut bytes)).map_err(io)?;
    if bytes.len() as u64 > budget {
        return Err(too_large(source, object, bytes.len() as u64, budget));
    }
    Ok(bytes)
}

fn too_large(source: &Source, object: &str, size: u64, budget: u64) -> MeshError {
    source.unsupported(
        object,
        format!(
            "it has {size} bytes; {budget} of the {} allowed for the model's files are left",
            source.limits.file_bytes
        ),
        "simplify the model or raise ImportLimits::file_bytes",
    )
}

fn percent_decode(text: &str) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len());
    let mut bytes = text.bytes();
    while let Some(byte) = bytes.next() {
        if byte != b'%' {
            out.push(byte);
            continue;
        }
        let digit = |b: Option<u8>| char::from(b?).to_digit(16);
        let (high, low) = (digit(bytes.next())?, digit(bytes.next())?);
        out.push((high * 16 + low) as u8);
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::percent_decode;

    #[test]
    fn percent_escapes_decode_or_fail() {
        assert_eq!(percent_decode("a%20b%2Fc%c3%a9").unwrap(), "a b/cé".as_bytes());
        assert_eq!(percent_decode("50%"), None);
        assert_eq!(percent_decode("%g0"), None);
        assert_eq!(percent_decode("%é"), None);
    }
}
