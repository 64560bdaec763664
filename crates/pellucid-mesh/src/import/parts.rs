//! A model as the readers of other formats than glTF build it: vertices, triangles, materials and
//! textures, each within the limits.

#![cfg_attr(
    not(any(feature = "obj", feature = "ply", feature = "3mf")),
    allow(dead_code, reason = "STL alone has no textures and no colours")
)]

use std::collections::BTreeMap;
#[cfg(feature = "obj")]
use std::sync::Arc;

use super::picture::{Decoded, Profiles};
use super::source::Source;
use super::{ReadAs, picture};
use crate::opacity::{HALF, Opacity};
use crate::texture::{Sampler, Texture, srgb_to_linear};
use crate::{BaseColor, MeshError, Model, Triangle, Vertex};

/// The mesh as it grows.
pub(super) struct Parts<'s, 'a> {
    pub source: &'s Source<'a>,
    read_as: ReadAs,
    vertices: Vec<Vertex>,
    triangles: Vec<Triangle>,
    materials: Vec<BaseColor>,
    textures: Vec<Texture>,
    images: BTreeMap<String, Decoded>,
    /// Of textures that are see-through somewhere, the texture of their opacity.
    opacities: BTreeMap<u32, u32>,
    /// One a material, if opacity counts.
    opacity: Vec<Option<Opacity>>,
    texture_budget: u64,
    /// Triangles whose corners are not three.
    collapsed: usize,
}

impl<'s, 'a> Parts<'s, 'a> {
    pub fn new(source: &'s Source<'a>, read_as: ReadAs) -> Self {
        Self {
            source,
            read_as,
            vertices: Vec::new(),
            triangles: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            images: BTreeMap::new(),
            opacities: BTreeMap::new(),
            opacity: Vec::new(),
            texture_budget: source.limits.texture_bytes,
            collapsed: 0,
        }
    }

    /// Adds a vertex at a point of the file; `object` says what errors call the place.
    pub fn vertex(
        &mut self,
        object: impl FnOnce() -> String,
        position: [f64; 3],
        uv: [f32; 2],
        [r, g, b, a]: [f32; 4],
    ) -> Result<u32, MeshError> {
        admit_vertex(self.source, self.vertices.len(), object)?;
        let position_m = self.read_as.to_print_m(position);
        let a = if self.source.options.opacity { a } else { 1.0 };
        self.vertices.push(Vertex { position_m, uv, color: [r, g, b, a] });
        Ok(self.vertices.len() as u32 - 1)
    }

    /// Adds a triangle, unless two of its corners are one.
    pub fn triangle(
        &mut self,
        object: impl FnOnce() -> String,
        vertices: [u32; 3],
        material: u32,
    ) -> Result<(), MeshError> {
        // Those that are left out count too: they take their time.
        admit_triangle(self.source, self.triangles.len() + self.collapsed, object)?;
        let [a, b, c] = vertices;
        if a == b || b == c || c == a {
            self.collapsed += 1;
            return Ok(());
        }
        self.triangles.push(Triangle { vertices, material });
        Ok(())
    }

    /// Adds a material of one linear colour, by which a texture or vertex colours are multiplied. It
    /// shows from both sides: formats other than glTF know no other kind.
    #[cfg(any(feature = "ply", feature = "stl", feature = "3mf"))]
    pub fn material(&mut self, name: &str, rgb: [f32; 3], texture: Option<u32>) -> u32 {
        let opacity = texture.and_then(|t| self.opacities.get(&t).copied());
        self.translucent(name, rgb, texture, 1.0, opacity)
    }

    /// The same with an opacity, which one of a texture multiplies.
    pub fn translucent(
        &mut self,
        name: &str,
        [r, g, b]: [f32; 3],
        texture: Option<u32>,
        alpha: f32,
        opacity: Option<u32>,
    ) -> u32 {
        let counts = self.source.options.opacity;
        let factor = [r, g, b, if counts { alpha } else { 1.0 }];
        self.materials.push(BaseColor { name: name.to_owned(), factor, texture, double_sided: true });
        self.opacity.push(counts.then_some(Opacity { texture: opacity, threshold: HALF }));
        self.materials.len() as u32 - 1
    }

