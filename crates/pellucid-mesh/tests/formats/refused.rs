//! What errors must say.

use std::path::Path;

use pellucid_mesh::{ImportLimits, ImportOptions, MeshError, Model};

#[derive(Debug, PartialEq)]
pub enum Kind {
    Invalid,
    Unsupported,
    Io,
}

/// Asserts the kind of an error, and parts of its object and of its text.
#[track_caller]
pub fn refused(result: Result<Model, MeshError>, kind: Kind, object: &str, reason: &str) {
    let error = match result {
        Ok(_) => panic!("imported, but {object} should be refused: {reason}"),
        Err(error) => error,
    };
    let text = error.to_string();
    let (found, file, place, remedy) = match &error {
        MeshError::Invalid { file, object, remedy, .. } => (Kind::Invalid, file, object, remedy),
        MeshError::Unsupported { file, object, remedy, .. } => (Kind::Unsupported, file, object, remedy),
        MeshError::Io { file, object, remedy, .. } => (Kind::Io, file, object, remedy),
        other => panic!("{other}"),
    };
    assert_eq!(found, kind, "{text}");
    assert!(place.contains(object), "{text}: not about {object}");
    assert!(text.contains(reason), "{text}: does not say {reason}");
    assert!(!file.is_empty() && text.starts_with(file.as_str()) && remedy.len() > 10, "{text}");
}

pub fn import(name: &str, bytes: &[u8], folder: Option<&Path>) -> Result<Model, MeshError> {
    ImportOptions::default().import_slice(name, bytes, folder)
}

pub fn limited(name: &str, bytes: &[u8], limits: ImportLimits) -> Result<Model, MeshError> {
    ImportOptions::from(limits).import_slice(name, bytes, None)
}

/// Texts of a model's notes.
pub fn notes(model: &Model) -> String {
    model.notes().iter().map(|n| format!("{}: {}\n", n.object, n.text)).collect()
}
