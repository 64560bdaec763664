//! Vertices, faces and strips, and what colours them.

use std::collections::HashMap;

use super::REEXPORT;
use super::body::Row;
use super::header::{Element, Kind, Scalar};
use crate::import::parts::{self, Parts, admit_vertex};
use crate::import::polygon::{Cutter, MAX_CORNERS};
use crate::import::source::Source;
use crate::import::{Format, uri};
use crate::texture::Sampler;
use crate::{MeshError, Model};

/// A property's position in its element, and what stands for 1 in it.
type Share = (usize, f64);

/// Red, green, blue, and an opacity where there is one.
#[derive(Clone, Copy)]
struct Colors {
    rgb: [Share; 3],
    alpha: Option<Share>,
}

impl Colors {
    fn all(&self) -> impl Iterator<Item = Share> {
        self.rgb.into_iter().chain(self.alpha)
    }
}

/// What an element is, and which of its properties are read.
pub(super) struct Plan {
    role: Role,
    wanted: Vec<bool>,
}

enum Role {
    Vertex { position: [usize; 3], colors: Option<Colors>, uv: Option<[usize; 2]> },
    Face { indices: usize, colors: Option<Colors>, uv: Option<usize>, texture: Option<usize> },
    Strips { indices: usize },
    Other,
}

impl Plan {
    /// An empty row of the element.
    pub fn row(&self, element: &Element) -> Row {
        let count = element.properties.len();
        Row { wanted: self.wanted.clone(), scalars: vec![0.0; count], lists: vec![Vec::new(); count] }
    }
}

/// Colour of a face: its own, or that of its vertices.
#[derive(Clone, Copy)]
enum Paint<'r> {
    /// A texture's material, and the coordinates of the corners where the vertices have none.
    Texture(u32, Option<&'r [f64]>),
    Face([f32; 4]),
    Vertices,
}

pub(super) struct Mesh<'s, 'a, 'h> {
    source: &'s Source<'a>,
    parts: Parts<'s, 'a>,
    textures: &'h [String],
    /// Materials of textures, made when first used.
    materials: Vec<Option<u32>>,
    plain: u32,
    positions: Vec<[f64; 3]>,
    colors: Vec<[f32; 4]>,
    uvs: Vec<[f32; 2]>,
    /// Vertices by position, material, and coordinate or colour.
    known: HashMap<[u32; 6], u32>,
    cutter: Cutter,
}

impl<'s, 'a, 'h> Mesh<'s, 'a, 'h> {
    pub fn new(source: &'s Source<'a>, textures: &'h [String]) -> Self {
        let mut parts = Parts::new(source, source.read_as(Format::Ply, None));
        let plain = parts.material("", [1.0; 3], None);
        Self {
            source,
            parts,
            textures,
            materials: vec![None; textures.len()],
            plain,
            positions: Vec::new(),
            colors: Vec::new(),
            uvs: Vec::new(),
            known: HashMap::new(),
            cutter: Cutter::new(),
        }
    }

    /// What is read of an element.
    pub fn plan(&self, element: &Element) -> Result<Plan, MeshError> {
        let role = match element.name.as_str() {
            "vertex" => {
                if !self.positions.is_empty() {
                    let reason = "there is a second element of that name";
                    return Err(self.source.invalid("element vertex", reason, REEXPORT));
                }
                let position = ["x", "y", "z"].map(|name| scalar(element, &[name]));
                let [Some(x), Some(y), Some(z)] = position else {
                    let reason = "it lacks a property x, y or z";
                    return Err(self.source.invalid("element vertex", reason, REEXPORT));
                };
                if element.count > self.source.limits.vertices {
                    let reason = format!("the model has more than {} vertices", self.source.limits.vertices);
                    let remedy = "simplify it or raise ImportLimits::vertices";
                    return Err(self.source.unsupported("element vertex", reason, remedy));
                }
                let uv = [["s", "u", "texture_u", "texture_s"], ["t", "v", "texture_v", "texture_t"]];
                let uv = match uv.map(|names| scalar(element, &names)) {
                    [Some(u), Some(v)] => Some([u.0, v.0]),
                    _ => None,
                };
                Role::Vertex { position: [x.0, y.0, z.0], colors: self.colors_of(element), uv }
            }
            "face" => match list(element, &["vertex_indices", "vertex_index"]) {
                Some(indices) => Role::Face {
                    indices,
                    colors: self.colors_of(element),
                    uv: list(element, &["texcoord"]),
                    texture: scalar(element, &["texnumber"]).map(|t| t.0),
                },
                None => {
                    let reason = "it lacks a list vertex_indices";
                    return Err(self.source.invalid("element face", reason, REEXPORT));
                }
            },
            "tristrips" => match list(element, &["vertex_indices", "vertex_index"]) {
                Some(indices) => Role::Strips { indices },
                None => Role::Other,
            },
            _ => Role::Other,
        };
        let mut wanted = vec![false; element.properties.len()];
        let mut want = |index: usize| wanted[index] = true;
        match &role {
            Role::Vertex { position, colors, uv } => {
                position.iter().for_each(|&p| want(p));
                colors.iter().flat_map(Colors::all).for_each(|c| want(c.0));
                uv.iter().flatten().for_each(|&u| want(u));
            }
            Role::Face { indices, colors, uv, texture } => {
                want(*indices);
                colors.iter().flat_map(Colors::all).for_each(|c| want(c.0));
                uv.iter().chain(texture).for_each(|&u| want(u));
            }
            Role::Strips { indices } => want(*indices),
            Role::Other => {}
        }
        Ok(Plan { role, wanted })
    }

