//! Materials: base-colour factor, texture with sampler, and the texture coordinates it uses.

use std::collections::BTreeMap;

use super::REEXPORT;
use super::buffers::Buffers;
use super::schema::{Sampler as SamplerJson, TextureInfo};
use super::{extensions, images};
use crate::import::picture::Decoded;
use crate::import::source::label;
use crate::opacity::HALF;
use crate::texture::{Filter, Mip, Sampler, Texture, Wrap};
use crate::{BaseColor, MeshError, Opacity};

/// Where a material's texture coordinates come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TexCoord {
    /// The `n` of `TEXCOORD_n`.
    pub set: usize,
    /// Rows of the affine map from the file's coordinates to the texture's.
    pub rows: [[f64; 3]; 2],
}

impl TexCoord {
    pub fn apply(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        self.rows.map(|[a, b, c]| a * u + b * v + c)
    }
}

/// A material as primitives refer to it.
#[derive(Clone, Copy)]
pub(super) struct Resolved {
    /// Index among the model's materials.
    pub index: u32,
    pub tex_coord: Option<TexCoord>,
}

/// The materials in use, their textures decoded once each.
pub(super) struct Materials<'b, 'a> {
    buffers: &'b Buffers<'a>,
    resolved: BTreeMap<Option<usize>, Resolved>,
    images: BTreeMap<usize, Decoded>,
    texture_indices: BTreeMap<usize, u32>,
    /// Of textures that are see-through somewhere, the texture of their opacity.
    opacities: BTreeMap<u32, u32>,
    texture_budget: u64,
    pub base_colors: Vec<BaseColor>,
    /// One a base colour.
    pub opacity: Vec<Option<Opacity>>,
    pub textures: Vec<Texture>,
}

impl<'b, 'a> Materials<'b, 'a> {
    pub fn new(buffers: &'b Buffers<'a>) -> Self {
        Self {
            buffers,
            resolved: BTreeMap::new(),
            images: BTreeMap::new(),
            texture_indices: BTreeMap::new(),
            opacities: BTreeMap::new(),
            opacity: Vec::new(),
            texture_budget: buffers.source().limits.texture_bytes,
            base_colors: Vec::new(),
            textures: Vec::new(),
        }
    }

    /// A primitive's material; `None` is glTF's default, plain white. `object` is the primitive.
    pub fn resolve(&mut self, object: &str, material: Option<usize>) -> Result<Resolved, MeshError> {
        if let Some(&resolved) = self.resolved.get(&material) {
            return Ok(resolved);
        }
        let (color, tex_coord, threshold) = match material {
            Some(index) => self.read(object, index)?,
            None => (
                BaseColor { name: String::new(), factor: [1.0; 4], texture: None, double_sided: false },
                None,
                None,
            ),
        };
        let texture = color.texture.and_then(|t| self.opacities.get(&t).copied());
        self.opacity.push(threshold.map(|threshold| Opacity { texture, threshold }));
        let resolved = Resolved { index: self.base_colors.len() as u32, tex_coord };
        self.base_colors.push(color);
        self.resolved.insert(material, resolved);
        Ok(resolved)
    }

    /// The base colour of a material, where its coordinates come from, and below which alpha it is see-through.
    fn read(
        &mut self,
        object: &str,
        index: usize,
    ) -> Result<(BaseColor, Option<TexCoord>, Option<f32>), MeshError> {
        let (source, root) = (self.buffers.source(), self.buffers.root());
        let Some(material) = root.materials.get(index) else {
            return Err(source.invalid(
                object,
                format!("material {index} does not exist, there are {}", root.materials.len()),
                REEXPORT,
            ));
        };
        let object = label("material", index, material.name.as_deref());
        let mode = material.alpha_mode.as_deref().filter(|mode| *mode != "OPAQUE");
        let threshold = match mode {
            Some(_) if !source.options.opacity => {
                source.note(&object, "its transparency is ignored: prints are opaque");
                None
            }
            Some("MASK") => Some(material.alpha_cutoff.map_or(HALF, |c| c.clamp(0.0, 1.0) as f32)),
            other => other.map(|_| HALF),
        };
        // The factor multiplies the texture, and is black by default.
        if material.emissive_factor.is_some_and(|factor| factor.iter().any(|&c| c > 0.0)) {
            source.note(&object, "its emission is left out: only its base colour is printed");
        }
        let (factor, texture) = match &material.extensions.specular_glossiness {
            Some(s) => (s.diffuse_factor, &s.diffuse_texture),
            None => {
                let m = &material.pbr_metallic_roughness;
                (m.base_color_factor, &m.base_color_texture)
            }
        };
        let factor = factor.unwrap_or([1.0; 4]);
        if factor.iter().any(|c| !(0.0..=1.0).contains(c)) {
            source.note(&object, "its colour factor is outside 0..1 and was clamped");
        }
        let (texture, tex_coord) = match texture {
            Some(info) => {
                let texture = self.texture(&object, info.index)?;
                (Some(texture), Some(tex_coord(info)))
            }
            None => (None, None),
        };
        let color = BaseColor {
            name: material.name.clone().unwrap_or_default(),
            factor: factor.map(|c| c.clamp(0.0, 1.0) as f32),
            texture,
            double_sided: material.double_sided.unwrap_or(false),
        };
        Ok((color, tex_coord, threshold))
    }

