//! The zip package: its parts by name, unpacked within the limits.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::{Cursor, Read};

use zip::ZipArchive;
use zip::result::ZipError;

use super::REEXPORT;
use super::xml::{Token, Xml};
use crate::MeshError;
use crate::import::source::{Source, quoted};

const RELATIONSHIPS: &str = "_rels/.rels";
const USUAL_ROOT: &str = "3D/3dmodel.model";

pub(super) struct Package<'s, 'a, 'b> {
    source: &'s Source<'a>,
    archive: RefCell<ZipArchive<Cursor<&'b [u8]>>>,
    /// Parts by name in lower case: names that differ in case only are one.
    parts: BTreeMap<String, usize>,
}

impl<'s, 'a, 'b> Package<'s, 'a, 'b> {
    pub fn open(source: &'s Source<'a>, bytes: &'b [u8]) -> Result<Self, MeshError> {
        let archive = ZipArchive::new(Cursor::new(bytes)).map_err(|e| broken(source, "package", &e))?;
        let mut parts = BTreeMap::new();
        for index in 0..archive.len() {
            if let Some(Ok(name)) = archive.name_for_index(index) {
                parts.entry(key(&name)).or_insert(index);
            }
        }
        Ok(Self { source, archive: RefCell::new(archive), parts })
    }

    /// Name of the model that the package is about.
    pub fn root(&self) -> Result<String, MeshError> {
        if self.parts.contains_key(&key(RELATIONSHIPS)) {
            let bytes = self.read("package", RELATIONSHIPS)?;
            let mut xml = Xml::new(self.source, RELATIONSHIPS, &bytes)?;
            loop {
                match xml.token()? {
                    Token::Open(tag) if tag.name() == "Relationship" => {
                        let kind = tag.text("Type").unwrap_or_default();
                        if kind.ends_with("/3dmodel")
                            && let Some(target) = tag.text("Target")
                        {
                            return Ok(target);
                        }
                    }
                    Token::End => break,
                    _ => {}
                }
            }
        }
        if self.parts.contains_key(&key(USUAL_ROOT)) {
            return Ok(USUAL_ROOT.into());
        }
        let reason = "it holds no 3D model";
        Err(self.source.invalid("package", reason, "give a 3MF package, not another kind of zip file"))
    }

    /// The key that a part is known by; the same for every way to write its name.
    pub fn key(&self, object: &str, name: &str) -> Result<String, MeshError> {
        let key = key(name);
        if key.is_empty() || key.split('/').any(|step| step == ".." || step == ".") || key.contains('\0') {
            let reason = format!("the part name {} leaves the package", quoted(name));
            return Err(self.source.invalid(object, reason, REEXPORT));
        }
        Ok(key)
    }

    /// A part's bytes, charged to what other files may bring in.
    pub fn read(&self, object: &str, name: &str) -> Result<Vec<u8>, MeshError> {
        let source = self.source;
        let object = format!("{object}, part {}", quoted(name));
        let Some(&index) = self.parts.get(&self.key(&object, name)?) else {
            return Err(source.invalid(object, "the package does not hold it", REEXPORT));
        };
        let budget = source.budget.get();
        let too_large = |size: String| {
            let reason = format!(
                "it takes {size} bytes unpacked; {budget} of the {} allowed for the model's files are left",
                source.limits.file_bytes
            );
            source.unsupported(&object, reason, "simplify the model or raise ImportLimits::file_bytes")
        };
        let mut archive = self.archive.borrow_mut();
        let part = archive.by_index(index).map_err(|e| broken(source, &object, &e))?;
        if part.size() > budget {
            return Err(too_large(part.size().to_string()));
        }
        // The size is only a claim; memory grows with what is really there.
        let mut bytes = Vec::new();
        part.take(budget.saturating_add(1))
            .read_to_end(&mut bytes)
            .map_err(|e| source.invalid(&object, format!("it cannot be unpacked: {e}"), REEXPORT))?;
        if bytes.len() as u64 > budget {
            return Err(too_large(format!("more than {budget}")));
        }
        source.budget.set(budget - bytes.len() as u64);
        Ok(bytes)
    }
}

/// A part's name in one form: no leading slash, lower case, escapes decoded as far as they are plain.
fn key(name: &str) -> String {
    name.replace("%20", " ").trim_start_matches('/').to_ascii_lowercase()
}

fn broken(source: &Source, object: &str, error: &ZipError) -> MeshError {
    match error {
        ZipError::UnsupportedArchive(_) | ZipError::CompressionMethodNotSupported(_) => {
            source.unsupported(object, error.to_string(), "pack it without encryption, with deflate")
        }
        _ => source.invalid(object, format!("the zip package is damaged: {error}"), REEXPORT),
    }
}
