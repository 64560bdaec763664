//! A small glTF writer.

use std::io::Cursor;

use base64::Engine;
use pellucid_mesh::{ImportLimits, MeshError, Model, import_slice};
use serde_json::{Value, json};

pub const I8: u32 = 5120;
pub const U8: u32 = 5121;
pub const I16: u32 = 5122;
pub const U16: u32 = 5123;
pub const U32: u32 = 5125;
pub const F32: u32 = 5126;

/// A model under construction: its JSON, which tests edit freely, and its one buffer.
#[derive(Clone)]
pub struct Glb {
    pub json: Value,
    pub bin: Vec<u8>,
}

impl Glb {
    pub fn new() -> Self {
        Self {
            json: json!({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}),
            bin: Vec::new(),
        }
    }

    /// Appends to a top-level array and returns the index.
    pub fn push(&mut self, array: &str, value: Value) -> usize {
        let array = self.json.as_object_mut().unwrap().entry(array).or_insert_with(|| json!([]));
        let array = array.as_array_mut().unwrap();
        array.push(value);
        array.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len()});
        self.bin.extend_from_slice(bytes);
        self.push("bufferViews", view)
    }

    pub fn accessor(&mut self, bytes: &[u8], component: u32, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({"bufferView": view, "componentType": component, "type": kind, "count": count}),
        )
    }

    /// A float accessor of `N` components.
    pub fn floats<const N: usize>(&mut self, values: &[[f32; N]]) -> usize {
        let kind = match N {
            1 => "SCALAR",
            16 => "MAT4",
            _ => ["VEC2", "VEC3", "VEC4"][N - 2],
        };
        let bytes: Vec<u8> = values.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, F32, kind, values.len())
    }

    pub fn indices(&mut self, values: &[u32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, U32, "SCALAR", values.len())
    }

    /// A texture of `bytes` (an encoded image) and a material that uses it; both indices.
    pub fn textured_material(&mut self, image: &[u8]) -> (usize, usize) {
        let view = self.view(image);
        let image = self.push("images", json!({"bufferView": view, "mimeType": "image/png", "name": "skin"}));
        let texture = self.push("textures", json!({"source": image}));
        let material =
            json!({"name": "paint", "pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}});
        (texture, self.push("materials", material))
    }

    /// A mesh of one primitive and a node that shows it; the node's index.
    pub fn mesh(&mut self, primitive: Value) -> usize {
        let mesh = self.push("meshes", json!({"name": "body", "primitives": [primitive]}));
        self.push("nodes", json!({"name": "figure", "mesh": mesh}))
    }

    /// The value at a JSON pointer, to edit.
    pub fn at(&mut self, pointer: &str) -> &mut Value {
        self.json.pointer_mut(pointer).unwrap_or_else(|| panic!("no {pointer}"))
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if !self.bin.is_empty() && json.get("buffers").is_none() {
            json["buffers"] = json!([{"byteLength": self.bin.len()}]);
        }
        pack(json.to_string().as_bytes(), Some(&self.bin))
    }

    /// As `.gltf` text with the buffer in a data URI.
    pub fn gltf(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        let data = base64::engine::general_purpose::STANDARD.encode(&self.bin);
        let uri = format!("data:application/octet-stream;base64,{data}");
        json["buffers"] = json!([{"byteLength": self.bin.len(), "uri": uri}]);
        json.to_string().into_bytes()
    }

    pub fn import(&self) -> Result<Model, MeshError> {
        import_slice("test.glb", &self.bytes(), None, &ImportLimits::default())
    }

    pub fn model(&self) -> Model {
        self.import().expect("the model is valid")
    }
}

/// A GLB container with padded chunks.
pub fn pack(json: &[u8], bin: Option<&[u8]>) -> Vec<u8> {
    let mut out = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    let mut chunk = |data: &[u8], kind: &[u8; 4], fill: u8| {
        let padded = data.len().next_multiple_of(4);
        out.extend_from_slice(&(padded as u32).to_le_bytes());
        out.extend_from_slice(kind);
        out.extend_from_slice(data);
        out.resize(out.len() + padded - data.len(), fill);
    };
    chunk(json, b"JSON", b' ');
    if let Some(bin) = bin {
        chunk(bin, b"BIN\0", 0);
    }
    let length = out.len() as u32;
    out[8..12].copy_from_slice(&length.to_le_bytes());
    out
}

/// A unit square in glTF's xy plane facing +z, as four vertices and two triangles.
pub const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// Its texture coordinates: v down.
pub const SQUARE_UV: [[f32; 2]; 4] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
pub const SQUARE_INDICES: [u32; 6] = [0, 1, 2, 0, 2, 3];

/// The square without material.
pub fn square() -> Glb {
    let mut glb = Glb::new();
    let (position, indices) = (glb.floats(&SQUARE), glb.indices(&SQUARE_INDICES));
    glb.mesh(json!({"attributes": {"POSITION": position}, "indices": indices}));
    glb
}

/// The square with texture coordinates and a texture.
pub fn textured_square(image: &[u8]) -> Glb {
    let mut glb = square();
    let uv = glb.floats(&SQUARE_UV);
    let (_, material) = glb.textured_material(image);
    glb.at("/meshes/0/primitives/0")["attributes"]["TEXCOORD_0"] = uv.into();
    glb.at("/meshes/0/primitives/0")["material"] = material.into();
    glb
}

/// An RGB PNG from texels `[y][x]`.
pub fn png(width: u32, height: u32, texels: &[[u8; 3]]) -> Vec<u8> {
    encode(width, height, texels, image::ImageFormat::Png)
}

pub fn encode(width: u32, height: u32, texels: &[[u8; 3]], format: image::ImageFormat) -> Vec<u8> {
    let picture = image::RgbImage::from_raw(width, height, texels.as_flattened().to_vec()).unwrap();
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, format).unwrap();
    out.into_inner()
}

/// Two by two texels: red, green, blue, white.
pub fn four_colors() -> Vec<u8> {
    png(2, 2, &[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]])
}

/// Positions of all triangles' corners in order.
pub fn corners(model: &Model) -> Vec<[f64; 3]> {
    model
        .triangles()
        .iter()
        .flat_map(|t| t.vertices.map(|v| model.vertices()[v as usize].position_m))
        .collect()
}

/// glTF (x, y, z) in print axes.
pub fn print_axes([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -z, y]
}

pub fn close(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|i| (a[i] - b[i]).abs() < 1e-6)
}
