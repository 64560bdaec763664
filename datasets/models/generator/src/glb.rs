//! The glTF 2.0 binary writer.

use crate::Model;

/// A print length in millimetres as the file's metres.
pub fn metres(mm: f64) -> f32 {
    // Adding zero turns -0 into 0, so that equal places are equal bytes.
    (mm / 1000.0) as f32 + 0.0
}

/// The binary chunk and the views into it, as JSON.
#[derive(Default)]
struct Buffer {
    bytes: Vec<u8>,
    views: Vec<String>,
}

impl Buffer {
    /// Appends data as a view of its own; `extra` is more JSON for the view.
    fn push(&mut self, data: &[u8], extra: &str) {
        let (offset, length) = (self.bytes.len(), data.len());
        self.views.push(format!("{{\"buffer\":0,\"byteOffset\":{offset},\"byteLength\":{length}{extra}}}"));
        self.bytes.extend_from_slice(data);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

/// Serialises a model: one mesh of one primitive, positions in metres with +Y up, texture
/// coordinates as 16-bit fractions, the texture as PNG inside.
///
/// # Errors
/// Those of the PNG encoder.
pub fn to_glb(model: &Model) -> Result<Vec<u8>, png::EncodingError> {
    const VERTICES: &str = ",\"target\":34962";
    const INDICES: &str = ",\"target\":34963";
    let part = &model.part;
    let mut buffer = Buffer::default();

    // Print space is z up; glTF is y up: (x, y, z) becomes (x, z, -y).
    let places: Vec<[f32; 3]> = part.positions.iter().map(|p| [p[0], p[2], -p[1]].map(metres)).collect();
    let fold = |f: fn(f32, f32) -> f32| {
        places.iter().copied().reduce(|a, b| std::array::from_fn(|k| f(a[k], b[k]))).unwrap_or_default()
    };
    let (min, max) = (fold(f32::min), fold(f32::max));
    let data: Vec<u8> = places.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    buffer.push(&data, VERTICES);

    let fraction = |v: f64| ((v.clamp(0.0, 1.0) * 65535.0).round() as u16).to_le_bytes();
    let data: Vec<u8> = part.uv.iter().flatten().flat_map(|&v| fraction(v)).collect();
    buffer.push(&data, VERTICES);

    let indices = part.triangles.as_flattened();
    let wide = places.len() > 65535;
    let data: Vec<u8> = if wide {
        indices.iter().flat_map(|i| i.to_le_bytes()).collect()
    } else {
        indices.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect()
    };
    buffer.push(&data, INDICES);
    buffer.push(&model.texture.to_png()?, "");

    let (name, vertices, corners) = (model.name, places.len(), indices.len());
    let index_type = if wide { 5125 } else { 5123 };
    let mut text = [
        r#"{"asset":{"version":"2.0","generator":"pellucid-models","copyright":"The Pellucid developers, MIT"},"#
            .to_owned(),
        format!(r#""scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"name":"{name}","mesh":0}}],"#),
        format!(r#""meshes":[{{"name":"{name}","primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"#),
        r#""indices":2,"material":0}]}],"#.to_owned(),
        format!(r#""materials":[{{"name":"{name}","pbrMetallicRoughness":{{"metallicFactor":0,"#),
        r#""roughnessFactor":1,"baseColorTexture":{"index":0}}}],"#.to_owned(),
        r#""textures":[{"source":0,"sampler":0}],"images":[{"bufferView":3,"mimeType":"image/png"}],"#.to_owned(),
        r#""samplers":[{"magFilter":9729,"minFilter":9729,"wrapS":33071,"wrapT":33071}],"#.to_owned(),
        format!(r#""accessors":[{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3","#),
        format!(r#""min":{min:?},"max":{max:?}}},{{"bufferView":1,"componentType":5123,"normalized":true,"#),
        format!(r#""count":{vertices},"type":"VEC2"}},{{"bufferView":2,"componentType":{index_type},"#),
        format!(r#""count":{corners},"type":"SCALAR"}}],"bufferViews":[{}],"#, buffer.views.join(",")),
        format!(r#""buffers":[{{"byteLength":{}}}]}}"#, buffer.bytes.len()),
    ]
    .concat()
    .into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');

    let total = 12 + 8 + text.len() + 8 + buffer.bytes.len();
    let mut out = Vec::with_capacity(total);
    // "glTF", version 2, length; then the chunks "JSON" and "BIN".
    for word in [0x4654_6c67, 2, total as u32, text.len() as u32, 0x4e4f_534a] {
        out.extend_from_slice(&u32::to_le_bytes(word));
    }
    out.extend_from_slice(&text);
    out.extend_from_slice(&(buffer.bytes.len() as u32).to_le_bytes());
    out.extend_from_slice(&0x004e_4942u32.to_le_bytes());
    out.extend_from_slice(&buffer.bytes);
    Ok(out)
}
