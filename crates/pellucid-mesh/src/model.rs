//! The imported mesh and its colour.

use crate::geometry::{Bounds, has_area};
use crate::import::ReadAs;
use crate::opacity::Opacity;
use crate::{MeshError, Texture};

/// A corner of triangles of one material.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vertex {
    /// Position in metres, print axes (z up).
    pub position_m: [f64; 3],
    /// Texture coordinate of the material's base colour, texture transform applied.
    pub uv: [f32; 2],
    /// Linear RGBA vertex colour; 1 where the file has none.
    pub color: [f32; 4],
}

/// Three corners, counter-clockwise seen from outside, and their material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Triangle {
    /// Indices into [`Model::vertices`].
    pub vertices: [u32; 3],
    /// Index into [`Model::materials`].
    pub material: u32,
}

/// Base colour of a material, and from which side it shows.
#[derive(Debug, Clone, PartialEq)]
pub struct BaseColor {
    /// The material's name, or empty.
    pub name: String,
    /// Linear RGBA factor.
    pub factor: [f32; 4],
    /// Index into [`Model::textures`].
    pub texture: Option<u32>,
    /// Sheets show from behind too; without it only from the side they face.
    pub double_sided: bool,
}

/// Something the importer left out or put right.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Note {
    /// The part of the file.
    pub object: String,
    /// What was done with it.
    pub text: String,
}

/// A textured triangle mesh in print axes and metres.
///
/// Vertices are not shared between materials or primitives; neighbours along such a seam (and
/// along a texture seam) meet in position only.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    name: String,
    vertices: Vec<Vertex>,
    triangles: Vec<Triangle>,
    materials: Vec<BaseColor>,
    textures: Vec<Texture>,
    pub(crate) opacity: Vec<Option<Opacity>>,
    notes: Vec<Note>,
    read_as: Option<ReadAs>,
}

/// Largest coordinate that a model may have, in metres.
pub const MAX_COORDINATE_M: f64 = 1e9;

impl Model {
    /// Checks and joins the parts; `name` is what errors call the model.
    ///
    /// # Errors
    /// [`MeshError::Invalid`] if there is no triangle, an index is out of range, or a position,
    /// texture coordinate or colour is not finite; [`MeshError::Unsupported`] if a coordinate
    /// passes [`MAX_COORDINATE_M`] or a count passes `u32`.
    pub fn new(
        name: impl Into<String>,
        vertices: Vec<Vertex>,
        triangles: Vec<Triangle>,
        materials: Vec<BaseColor>,
        textures: Vec<Texture>,
    ) -> Result<Self, MeshError> {
        let name = name.into();
        let fail = |object: String, reason: &str, remedy: &str| {
            Err(MeshError::invalid(name.clone(), object, reason, remedy))
        };
        if triangles.is_empty() {
            return fail("model".into(), "it has no triangles", "export a mesh with faces");
        }
        for (i, v) in vertices.iter().enumerate() {
            if !v.position_m.iter().all(|c| c.is_finite()) {
                return fail(format!("vertex {i}"), "its position is not finite", "repair the mesh");
            }
            if v.position_m.iter().any(|c| c.abs() > MAX_COORDINATE_M) {
                return Err(MeshError::unsupported(
                    name,
                    format!("vertex {i}"),
                    format!("a coordinate is beyond {MAX_COORDINATE_M:e} m"),
                    "move or scale the model near the origin",
                ));
            }
            if !(v.uv.iter().all(|c| c.is_finite()) && v.color.iter().all(|c| c.is_finite())) {
                return fail(
                    format!("vertex {i}"),
                    "its texture coordinate or colour is not finite",
                    "repair the mesh",
                );
            }
        }
        if let Some(i) = triangles.iter().position(|t| {
            t.material as usize >= materials.len() || t.vertices.iter().any(|&v| v as usize >= vertices.len())
        }) {
            return fail(format!("triangle {i}"), "an index is out of range", "fix the indices");
        }
        for (i, m) in materials.iter().enumerate() {
            if m.texture.is_some_and(|t| t as usize >= textures.len()) {
                return fail(format!("material {i}"), "its texture is out of range", "fix the index");
            }
            if !m.factor.iter().all(|c| c.is_finite()) {
                return fail(format!("material {i}"), "its colour factor is not finite", "fix the factor");
            }
        }
        let (opacity, notes) = (Vec::new(), Vec::new());
        Ok(Self { name, vertices, triangles, materials, textures, opacity, notes, read_as: None })
    }

    /// The same model with the triangles alone for which `keep` holds, by index; at least one must.
    pub(crate) fn keeping(mut self, keep: impl Fn(u32) -> bool) -> Self {
        let kept = (0..).zip(&self.triangles).filter(|(t, _)| keep(*t)).map(|(_, t)| *t);
        self.triangles = kept.collect();
        self
    }

    /// The same model without the triangles for which `drop` is true, one entry a triangle; `None` if none is left.
    pub fn without(&self, drop: &[bool]) -> Option<Self> {
        let dropped = |t: u32| drop.get(t as usize).copied().unwrap_or(false);
        let left = (0..self.triangles.len() as u32).any(|t| !dropped(t));
        left.then(|| self.clone().keeping(|t| !dropped(t)))
    }

    /// The same model with the importer's notes.
    #[must_use]
    pub fn with_notes(self, notes: Vec<Note>) -> Self {
        Self { notes, ..self }
    }

    /// The same model with how its file was read.
    #[must_use]
    pub(crate) fn with_read_as(self, read_as: ReadAs) -> Self {
        Self { read_as: Some(read_as), ..self }
    }

    /// The name of the file it came from.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// All vertices.
    pub fn vertices(&self) -> &[Vertex] {
        &self.vertices
    }

