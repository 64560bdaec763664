//! STL: triangles alone, binary or ASCII, in [`ImportOptions::color`](crate::ImportOptions::color).
//!
//! Normals are not looked at: the order of the corners says where outside is. Corners that agree
//! exactly are one vertex. Colours that some programs keep in the attribute bytes of a binary file are
//! left out with a note, since no two of them agree on how; what follows the last triangle is left out
//! too.

mod ascii;
mod binary;

use std::collections::HashMap;

use super::format::{BINARY_START, BINARY_STRIDE, binary_triangles, without_mark};
use super::parts::Parts;
use super::source::Source;
use super::{Format, text};
use crate::{MeshError, Model};

/// The remedy where only the program that wrote the file can help.
const REEXPORT: &str = "the file is damaged or cut short; export it again";

/// Reads a model.
pub(super) fn read(source: &Source, bytes: &[u8]) -> Result<Model, MeshError> {
    let mut solid = Solid::new(source);
    if is_binary(bytes) {
        binary::read(&mut solid, bytes)?;
    } else {
        ascii::read(&mut solid, without_mark(bytes))?;
    }
    solid.parts.finish("export a mesh with faces")
}

/// Whether the claimed triangles fit, or it cannot be text.
fn is_binary(bytes: &[u8]) -> bool {
    let exact = binary_triangles(bytes).map(|n| BINARY_START + BINARY_STRIDE * n);
    if exact == Some(bytes.len() as u64) {
        return true;
    }
    let start = without_mark(bytes);
    let first = text::words(&start[..start.len().min(256)]).next().map(<[u8]>::to_ascii_lowercase);
    first.as_deref() != Some(b"solid") || bytes.iter().take(1024).any(|&b| b == 0)
}

/// The mesh as it grows, corners that agree joined.
struct Solid<'s, 'a> {
    parts: Parts<'s, 'a>,
    known: HashMap<[u32; 3], u32>,
    material: u32,
}

impl<'s, 'a> Solid<'s, 'a> {
    fn new(source: &'s Source<'a>) -> Self {
        let read_as = source.read_as(Format::Stl, None);
        let mut parts = Parts::new(source, read_as);
        let material = parts.material("", read_as.color, None);
        Self { parts, known: HashMap::new(), material }
    }

    fn triangle(&mut self, object: impl Fn() -> String, corners: [[f32; 3]; 3]) -> Result<(), MeshError> {
        let mut vertices = [0; 3];
        for (vertex, corner) in vertices.iter_mut().zip(corners) {
            // Zero has two signs.
            let corner = corner.map(|c| c + 0.0);
            let key = corner.map(f32::to_bits);
            *vertex = match self.known.get(&key) {
                Some(&known) => known,
                None => {
                    let new = self.parts.vertex(&object, corner.map(f64::from), [0.0; 2], [1.0; 4])?;
                    self.known.insert(key, new);
                    new
                }
            };
        }
        self.parts.triangle(object, vertices, self.material)
    }
}
