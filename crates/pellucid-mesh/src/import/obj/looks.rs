//! What faces look like: the materials of the libraries, as they come into use.

use std::collections::{BTreeMap, BTreeSet};

use super::mtl::{Library, Material};
use crate::MeshError;
use crate::import::parts::Parts;
use crate::import::source::{Source, quoted};
use crate::import::uri;
use crate::texture::{Sampler, Wrap};

/// From a file's texture coordinates, v up, to the model's, v down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mapping {
    pub scale: [f32; 2],
    pub offset: [f32; 2],
}

impl Mapping {
    pub const PLAIN: Self = Self { scale: [1.0; 2], offset: [0.0; 2] };

    pub fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        [self.scale[0] * u + self.offset[0], 1.0 - (self.scale[1] * v + self.offset[1])]
    }
}

/// What the faces to come look like.
#[derive(Clone, Copy)]
pub(super) struct Look {
    /// Index among the model's materials.
    pub material: u32,
    /// Of a texture.
    pub mapping: Option<Mapping>,
    /// Colours are the vertices'.
    pub by_vertex: bool,
}

/// The materials of all libraries, and which one is in use.
pub(super) struct Looks {
    plain: [f32; 3],
    libraries: BTreeSet<String>,
    materials: BTreeMap<String, Material>,
    current: Option<String>,
    /// Of the material in use: without and with vertex colours.
    ready: [Option<Look>; 2],
    known: BTreeMap<(Option<String>, bool), Look>,
}

impl Looks {
    pub fn new(plain: [f32; 3]) -> Self {
        Self {
            plain,
            libraries: BTreeSet::new(),
            materials: BTreeMap::new(),
            current: None,
            ready: [None; 2],
            known: BTreeMap::new(),
        }
    }

    /// Reads the libraries of an `mtllib` line: one name that may hold spaces, or several.
    pub fn load(&mut self, source: &Source, object: &str, names: &str) -> Result<(), MeshError> {
        let names = unquoted(names);
        if !self.libraries.insert(names.to_owned()) {
            return Ok(());
        }
        match uri::load_file(source, object, names) {
            Ok(bytes) => self.read(source, names, &bytes),
            Err(MeshError::Io { .. }) if names.contains(char::is_whitespace) => {
                for name in names.split_whitespace() {
                    let bytes = uri::load_file(source, object, unquoted(name))?;
                    self.read(source, name, &bytes)?;
                }
                Ok(())
            }
            Err(error) => Err(error),
        }
    }

    fn read(&mut self, source: &Source, name: &str, bytes: &[u8]) -> Result<(), MeshError> {
        let read = Library::read(source, name, bytes, &mut self.materials);
        self.ready = [None; 2];
        read
    }

    /// Takes a material for the faces to come.
    pub fn choose(&mut self, source: &Source, object: &str, name: &str) {
        let name = unquoted(name);
        let known = self.materials.contains_key(name);
        if !known {
            let text = match self.libraries.is_empty() {
                true => format!("material {} is used, but there is no library (mtllib)", quoted(name)),
                false => format!("material {} is in no library", quoted(name)),
            };
            source.note(object, text);
        }
        self.current = known.then(|| name.to_owned());
        self.ready = [None; 2];
    }

    /// What a face looks like whose vertices have colours or not.
    pub fn current(&mut self, parts: &mut Parts, colored: bool) -> Result<Look, MeshError> {
        if let Some(look) = self.ready[usize::from(colored)] {
            return Ok(look);
        }
        let key = (self.current.clone(), colored);
        let look = match self.known.get(&key) {
            Some(&look) => look,
            None => {
                let look = self.make(parts, colored)?;
                self.known.insert(key, look);
                look
            }
        };
        self.ready[usize::from(colored)] = Some(look);
        Ok(look)
    }

    fn make(&self, parts: &mut Parts, by_vertex: bool) -> Result<Look, MeshError> {
        let name = self.current.as_deref().unwrap_or_default();
        let material = self.current.as_ref().and_then(|name| self.materials.get(name));
        if let Some((material, map)) = material.and_then(|m| Some((m, m.map.as_ref()?))) {
            let object = format!("{}, map_Kd", material.place);
            let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
            let sampler = Sampler { wrap_u: wrap, wrap_v: wrap, ..Sampler::default() };
            let texture = parts
                .texture(&object, &map.file, sampler, |source| uri::load_file(source, &object, &map.file))?;
            let opacity = match opacity_of(parts, material)? {
                Some(own) => Some(own),
                None => parts.opacity_of(texture),
            };
            if material.color.is_some_and(|kd| kd != [1.0; 3]) {
                let text = "its Kd is left out: the texture alone is its colour";
                parts.source.note(&material.place, text);
            }
            if material.opacity_map.as_ref().is_some_and(|m| m.mapping != map.mapping) {
                parts.source.note(&material.place, "its map_d takes the -o and -s of its map_Kd");
            }
            let alpha = material.alpha.unwrap_or(1.0);
            let material = parts.translucent(name, [1.0; 3], Some(texture), alpha, opacity);
            return Ok(Look { material, mapping: Some(map.mapping), by_vertex: false });
        }
        let color = match by_vertex {
            true => [1.0; 3],
            false => material.and_then(|m| m.color).unwrap_or(self.plain),
        };
        let alpha = material.and_then(|m| m.alpha).unwrap_or(1.0);
        let opacity = material.map_or(Ok(None), |m| opacity_of(parts, m))?;
        let mapping = opacity.and(material.and_then(|m| Some(m.opacity_map.as_ref()?.mapping)));
        Ok(Look { material: parts.translucent(name, color, None, alpha, opacity), mapping, by_vertex })
    }
}

/// The texture of a material's `map_d`.
fn opacity_of(parts: &mut Parts, material: &Material) -> Result<Option<u32>, MeshError> {
    let Some(map) = &material.opacity_map else { return Ok(None) };
    let object = format!("{}, map_d", material.place);
    let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
    let sampler = Sampler { wrap_u: wrap, wrap_v: wrap, ..Sampler::default() };
    let bytes = uri::load_file(parts.source, &object, &map.file)?;
    parts.opacity_texture(&object, &bytes, sampler).map(Some)
}

/// A name without the quotation marks that some programs write around it.
pub(super) fn unquoted(name: &str) -> &str {
    let name = name.trim();
    name.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')).unwrap_or(name)
}
