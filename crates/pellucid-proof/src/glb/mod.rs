//! A print's appearance as a glTF 2.0 model.

mod bytes;

use std::path::Path;

use pellucid_color::space::srgb_encode_u8;
use pellucid_core::{Control, FileError, files};
use pellucid_voxel::{LabelGrid, Surface};
use rayon::prelude::*;
use serde_json::{Value, json};

use crate::{ProofError, SurfaceMesh};
use bytes::Bytes;

/// Most bytes of a file.
pub const GLB_LIMIT: u64 = 20_000_000;

/// Bytes of a quad: four corners of place and texture coordinate, six indices, and most that its texels take.
const QUAD_BYTES: u64 = 4 * (12 + 4) + 6 * 4;
const TEXEL_BYTES: u64 = 4;
/// Room for the JSON and the headers of the pictures.
const HEAD_BYTES: u64 = 64 << 10;
const MM_PER_M: f32 = 1000.0;
/// `componentType`s and `target`s of glTF.
const F32: u32 = 5126;
const U16: u32 = 5123;
const U32: u32 = 5125;
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;
const NEAREST: u32 = 9728;
const CLAMP: u32 = 33071;

/// One look of the print: what a variant of the model shows.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    /// The variant's name.
    pub name: &'a str,
    /// Linear RGB of every surface voxel.
    pub colors: &'a [[f32; 3]],
}

/// A model in a file's bytes.
#[derive(Clone, Debug)]
pub struct Glb {
    bytes: Vec<u8>,
    cell_mm: [f64; 3],
    quads: usize,
}