    /// Adds a row of an element.
    pub fn add(&mut self, plan: &Plan, number: u64, row: &Row) -> Result<(), MeshError> {
        match &plan.role {
            Role::Vertex { position, colors, uv } => {
                let object = || format!("vertex {number}");
                admit_vertex(self.source, self.positions.len(), object)?;
                let position = position.map(|p| row.scalars[p]);
                if !position.iter().all(|c| c.is_finite()) {
                    return Err(self.not_finite(object(), "position"));
                }
                if let Some(colors) = colors {
                    self.colors.push(self.color(object, row, colors)?);
                }
                if let Some(uv) = uv {
                    self.uvs.push(self.coord(object, uv.map(|u| row.scalars[u]))?);
                }
                self.positions.push(position);
            }
            Role::Face { indices, colors, uv, texture } => {
                let own = match colors {
                    Some(colors) => Some(self.color(|| format!("face {number}"), row, colors)?),
                    None => None,
                };
                let corners = &row.lists[*indices];
                let object = || format!("face {number}");
                let coords = uv.map(|uv| row.lists[uv].as_slice()).filter(|list| !list.is_empty());
                if coords.is_some_and(|list| list.len() != 2 * corners.len()) {
                    let reason = "its texcoord does not hold two numbers a corner";
                    return Err(self.source.invalid(object(), reason, REEXPORT));
                }
                let paint = self.paint(number, texture.map(|t| row.scalars[t]), coords, own)?;
                self.face(number, corners, paint)?;
            }
            Role::Strips { indices } => self.strips(number, &row.lists[*indices])?,
            Role::Other => {}
        }
        Ok(())
    }

