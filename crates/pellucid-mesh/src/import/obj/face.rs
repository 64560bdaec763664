//! Faces: corners, their indices, and the triangles they are cut into.

use std::collections::HashMap;

use super::looks::Looks;
use super::{REEXPORT, text};
use crate::MeshError;
use crate::import::ReadAs;
use crate::import::parts::Parts;
use crate::import::polygon::{Cutter, MAX_CORNERS};
use crate::import::source::{Source, quoted};

/// What indices refer to.
pub(super) struct Geometry<'g> {
    pub positions: &'g [[f64; 3]],
    /// Empty, or one a position.
    pub colors: &'g [Option<[f32; 4]>],
    pub coords: &'g [[f32; 2]],
}

/// The faces so far.
pub(super) struct Faces<'s, 'a> {
    pub parts: Parts<'s, 'a>,
    /// Vertices by position, texture coordinate (or `u32::MAX`) and material.
    known: HashMap<[u32; 3], u32>,
    cutter: Cutter,
    /// Position and texture coordinate of a face's corners.
    corners: Vec<(u32, Option<u32>)>,
    points: Vec<[f64; 3]>,
}

impl<'s, 'a> Faces<'s, 'a> {
    pub fn new(source: &'s Source<'a>, read_as: ReadAs) -> Self {
        Self {
            parts: Parts::new(source, read_as),
            known: HashMap::new(),
            cutter: Cutter::new(),
            corners: Vec::new(),
            points: Vec::new(),
        }
    }

    /// Adds the face of line `number`.
    pub fn add(
        &mut self,
        number: u64,
        rest: &[u8],
        geometry: &Geometry,
        looks: &mut Looks,
    ) -> Result<(), MeshError> {
        let source = self.parts.source;
        let object = || format!("line {number}");
        self.corners.clear();
        for word in text::words(rest).take_while(|word| word[0] != b'#') {
            if self.corners.len() == MAX_CORNERS {
                let reason = format!("the face has more than {MAX_CORNERS} corners");
                return Err(source.unsupported(object(), reason, "triangulate the mesh before export"));
            }
            let corner =
                corner(word, geometry).map_err(|reason| source.invalid(object(), reason, REEXPORT))?;
            self.corners.push(corner);
        }
        if self.corners.len() < 3 {
            let reason = format!("a face of {} corners", self.corners.len());
            return Err(source.invalid(object(), reason, "repair the mesh and export it again"));
        }
        let colored =
            self.corners.iter().all(|c| geometry.colors.get(c.0 as usize).is_some_and(Option::is_some));
        let look = looks.current(&mut self.parts, colored)?;
        self.points.clear();
        self.points.extend(self.corners.iter().map(|c| geometry.positions[c.0 as usize]));
        let triangles = self.cutter.cut(&self.points).map_err(|_| {
            source.unsupported(
                object(),
                "its polygons are too intricate",
                "triangulate the mesh before export",
            )
        })?;
        let mut vertices = Vec::with_capacity(self.corners.len());
        for &(position, coord) in &self.corners {
            let uv = match (look.mapping, coord) {
                (None, _) => None,
                (Some(mapping), Some(coord)) => Some((coord, mapping.apply(geometry.coords[coord as usize]))),
                (Some(_), None) => {
                    let reason = "its material has a texture, but a corner has no texture coordinate";
                    let remedy = "unwrap the mesh, or give it a material without a texture";
                    return Err(source.invalid(object(), reason, remedy));
                }
            };
            let key = [position, uv.map_or(u32::MAX, |(coord, _)| coord), look.material];
            let vertex = match self.known.get(&key) {
                Some(&known) => known,
                None => {
                    let color = geometry.colors.get(position as usize).copied().flatten();
                    let color = color.filter(|_| look.by_vertex).unwrap_or([1.0; 4]);
                    let point = geometry.positions[position as usize];
                    let uv = uv.map_or([0.0; 2], |(_, uv)| uv);
                    let new = self.parts.vertex(object, point, uv, color)?;
                    self.known.insert(key, new);
                    new
                }
            };
            vertices.push(vertex);
        }
        for triangle in triangles {
            self.parts.triangle(object, triangle.map(|i| vertices[i as usize]), look.material)?;
        }
        Ok(())
    }
}

/// Position and texture coordinate of a corner; the error is the reason.
fn corner(word: &[u8], geometry: &Geometry) -> Result<(u32, Option<u32>), String> {
    let mut fields = word.split(|&b| b == b'/');
    let index = |field: &[u8], what: &str, count: usize| {
        let number = std::str::from_utf8(field).ok().and_then(|text| text.parse::<i64>().ok());
        let found = match number {
            // From 1 up, or back from the last so far.
            Some(n @ 1..) => n.checked_sub(1),
            Some(n @ ..0) => (count as i64).checked_add(n),
            Some(0) | None => {
                return Err(format!("{} is no corner of a face", quoted(&text::string(word))));
            }
        };
        found
            .filter(|i| (0..count as i64).contains(i))
            .map(|i| i as u32)
            .ok_or_else(|| format!("{what} {} does not exist, there are {count} so far", text::string(field)))
    };
    let position = index(fields.next().unwrap_or_default(), "vertex", geometry.positions.len())?;
    let coord = match fields.next() {
        None | Some([]) => None,
        Some(field) => Some(index(field, "texture coordinate", geometry.coords.len())?),
    };
    Ok((position, coord))
}
