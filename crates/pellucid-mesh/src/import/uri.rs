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

const RELATIVE: &str = "put the file in the model's folder and refer to it by a relative path";

const PUT_BESIDE: &str =
    "put the file in the model's folder under that name, or export a model that holds it";

/// What a reference to a file is, in its format's rules.
#[derive(Clone, Copy)]
struct Reference {
    called: &'static str,
    /// Percent escapes stand for other characters.
    escaped: bool,
}

const URI: Reference = Reference { called: "URI", escaped: true };

#[cfg(any(feature = "obj", feature = "ply"))]
const FILE_NAME: Reference = Reference { called: "file name", escaped: false };

/// The bytes a URI stands for, charged to what other files may bring in.
pub(super) fn load(source: &Source, object: &str, uri: &str) -> Result<Vec<u8>, MeshError> {
    let budget = source.budget.get();
    let bytes = if uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:")) {
        decode_data(source, object, &uri[5..], budget)?
    } else {
        let path = resolve(source, object, uri, URI)?;
        read_bounded(source, object, &path, budget)?
    };
    source.budget.set(budget.saturating_sub(bytes.len() as u64));
    Ok(bytes)
}

/// The bytes of a file beside the model, charged in the same way.
#[cfg(any(feature = "obj", feature = "ply"))]
pub(super) fn load_file(source: &Source, object: &str, name: &str) -> Result<Vec<u8>, MeshError> {
    let budget = source.budget.get();
    let path = resolve(source, object, name, FILE_NAME)?;
    let bytes = read_bounded(source, object, &path, budget)?;
    source.budget.set(budget.saturating_sub(bytes.len() as u64));
    Ok(bytes)
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

/// The file that a relative URI or file name names, after every symbolic link, inside the model's folder.
///
/// Exporters write names as they are: a `%` that starts no escape is itself, a name whose escapes
/// name nothing is tried as it stands, and a backslash separates folders on every system.
fn resolve(source: &Source, object: &str, uri: &str, reference: Reference) -> Result<PathBuf, MeshError> {
    let Reference { called, escaped } = reference;
    let refused = |reason: &str, remedy: &str| {
        source.invalid(object, format!("its {called} {} {reason}", quoted(uri)), remedy)
    };
    let Some(folder) = source.folder else {
        return Err(refused("names a file, but the model was given without a folder", RELATIVE));
    };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let io = |e| source.io(format!("{object}, {called} {}", quoted(uri)), e, PUT_BESIDE);
    let root = folder.canonicalize().map_err(io)?;
    let mut names = file_names(uri);
    if !escaped {
        names.reverse();
    }
    if names.is_empty() {
        return Err(refused("is not a file name", RELATIVE));
    }
    let mut missing = None;
    for name in &names {
        check_name(name).map_err(|reason| refused(reason, RELATIVE))?;
        match root.join(name).canonicalize() {
            Ok(path) if path.starts_with(&root) => return Ok(path),
            Ok(_) => return Err(refused("leaves the model's folder through a link", RELATIVE)),
            Err(e) => missing = missing.or(Some(e)),
        }
    }
    if escaped && percent_decode(uri).is_none_or(|bytes| String::from_utf8(bytes).is_err()) {
        let reason = "has a % that is no escape, and no file of that very name is in the model's folder";
        return Err(refused(
            reason,
            "write a % of a file's name as %25, and put the file in the model's folder",
        ));
    }
    Err(io(missing.unwrap_or_else(|| std::io::ErrorKind::NotFound.into())))
}

/// The file names a URI may stand for, likeliest first: unescaped, then as it is written.
fn file_names(uri: &str) -> Vec<String> {
    let unescaped = String::from_utf8(percent_decode_lenient(uri)).ok();
    let mut names: Vec<String> = unescaped.into_iter().chain([uri.to_owned()]).collect();
    names.dedup();
    names.retain(|name| !name.is_empty() && !name.contains('\0'));
    names.iter_mut().for_each(|name| *name = name.replace('\\', "/"));
    // An escaped NUL is no name in either form.
    if uri.contains("%00") { Vec::new() } else { names }
}

/// Whether a name stays below the folder it starts from; the error is the reason.
fn check_name(name: &str) -> Result<(), &'static str> {
    if name.split('/').next().is_some_and(|first| first.contains(':')) {
        return Err("has a scheme or drive");
    }
    let inside = Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if inside { Ok(()) } else { Err("leaves the model's folder") }
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

/// The bytes that percent escapes stand for; `None` where a `%` starts none.
fn percent_decode(text: &str) -> Option<Vec<u8>> {
    let mut whole = true;
    let bytes = unescape(text, || whole = false);
    whole.then_some(bytes)
}

/// The same with a `%` that starts no escape kept as it is.
fn percent_decode_lenient(text: &str) -> Vec<u8> {
    unescape(text, || ())
}

fn unescape(text: &str, mut stray: impl FnMut()) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [byte, tail @ ..] = rest {
        let digit = |b: &u8| char::from(*b).to_digit(16);
        let escape = match (byte, tail) {
            (b'%', [high, low, ..]) => digit(high).zip(digit(low)),
            _ => None,
        };
        if let Some((high, low)) = escape {
            out.push((high * 16 + low) as u8);
            rest = &tail[2..];
            continue;
        }
        if *byte == b'%' {
            stray();
        }
        out.push(*byte);
        rest = tail;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{percent_decode, percent_decode_lenient};

    #[test]
    fn percent_escapes_decode_or_fail() {
        assert_eq!(percent_decode("a%20b%2Fc%c3%a9").unwrap(), "a b/cé".as_bytes());
        assert_eq!(percent_decode("50%"), None);
        assert_eq!(percent_decode("%g0"), None);
        assert_eq!(percent_decode("%é"), None);
    }

    #[test]
    fn a_percent_sign_that_starts_no_escape_is_itself() {
        for (text, expected) in [
            ("50%", "50%"),
            ("%", "%"),
            ("%4", "%4"),
            ("%g0", "%g0"),
            ("%0g", "%0g"),
            ("%é", "%é"),
            ("%%20", "% "),
            ("10%.b%69n", "10%.bin"),
            ("a%25b", "a%b"),
        ] {
            assert_eq!(percent_decode_lenient(text), expected.as_bytes(), "{text}");
        }
    }
}