    /// How a face is coloured.
    fn paint<'r>(
        &mut self,
        number: u64,
        texture: Option<f64>,
        coords: Option<&'r [f64]>,
        own: Option<[f32; 4]>,
    ) -> Result<Paint<'r>, MeshError> {
        let chosen = texture.unwrap_or(0.0);
        let has_coords = coords.is_some() || !self.uvs.is_empty();
        if self.textures.is_empty() || chosen < 0.0 || !has_coords {
            if !self.textures.is_empty() && !has_coords {
                self.source.note("faces", "there are no texture coordinates: the texture is left out");
            }
            return Ok(own.map_or(Paint::Vertices, Paint::Face));
        }
        let index = chosen as usize;
        if index as f64 != chosen || index >= self.textures.len() {
            let reason = format!("texture {chosen} does not exist, there are {}", self.textures.len());
            return Err(self.source.invalid(format!("face {number}"), reason, REEXPORT));
        }
        let material = match self.materials[index] {
            Some(material) => material,
            None => {
                let (object, name) = (format!("texture {index}"), &self.textures[index]);
                let texture = self.parts.texture(&object, name, Sampler::default(), |source| {
                    uri::load_file(source, &object, name)
                })?;
                let material = self.parts.material(name, [1.0; 3], Some(texture));
                self.materials[index] = Some(material);
                material
            }
        };
        Ok(Paint::Texture(material, coords))
    }

    fn face(&mut self, number: u64, corners: &[f64], paint: Paint) -> Result<(), MeshError> {
        let object = || format!("face {number}");
        if !(3..=MAX_CORNERS).contains(&corners.len()) {
            let reason = format!("it has {} corners, 3 to {MAX_CORNERS} are possible", corners.len());
            return Err(self.source.invalid(object(), reason, "repair the mesh and export it again"));
        }
        let mut points = Vec::with_capacity(corners.len());
        let mut vertices = Vec::with_capacity(corners.len());
        for (k, &corner) in corners.iter().enumerate() {
            let index = self.index(object, corner)?;
            points.push(self.positions[index]);
            vertices.push(self.vertex(object, index, k, paint)?);
        }
        let triangles = self.cutter.cut(&points).map_err(|_| {
            let remedy = "triangulate the mesh before export";
            self.source.unsupported(object(), "its polygons are too intricate", remedy)
        })?;
        let material = self.material(paint);
        for triangle in triangles {
            self.parts.triangle(object, triangle.map(|i| vertices[i as usize]), material)?;
        }
        Ok(())
    }

    /// Triangle strips, one after another with -1 between them.
    fn strips(&mut self, number: u64, indices: &[f64]) -> Result<(), MeshError> {
        let object = || format!("tristrips {number}");
        let paint = self.paint(number, None, None, None)?;
        let material = self.material(paint);
        for strip in indices.split(|&i| i < 0.0) {
            for (k, triangle) in strip.windows(3).enumerate() {
                let mut vertices = [0; 3];
                for (vertex, &corner) in vertices.iter_mut().zip(triangle) {
                    let index = self.index(object, corner)?;
                    *vertex = self.vertex(object, index, 0, paint)?;
                }
                if k % 2 == 1 {
                    vertices.swap(0, 1);
                }
                self.parts.triangle(object, vertices, material)?;
            }
        }
        Ok(())
    }

    fn material(&self, paint: Paint) -> u32 {
        match paint {
            Paint::Texture(material, _) => material,
            Paint::Face(_) | Paint::Vertices => self.plain,
        }
    }

    /// A row's index of a vertex that was read before.
    fn index(&self, object: impl FnOnce() -> String, value: f64) -> Result<usize, MeshError> {
        let index = value as usize;
        if index as f64 == value && index < self.positions.len() {
            return Ok(index);
        }
        let reason = format!("vertex {value} does not exist, there are {} before it", self.positions.len());
        Err(self.source.invalid(object(), reason, REEXPORT))
    }

    /// The model's vertex for corner `k` of a face.
    fn vertex(
        &mut self,
        object: impl Fn() -> String,
        index: usize,
        k: usize,
        paint: Paint,
    ) -> Result<u32, MeshError> {
        let material = self.material(paint);
        let (uv, color, [a, b, c, d]) = match paint {
            Paint::Texture(_, Some(coords)) => {
                let uv = self.coord(&object, [coords[2 * k], coords[2 * k + 1]])?;
                (uv, [1.0; 4], [uv[0].to_bits(), uv[1].to_bits(), 1, 0])
            }
            Paint::Texture(_, None) => (self.uvs[index], [1.0; 4], [0; 4]),
            Paint::Face(color) => ([0.0; 2], color, color.map(f32::to_bits)),
            Paint::Vertices => {
                let [r, g, b] = self.source.options.color;
                let color = self.colors.get(index).copied().unwrap_or([r, g, b, 1.0]);
                ([0.0; 2], color, [u32::MAX; 4])
            }
        };
        let key = [index as u32, material, a, b, c, d];
        if let Some(&known) = self.known.get(&key) {
            return Ok(known);
        }
        let new = self.parts.vertex(object, self.positions[index], uv, color)?;
        self.known.insert(key, new);
        Ok(new)
    }

    /// Which properties of an element are its colours.
    fn colors_of(&self, element: &Element) -> Option<Colors> {
        let [r, g, b] =
            [["red", "r", "diffuse_red"], ["green", "g", "diffuse_green"], ["blue", "b", "diffuse_blue"]]
                .map(|names| scalar(element, &names));
        let share = |(index, kind): (usize, Scalar)| (index, kind.full());
        let alpha = scalar(element, &["alpha", "a", "diffuse_alpha"]).map(share);
        let alpha = alpha.filter(|_| self.source.options.opacity);
        Some(Colors { rgb: [r?, g?, b?].map(share), alpha })
    }

    /// A colour of a row, in linear light, and its opacity.
    fn color(
        &self,
        object: impl FnOnce() -> String,
        row: &Row,
        colors: &Colors,
    ) -> Result<[f32; 4], MeshError> {
        let value = |(property, full): Share| row.scalars[property] / full;
        let (srgb, alpha) = (colors.rgb.map(value), colors.alpha.map_or(1.0, value));
        if !srgb.iter().chain([&alpha]).all(|c| c.is_finite()) {
            return Err(self.not_finite(object(), "colour"));
        }
        if srgb.iter().any(|c| !(0.0..=1.0).contains(c)) {
            self.source.note("colours", "a colour outside its range was clamped");
        }
        let [r, g, b] = parts::linear(srgb);
        Ok([r, g, b, alpha.clamp(0.0, 1.0) as f32])
    }

    /// A texture coordinate of the file, v up, as the model's, v down.
    fn coord(&self, object: impl FnOnce() -> String, [u, v]: [f64; 2]) -> Result<[f32; 2], MeshError> {
        let uv = [u as f32, (1.0 - v) as f32];
        if uv.iter().all(|c| c.is_finite()) {
            return Ok(uv);
        }
        Err(self.not_finite(object(), "texture coordinate"))
    }

    fn not_finite(&self, object: String, what: &str) -> MeshError {
        let reason = format!("its {what} is NaN or infinite");
        self.source.invalid(object, reason, "repair the mesh and export it again")
    }

    pub fn finish(self) -> Result<Model, MeshError> {
        self.parts.finish("export a mesh with faces; points alone are no solid")
    }
}

/// Position and type of the first scalar property of one of these names.
fn scalar(element: &Element, names: &[&str]) -> Option<(usize, Scalar)> {
    let index = element.position(names)?;
    match element.properties[index].kind {
        Kind::Scalar(kind) => Some((index, kind)),
        Kind::List { .. } => None,
    }
}

/// Position of the first list of one of these names.
fn list(element: &Element, names: &[&str]) -> Option<usize> {
    let index = element.position(names)?;
    matches!(element.properties[index].kind, Kind::List { .. }).then_some(index)
}