    /// The opacity of a texture that was added, if it is see-through somewhere.
    #[cfg(feature = "obj")]
    pub fn opacity_of(&self, texture: u32) -> Option<u32> {
        self.opacities.get(&texture).copied()
    }

    /// Adds a texture of the image that `key` names, decoded the first time; `load` gives its bytes.
    pub fn texture(
        &mut self,
        object: &str,
        key: &str,
        sampler: Sampler,
        load: impl FnOnce(&Source<'a>) -> Result<Vec<u8>, MeshError>,
    ) -> Result<u32, MeshError> {
        let decoded = match self.images.get(key) {
            Some(known) => known.clone(),
            None => {
                let bytes = load(self.source)?;
                let decoded =
                    picture::decode(self.source, object, &bytes, Profiles::Heeded, &mut self.texture_budget)?;
                self.images.insert(key.to_owned(), decoded.clone());
                decoded
            }
        };
        self.textures.push(Texture::new(decoded.image, sampler));
        let texture = self.textures.len() as u32 - 1;
        if let Some(opacity) = decoded.opacity {
            self.textures.push(Texture::new(opacity, sampler));
            self.opacities.insert(texture, texture + 1);
        }
        Ok(texture)
    }

    /// Adds a texture of opacities: an image's alpha, or its lightness where it has none.
    #[cfg(feature = "obj")]
    pub fn opacity_texture(
        &mut self,
        object: &str,
        bytes: &[u8],
        sampler: Sampler,
    ) -> Result<u32, MeshError> {
        let image = picture::decode_opacity(self.source, object, bytes, &mut self.texture_budget)?;
        self.textures.push(Texture::new(Arc::new(image), sampler));
        Ok(self.textures.len() as u32 - 1)
    }

    /// The model; `none` is the remedy if it has no triangles.
    pub fn finish(self, none: &str) -> Result<Model, MeshError> {
        let source = self.source;
        if self.collapsed > 0 {
            source.note("model", format!("{} triangles without area are left out", self.collapsed));
        }
        if self.triangles.is_empty() {
            return Err(source.invalid("model", "it has no triangles", none));
        }
        let model = Model::new(source.file, self.vertices, self.triangles, self.materials, self.textures)?;
        let model = match source.options.opacity {
            true => model.with_opacity(self.opacity)?,
            false => model,
        };
        Ok(model.with_read_as(self.read_as))
    }
}

/// Checks that one more vertex than `count` is within the limits.
pub(super) fn admit_vertex(
    source: &Source,
    count: usize,
    object: impl FnOnce() -> String,
) -> Result<(), MeshError> {
    let limit = source.limits.vertices.min(u64::from(u32::MAX));
    if (count as u64) < limit {
        return Ok(());
    }
    Err(source.unsupported(
        object(),
        format!("the model has more than {limit} vertices"),
        "simplify it or raise ImportLimits::vertices",
    ))
}

/// Checks that one more triangle than `count` is within the limits.
pub(super) fn admit_triangle(
    source: &Source,
    count: usize,
    object: impl FnOnce() -> String,
) -> Result<(), MeshError> {
    let limit = source.limits.triangles;
    if (count as u64) < limit {
        return Ok(());
    }
    Err(source.unsupported(
        object(),
        format!("the model has more than {limit} triangles"),
        "simplify it or raise ImportLimits::triangles",
    ))
}

/// A display colour (sRGB) as linear light.
pub(super) fn linear(srgb: [f64; 3]) -> [f32; 3] {
    srgb.map(|c| srgb_to_linear(c.clamp(0.0, 1.0)) as f32)
}