    fn texture(&mut self, object: &str, index: usize) -> Result<u32, MeshError> {
        if let Some(&known) = self.texture_indices.get(&index) {
            return Ok(known);
        }
        let (source, root) = (self.buffers.source(), self.buffers.root());
        let Some(texture) = root.textures.get(index) else {
            return Err(source.invalid(
                object,
                format!("texture {index} does not exist, there are {}", root.textures.len()),
                REEXPORT,
            ));
        };
        let object = format!("{object}, {}", label("texture", index, texture.name.as_deref()));
        let webp = texture.extensions.get(extensions::WEBP).and_then(|e| e.get("source")?.as_u64());
        let webp = webp.map(|source| source as usize);
        let Some(image) = webp.filter(|_| cfg!(feature = "webp")).or(texture.source) else {
            return Err(extensions::no_plain_source(source, &object, texture.extensions.keys()));
        };
        let sampler = match texture.sampler {
            None => Sampler::default(),
            Some(i) => match root.samplers.get(i) {
                Some(json) => self.sampler(&label("sampler", i, None), json)?,
                None => {
                    return Err(source.invalid(
                        object,
                        format!("sampler {i} does not exist, there are {}", root.samplers.len()),
                        REEXPORT,
                    ));
                }
            },
        };
        let decoded = match self.images.get(&image) {
            Some(decoded) => decoded.clone(),
            None => {
                let decoded = images::decode(self.buffers, image, &mut self.texture_budget)?;
                self.images.insert(image, decoded.clone());
                decoded
            }
        };
        let position = self.textures.len() as u32;
        self.textures.push(Texture::new(decoded.image, sampler));
        if let Some(opacity) = decoded.opacity {
            self.textures.push(Texture::new(opacity, sampler));
            self.opacities.insert(position, position + 1);
        }
        self.texture_indices.insert(index, position);
        Ok(position)
    }

    fn sampler(&self, object: &str, json: &SamplerJson) -> Result<Sampler, MeshError> {
        let invalid = |field: &str, value: u32| {
            self.buffers.source().invalid(
                object,
                format!("{field} {value} is not one of glTF's values"),
                REEXPORT,
            )
        };
        let wrap = |field: &str, value: Option<u32>| match value {
            None | Some(10497) => Ok(Wrap::Repeat),
            Some(33648) => Ok(Wrap::Mirrored),
            Some(33071) => Ok(Wrap::Clamp),
            Some(other) => Err(invalid(field, other)),
        };
        let (minify, mip) = match json.min_filter {
            None | Some(9729 | 9987) => (Filter::Linear, Mip::Linear),
            Some(9728 | 9986) => (Filter::Nearest, Mip::Linear),
            Some(9984) => (Filter::Nearest, Mip::Nearest),
            Some(9985) => (Filter::Linear, Mip::Nearest),
            Some(other) => return Err(invalid("minFilter", other)),
        };
        let magnify = match json.mag_filter {
            None | Some(9729) => Filter::Linear,
            Some(9728) => Filter::Nearest,
            Some(other) => return Err(invalid("magFilter", other)),
        };
        Ok(Sampler {
            wrap_u: wrap("wrapS", json.wrap_s)?,
            wrap_v: wrap("wrapT", json.wrap_t)?,
            magnify,
            minify,
            mip,
        })
    }
}

/// The coordinate set and `KHR_texture_transform` of a texture reference.
///
/// The transform scales, then rotates, then offsets. Seen in the coordinates (v down) a positive
/// rotation takes +v to +u: the direction of the extension's worked example, which the first
/// drafts' shader code had the other way round (KhronosGroup/glTF issue 1563).
fn tex_coord(info: &TextureInfo) -> TexCoord {
    let Some(transform) = &info.extensions.transform else {
        return TexCoord { set: info.tex_coord, rows: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] };
    };
    let (sin, cos) = transform.rotation.unwrap_or(0.0).sin_cos();
    let [x, y] = transform.offset.unwrap_or([0.0; 2]);
    let [w, h] = transform.scale.unwrap_or([1.0; 2]);
    TexCoord {
        set: transform.tex_coord.unwrap_or(info.tex_coord),
        rows: [[cos * w, sin * h, x], [-sin * w, cos * h, y]],
    }
}
