//! The glTF 2.0 binary writer.

use std::collections::HashMap;
use std::io;

use serde_json::json;

use crate::bake::TexturedMesh;

const VERTEX_DATA: u32 = 34962;
const INDEX_DATA: u32 = 34963;

/// One mesh of one primitive, positions in metres with +Y up, the texture as PNG inside.
pub(super) fn to_glb(mesh: &TexturedMesh, png: &[u8]) -> io::Result<Vec<u8>> {
    // glTF's vertices have one texture coordinate each.
    let (mut places, mut coordinates, mut indices) = (Vec::new(), Vec::new(), Vec::new());
    let mut known: HashMap<(u32, [u32; 2]), u32> = HashMap::new();
    for (triangle, uv) in mesh.triangles.iter().zip(&mesh.uv) {
        for (&vertex, uv) in triangle.iter().zip(uv) {
            let uv = uv.map(|v| v as f32);
            let index = *known.entry((vertex, uv.map(f32::to_bits))).or_insert_with(|| {
                let [x, y, z] = mesh.positions_mm[vertex as usize];
                // Print space is z up. Adding zero turns -0 into 0.
                places.push([x, z, -y].map(|mm| (mm / 1000.0) as f32 + 0.0));
                coordinates.push(uv);
                places.len() as u32 - 1
            });
            indices.push(index);
        }
    }
    let fold = |f: fn(f32, f32) -> f32| {
        places.iter().copied().reduce(|a, b| std::array::from_fn(|k| f(a[k], b[k]))).unwrap_or_default()
    };
    let (min, max) = (fold(f32::min), fold(f32::max));
    let mut bytes = Vec::new();
    let mut views = Vec::new();
    let mut add = |data: &mut dyn Iterator<Item = u8>, target: Option<u32>| {
        let offset = bytes.len();
        bytes.extend(data);
        let mut view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() - offset });
        if let Some(target) = target {
            view["target"] = json!(target);
        }
        views.push(view);
        bytes.resize(bytes.len().next_multiple_of(4), 0);
    };
    add(&mut places.iter().flatten().flat_map(|v| v.to_le_bytes()), Some(VERTEX_DATA));
    add(&mut coordinates.iter().flatten().flat_map(|v| v.to_le_bytes()), Some(VERTEX_DATA));
    add(&mut indices.iter().flat_map(|i| i.to_le_bytes()), Some(INDEX_DATA));
    add(&mut png.iter().copied(), None);
    let (float, whole) = (5126, 5125);
    let document = json!({
        "asset": { "version": "2.0", "generator": concat!("pellucid ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "name": mesh.name, "mesh": 0 }],
        "meshes": [{ "name": mesh.name, "primitives": [{
            "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0,
        }] }],
        "materials": [{ "pbrMetallicRoughness": {
            "metallicFactor": 0, "roughnessFactor": 1, "baseColorTexture": { "index": 0 },
        } }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "images": [{ "bufferView": 3, "mimeType": "image/png" }],
        "samplers": [{ "magFilter": 9729, "minFilter": 9729, "wrapS": 33071, "wrapT": 33071 }],
        "accessors": [
            { "bufferView": 0, "componentType": float, "count": places.len(), "type": "VEC3", "min": min, "max": max },
            { "bufferView": 1, "componentType": float, "count": places.len(), "type": "VEC2" },
            { "bufferView": 2, "componentType": whole, "count": indices.len(), "type": "SCALAR" },
        ],
        "bufferViews": views,
        "buffers": [{ "byteLength": bytes.len() }],
    });
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + bytes.len();
    let total32 = u32::try_from(total).map_err(|_| io::Error::other("larger than the 4 GiB of a GLB"))?;
    let mut out = Vec::with_capacity(total);
    // "glTF", version 2, length; then the chunks "JSON" and "BIN".
    for word in [0x4654_6c67, 2, total32, text.len() as u32, 0x4e4f_534a] {
        out.extend_from_slice(&u32::to_le_bytes(word));
    }
    out.extend_from_slice(&text);
    out.extend_from_slice(&(bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(&0x004e_4942u32.to_le_bytes());
    out.extend_from_slice(&bytes);
    Ok(out)
}