impl Glb {
    /// The finest model of the surface whose file stays below [`GLB_LIMIT`]: quads of one colour each over cells of whole voxels
    /// ([`SurfaceMesh`]), in metres with +Y up, unlit (`KHR_materials_unlit`), so that viewers show the colours as they are.
    /// The first look is the default, the others are variants (`KHR_materials_variants`).
    ///
    /// ```
    /// use pellucid_proof::glb::{Glb, Look};
    /// use pellucid_voxel::{Control, Frame, LabelGrid, Pitch, Surface, SurfaceOptions};
    /// let frame = Frame::new([0.0; 3], Pitch::j750(), [24, 12, 36])?;
    /// let grid = LabelGrid::from_fn(frame, |_| 5);
    /// let surface = Surface::extract(&grid, &SurfaceOptions::default(), &Control::none())?;
    /// let [target, refined] = [[0.8, 0.4, 0.1], [0.7, 0.4, 0.2]].map(|rgb| vec![rgb; surface.len()]);
    /// let looks = [Look { name: "refined", colors: &refined }, Look { name: "target", colors: &target }];
    /// let glb = Glb::of(&grid, &surface, &looks, &Control::none())?;
    /// assert!(glb.bytes().starts_with(b"glTF"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`ProofError::Invalid`] without a look, or when one has not a colour a surface voxel; as [`SurfaceMesh::build`];
    /// [`ProofError::Cancelled`].
    pub fn of(
        labels: &LabelGrid,
        surface: &Surface,
        looks: &[Look<'_>],
        control: &Control<'_>,
    ) -> Result<Self, ProofError> {
        if looks.is_empty() {
            return Err(ProofError::invalid("looks", "a model needs one at least"));
        }
        let each = QUAD_BYTES + TEXEL_BYTES * looks.len() as u64;
        let mut most = (GLB_LIMIT - HEAD_BYTES) / each;
        loop {
            let mesh = SurfaceMesh::build(labels, surface, most as usize, control)?;
            // Usually there are about as many quads as vertices.
            let quads = mesh.quads().len() as u64;
            if quads * each + HEAD_BYTES <= GLB_LIMIT {
                return Self::of_mesh(&mesh, looks, control);
            }
            most = most * 9 / 10;
        }
    }

    fn of_mesh(mesh: &SurfaceMesh, looks: &[Look<'_>], control: &Control<'_>) -> Result<Self, ProofError> {
        let quads = mesh.quads().len();
        let edge = (quads as f64).sqrt().ceil().max(1.0) as usize;
        let mut bytes = Bytes::default();
        let places = corners(mesh);
        let position = bytes.view(places.iter().flatten().flat_map(|v| v.to_le_bytes()), Some(VERTICES));
        control.check()?;
        let texel = |at: usize| ((at as f64 + 0.5) / edge as f64 * 65_535.0).round() as u16;
        let uvs = (0..quads).flat_map(|i| [[texel(i % edge), texel(i / edge)]; 4]);
        let uv = bytes.view(uvs.flatten().flat_map(u16::to_le_bytes), Some(VERTICES));
        let triangles = (0..quads as u32).flat_map(|i| [0, 1, 2, 0, 2, 3].map(|corner| 4 * i + corner));
        let index = bytes.view(triangles.flat_map(u32::to_le_bytes), Some(INDICES));
        let mut images = Vec::with_capacity(looks.len());
        for look in looks {
            control.check()?;
            let texels = texels(mesh, look, edge)?;
            let picture = png_of(&texels, edge as u32).map_err(FileError::at("write", "model"))?;
            images.push(bytes.view(picture.into_iter(), None));
        }
        let [low, high] = bounds(&places);
        let accessors = json!([
            { "bufferView": position, "componentType": F32, "count": places.len(), "type": "VEC3", "min": low, "max": high },
            { "bufferView": uv, "componentType": U16, "normalized": true, "count": places.len(), "type": "VEC2" },
            { "bufferView": index, "componentType": U32, "count": 6 * quads, "type": "SCALAR" },
        ]);
        let document = document(mesh, looks, &images, accessors, &bytes);
        Ok(Self { bytes: bytes.into_glb(&document.to_string()), cell_mm: mesh.cell_mm(), quads })
    }

    /// The file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Edges `[x, y, z]` of the cells whose sides are one quad each, in mm of the print.
    pub fn cell_mm(&self) -> [f64; 3] {
        self.cell_mm
    }

    /// Quads of one colour.
    pub fn quads(&self) -> usize {
        self.quads
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// [`ProofError::Io`].
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), ProofError> {
        Ok(files::write_whole_bytes(path, &self.bytes)?)
    }
}

/// Corners of all quads in metres, +Y up: print x, z and -y.
fn corners(mesh: &SurfaceMesh) -> Vec<[f32; 3]> {
    let place = |&vertex: &u32| {
        let [x, y, z] = mesh.positions_mm()[vertex as usize];
        [x, z, -y].map(|mm| mm / MM_PER_M)
    };
    mesh.quads().iter().flatten().map(place).collect()
}

fn bounds(places: &[[f32; 3]]) -> [[f32; 3]; 2] {
    let extreme = |from: f32, choose: fn(f32, f32) -> f32| {
        std::array::from_fn(|a| places.iter().map(|p| p[a]).fold(from, choose))
    };
    [extreme(f32::INFINITY, f32::min), extreme(f32::NEG_INFINITY, f32::max)]
}

/// A texel a quad, the mean of its corners in sRGB, in rows of `edge`; black where there is no quad.
fn texels(mesh: &SurfaceMesh, look: &Look<'_>, edge: usize) -> Result<Vec<[u8; 3]>, ProofError> {
    let means = mesh.means(look.colors)?;
    let color = |quad: &[u32; 4]| {
        std::array::from_fn(|c| {
            let sum: f64 = quad.iter().map(|&vertex| f64::from(means[vertex as usize][c])).sum();
            srgb_encode_u8(sum / 4.0)
        })
    };
    let mut texels: Vec<[u8; 3]> = mesh.quads().par_iter().map(color).collect();
    texels.resize(edge * edge, [0; 3]);
    Ok(texels)
}

fn png_of(texels: &[[u8; 3]], edge: u32) -> Result<Vec<u8>, std::io::Error> {
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, edge, edge);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(texels.as_flattened())?;
    writer.finish()?;
    Ok(out)
}

fn document(
    mesh: &SurfaceMesh,
    looks: &[Look<'_>],
    images: &[usize],
    accessors: Value,
    bytes: &Bytes,
) -> Value {
    let material = |i: usize| {
        json!({
            "name": looks[i].name,
            "pbrMetallicRoughness": { "baseColorTexture": { "index": i }, "metallicFactor": 0, "roughnessFactor": 1 },
            "extensions": { "KHR_materials_unlit": {} },
        })
    };
    let every = |make: &dyn Fn(usize) -> Value| (0..looks.len()).map(make).collect::<Value>();
    let primitive = json!({
        "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0,
        "extensions": { "KHR_materials_variants": { "mappings":
            every(&|i| json!({ "material": i, "variants": [i] })) } },
    });
    json!({
        "asset": {
            "version": "2.0",
            "generator": concat!("pellucid-proof ", env!("CARGO_PKG_VERSION")),
            "extras": { "cell_mm": mesh.cell_mm() },
        },
        "extensionsUsed": ["KHR_materials_unlit", "KHR_materials_variants"],
        "extensions": { "KHR_materials_variants": { "variants": every(&|i| json!({ "name": looks[i].name })) } },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "name": "print" }],
        "meshes": [{ "primitives": [primitive] }],
        "materials": every(&material),
        "textures": every(&|i| json!({ "source": i, "sampler": 0 })),
        "images": every(&|i| json!({ "bufferView": images[i], "mimeType": "image/png", "name": looks[i].name })),
        "samplers": [{ "magFilter": NEAREST, "minFilter": NEAREST, "wrapS": CLAMP, "wrapT": CLAMP }],
        "accessors": accessors,
        "bufferViews": bytes.views(),
        "buffers": [{ "byteLength": bytes.len() }],
    })
}

#[cfg(test)]
mod tests;