    /// All triangles; at least one.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// Base colours, as triangles refer to them.
    pub fn materials(&self) -> &[BaseColor] {
        &self.materials
    }

    /// Textures, as materials refer to them.
    pub fn textures(&self) -> &[Texture] {
        &self.textures
    }

    /// What the importer left out or put right.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// How its file was read: format, length unit, up axis; none for a model that was not imported.
    pub fn read_as(&self) -> Option<&ReadAs> {
        self.read_as.as_ref()
    }

    /// The corners' positions of a triangle in metres.
    ///
    /// # Panics
    /// If `triangle` is not an index of [`Model::triangles`].
    pub fn corners_m(&self, triangle: u32) -> [[f64; 3]; 3] {
        self.triangles[triangle as usize].vertices.map(|v| self.vertices[v as usize].position_m)
    }

    /// Lowest and highest corner of the box around all triangles that have an area, in metres:
    /// what is collapsed to a line or a point shows nowhere. Around all triangles where none has.
    pub fn bounds_m(&self) -> [[f64; 3]; 2] {
        let around = |count: &dyn Fn(&[[f64; 3]; 3]) -> bool| {
            let corners = (0..self.triangles.len() as u32).map(|t| self.corners_m(t)).filter(|c| count(c));
            Bounds::of(corners.flatten())
        };
        let bounds = around(&|c| has_area(*c));
        let Bounds { min, max } = if bounds == Bounds::EMPTY { around(&|_| true) } else { bounds };
        [min, max]
    }

    /// Linear RGB (0..1) of a surface point: base-colour factor x texture x vertex colour.
    ///
    /// `barycentric` weighs the triangle's corners (sum 1). The texture is averaged over a patch
    /// of the surface `footprint_m` metres wide around the point; 0 reads the texture as
    /// magnified. Alpha does not count: see [`Model::is_clear_at`].
    ///
    /// # Panics
    /// If `triangle` is not an index of [`Model::triangles`].
    pub fn color_at(&self, triangle: u32, barycentric: [f64; 3], footprint_m: f64) -> [f32; 3] {
        let t = self.triangles[triangle as usize];
        let corners = t.vertices.map(|v| &self.vertices[v as usize]);
        let material = &self.materials[t.material as usize];
        let blend = |f: &dyn Fn(&Vertex) -> f32| -> f64 {
            (0..3).map(|k| barycentric[k] * f64::from(f(corners[k]))).sum()
        };
        let mut rgb: [f64; 3] =
            std::array::from_fn(|c| f64::from(material.factor[c]) * blend(&|v| v.color[c]));
        if let Some(texture) = material.texture {
            let texel = self.texel_at(triangle, texture, barycentric, footprint_m);
            (0..3).for_each(|c| rgb[c] *= f64::from(texel[c]));
        }
        rgb.map(|c| c.clamp(0.0, 1.0) as f32)
    }

    /// A texture at a surface point, averaged over a patch `footprint_m` metres wide.
    pub(crate) fn texel_at(
        &self,
        triangle: u32,
        texture: u32,
        barycentric: [f64; 3],
        footprint_m: f64,
    ) -> [f32; 3] {
        self.texel_of(&self.textures[texture as usize], triangle, barycentric, footprint_m)
    }

    /// The same of a texture that need not be the model's.
    pub(crate) fn texel_of(
        &self,
        texture: &Texture,
        triangle: u32,
        barycentric: [f64; 3],
        footprint_m: f64,
    ) -> [f32; 3] {
        let corners = self.triangles[triangle as usize].vertices.map(|v| &self.vertices[v as usize]);
        let uv =
            [0, 1].map(|i| (0..3).map(|k| barycentric[k] * f64::from(corners[k].uv[i])).sum::<f64>() as f32);
        let axes = footprint_axes(corners, footprint_m);
        texture.sample_anisotropic(uv, axes)
    }

    /// Texels of a texture along the edge of a triangle that has most.
    pub(crate) fn texels_along(&self, triangle: u32, texture: u32) -> f64 {
        let uvs = self.triangles[triangle as usize].vertices.map(|v| self.vertices[v as usize].uv);
        let size = self.textures[texture as usize].size();
        let texels = |a: usize, b: usize| {
            let along = |i: usize| f64::from(uvs[a][i] - uvs[b][i]) * f64::from(size[i]);
            along(0).hypot(along(1))
        };
        texels(0, 1).max(texels(1, 2)).max(texels(2, 0))
    }
}

/// The change of uv along two orthogonal directions in the triangle's plane, each `size` metres
/// long; zero for a degenerate triangle.
fn footprint_axes(corners: [&Vertex; 3], size: f64) -> [[f64; 2]; 2] {
    let [a, b, c] = corners.map(|v| glam::DVec3::from(v.position_m));
    let [ua, ub, uc] = corners.map(|v| glam::DVec2::new(f64::from(v.uv[0]), f64::from(v.uv[1])));
    let (e1, e2) = (b - a, c - a);
    let x = e1.normalize_or_zero();
    let (x2, y_vector) = (e2.dot(x), e2 - x * e2.dot(x));
    let (x1, y2) = (e1.length(), y_vector.length());
    if !(size > 0.0 && x1 > 0.0 && y2 > 0.0) {
        return [[0.0; 2]; 2];
    }
    let du_dx = (ub - ua) / x1;
    let du_dy = (uc - ua - du_dx * x2) / y2;
    let axes = [(du_dx * size).into(), (du_dy * size).into()];
    if axes.as_flattened().iter().all(|v: &f64| v.is_finite()) { axes } else { [[0.0; 2]; 2] }
}
