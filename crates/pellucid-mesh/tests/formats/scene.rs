//! The same solids, written in every format that can hold them.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::{Cursor, Write as _};

use serde_json::json;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use crate::glb;

/// A solid in print axes and millimetres.
pub struct Scene {
    pub positions: Vec<[f64; 3]>,
    /// Texture coordinates of the positions, v up.
    pub coords: Vec<[f64; 2]>,
    pub faces: Vec<[usize; 3]>,
    /// sRGB colours of the faces.
    pub colors: Vec<[u8; 3]>,
}

/// sRGB colours of the cube's sides.
pub const SIDES: [[u8; 3]; 6] =
    [[230, 20, 30], [20, 200, 40], [30, 40, 220], [240, 230, 30], [200, 40, 190], [30, 200, 210]];

/// A cube of an edge of 10 mm, each side in its own colour.
pub fn cube() -> Scene {
    let positions = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|c| 10.0 * f64::from(c)));
    // x low, x high, y low, y high, z low, z high; counter-clockwise from outside.
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    Scene {
        positions: positions.collect(),
        coords: vec![[0.0; 2]; 8],
        faces: sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect(),
        colors: SIDES.iter().flat_map(|&color| [color; 2]).collect(),
    }
}

/// A sphere of a radius of 6 mm under [`picture`].
pub fn sphere() -> Scene {
    const AROUND: usize = 24;
    const UP: usize = 12;
    let (mut positions, mut coords, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    for row in 0..=UP {
        for column in 0..=AROUND {
            let (u, v) = (column as f64 / AROUND as f64, row as f64 / UP as f64);
            // The seam's vertices must agree exactly.
            let ((sin, cos), (height, ring)) =
                ((TAU * (column % AROUND) as f64 / AROUND as f64).sin_cos(), (PI * (v - 0.5)).sin_cos());
            let ring = if row == 0 || row == UP { 0.0 } else { ring };
            positions.push([6.0 * ring * cos, 6.0 * ring * sin, 6.0 * height]);
            coords.push([u, v]);
            if row < UP && column < AROUND {
                let (a, b) = (row * (AROUND + 1) + column, (row + 1) * (AROUND + 1) + column);
                faces.extend([[a, a + 1, b + 1], [a, b + 1, b]]);
            }
        }
    }
    // What the poles collapse to a line is no triangle.
    faces.retain(|face| {
        let [a, b, c] = face.map(|i| positions[i]);
        a != b && b != c && c != a
    });
    let colors = vec![[255; 3]; faces.len()];
    Scene { positions, coords, faces, colors }
}

/// The sphere's texture: 16 x 8 texels, each different.
pub fn picture() -> Vec<u8> {
    let texels: Vec<[u8; 3]> =
        (0..128u32).map(|i| [(i % 16 * 16) as u8, (i / 16 * 30) as u8, (200 - i) as u8]).collect();
    glb::png(16, 8, &texels)
}

/// Linear value of an sRGB byte.
pub fn linear(byte: u8) -> f32 {
    let s = f64::from(byte) / 255.0;
    (if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }) as f32
}

/// As glTF with vertex colours, or with the picture.
pub fn gltf(scene: &Scene, textured: bool) -> Vec<u8> {
    let mut glb = glb::Glb::new();
    let corners = || scene.faces.iter().flatten();
    let positions: Vec<[f32; 3]> = corners()
        .map(|&i| {
            let [x, y, z] = scene.positions[i].map(|c| (c / 1000.0) as f32);
            [x, z, -y]
        })
        .collect();
    let position = glb.floats(&positions);
    let mut primitive = json!({"attributes": {"POSITION": position}});
    if textured {
        let uvs: Vec<[f32; 2]> =
            corners().map(|&i| [scene.coords[i][0] as f32, (1.0 - scene.coords[i][1]) as f32]).collect();
        primitive["attributes"]["TEXCOORD_0"] = glb.floats(&uvs).into();
        primitive["material"] = glb.textured_material(&picture()).1.into();
    } else {
        let colors: Vec<[f32; 3]> = scene.colors.iter().flat_map(|c| [c.map(linear); 3]).collect();
        primitive["attributes"]["COLOR_0"] = glb.floats(&colors).into();
    }
    glb.mesh(primitive);
    glb.bytes()
}

/// The distinct colours of a scene, and of each face which one it has.
fn palette(scene: &Scene) -> (Vec<[u8; 3]>, Vec<usize>) {
    let mut palette = scene.colors.clone();
    palette.sort_unstable();
    palette.dedup();
    let indices = scene.colors.iter().map(|c| palette.binary_search(c).unwrap());
    (palette.clone(), indices.collect())
}

fn fraction(byte: u8) -> f64 {
    f64::from(byte) / 255.0
}

/// As OBJ, y up, with the library `scene.mtl`: `Kd` colours, or the texture `skin.png`.
pub fn obj(scene: &Scene, textured: bool) -> (String, String) {
    let (palette, indices) = palette(scene);
    let (mut obj, mut mtl) = (String::from("mtllib scene.mtl\n"), String::new());
    for [x, y, z] in &scene.positions {
        writeln!(obj, "v {x} {z} {}", -y).unwrap();
    }
    for [u, v] in &scene.coords {
        writeln!(obj, "vt {u} {v}").unwrap();
    }
    for (k, color) in palette.iter().enumerate() {
        let [r, g, b] = color.map(fraction);
        writeln!(mtl, "newmtl color {k}\nKd {r} {g} {b}").unwrap();
        if textured {
            writeln!(mtl, "map_Kd skin.png").unwrap();
        }
    }
    for (face, k) in scene.faces.iter().zip(indices) {
        let [a, b, c] = face.map(|i| i + 1);
        writeln!(obj, "usemtl color {k}\nf {a}/{a} {b}/{b}/1 {c}/{c}").unwrap();
    }
    (obj, mtl)
}

/// As OBJ without a library: colours after the vertices, three of its own to each face.
pub fn obj_vertex_colors(scene: &Scene) -> String {
    let mut obj = String::from("# colours at the vertices\r\n");
    for (face, color) in scene.faces.iter().zip(&scene.colors) {
        let [r, g, b] = color.map(fraction);
        for [x, y, z] in face.map(|i| scene.positions[i]) {
            write!(obj, "v {x} {z} {} {r} {g} {b}\r\n", -y).unwrap();
        }
        obj.push_str("f -3 -2 -1\r\n");
    }
    obj
}

/// How a PLY is encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoding {
    Ascii,
    Little,
    Big,
}

/// Where a PLY has its colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlyColors {
    Faces,
    Texture,
    /// Texture coordinates of corners.
    Wedges,
}

/// As PLY; the texture is `skin.png`.
pub fn ply(scene: &Scene, encoding: Encoding, colors: PlyColors) -> Vec<u8> {
    let format = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::Little => "binary_little_endian",
        Encoding::Big => "binary_big_endian",
    };
    let mut out = format!("ply\nformat {format} 1.0\ncomment made by a test\n").into_bytes();
    if colors != PlyColors::Faces {
        out.extend(b"comment TextureFile skin.png\n");
    }
    writeln!(out, "element vertex {}", scene.positions.len()).unwrap();
    out.extend(b"property double x\nproperty double y\nproperty double z\nproperty float nx\n");
    if colors == PlyColors::Texture {
        out.extend(b"property double s\nproperty double t\n");
    }
    write!(out, "element face {}\nproperty list uchar int vertex_indices\n", scene.faces.len()).unwrap();
    match colors {
        PlyColors::Faces => out.extend(b"property uchar red\nproperty uchar green\nproperty uchar blue\n"),
        PlyColors::Texture => {}
        PlyColors::Wedges => out.extend(b"property list uchar double texcoord\nproperty int texnumber\n"),
    }
    out.extend(b"end_header\n");
    let mut row = Row { encoding, out };
    for (position, uv) in scene.positions.iter().zip(&scene.coords) {
        position.iter().for_each(|&c| row.number(c, &c.to_le_bytes()));
        row.number(0.5, &0.5f32.to_le_bytes());
        if colors == PlyColors::Texture {
            uv.iter().for_each(|&c| row.number(c, &c.to_le_bytes()));
        }
        row.end();
    }
    for (face, color) in scene.faces.iter().zip(&scene.colors) {
        row.number(3.0, &[3]);
        face.iter().for_each(|&i| row.number(i as f64, &(i as i32).to_le_bytes()));
        match colors {
            PlyColors::Faces => color.iter().for_each(|&c| row.number(f64::from(c), &[c])),
            PlyColors::Texture => {}
            PlyColors::Wedges => {
                row.number(6.0, &[6]);
                face.iter().flat_map(|&i| scene.coords[i]).for_each(|c| row.number(c, &c.to_le_bytes()));
                row.number(0.0, &0i32.to_le_bytes());
            }
        }
        row.end();
    }
    row.out
}

struct Row {
    encoding: Encoding,
    out: Vec<u8>,
}

impl Row {
    /// A number as text, or the bytes of its type, least first.
    fn number(&mut self, value: f64, bytes: &[u8]) {
        match self.encoding {
            Encoding::Ascii => write!(self.out, "{value} ").unwrap(),
            Encoding::Little => self.out.extend(bytes),
            Encoding::Big => self.out.extend(bytes.iter().rev()),
        }
    }

    fn end(&mut self) {
        if self.encoding == Encoding::Ascii {
            self.out.push(b'\n');
        }
    }
}

pub fn stl_ascii(scene: &Scene) -> Vec<u8> {
    let mut out = String::from("solid a name\n");
    for face in &scene.faces {
        out.push_str("facet normal 0 0 0\n outer loop\n");
        for [x, y, z] in face.map(|i| scene.positions[i]) {
            writeln!(out, "  vertex {x} {y} {z}").unwrap();
        }
        out.push_str(" endloop\nendfacet\n");
    }
    out.push_str("endsolid a name\n");
    out.into_bytes()
}

pub fn stl_binary(scene: &Scene) -> Vec<u8> {
    // Some programs begin binary files like text.
    let mut out = b"solid binary".to_vec();
    out.resize(80, b' ');
    out.extend((scene.faces.len() as u32).to_le_bytes());
    for face in &scene.faces {
        out.extend([0; 12]);
        for c in face.iter().flat_map(|&i| scene.positions[i]) {
            out.extend((c as f32).to_le_bytes());
        }
        out.extend([0; 2]);
    }
    out
}

/// Where a 3MF has its colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ThreeMfColors {
    Base,
    Group,
    Texture,
}

pub const MODEL: &str = "<model unit=\"millimeter\" xml:lang=\"en-US\" \
    xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" \
    xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\" \
    xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\"";

/// The XML of a 3MF's model; the texture is `/3D/Texture/skin.png`.
pub fn threemf_xml(scene: &Scene, colors: ThreeMfColors) -> String {
    let (palette, indices) = palette(scene);
    let mut xml = format!("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{MODEL}>\n<resources>\n");
    let hex = |[r, g, b]: [u8; 3]| format!("#{r:02X}{g:02x}{b:02X}");
    match colors {
        ThreeMfColors::Base => {
            xml.push_str("<basematerials id=\"1\">");
            for color in &palette {
                write!(xml, "<base name=\"a &amp; b\" displaycolor=\"{}FF\"/>", hex(*color)).unwrap();
            }
            xml.push_str("</basematerials>\n");
        }
        ThreeMfColors::Group => {
            xml.push_str("<m:colorgroup id=\"1\">");
            palette.iter().for_each(|c| write!(xml, "<m:color color=\"{}\" />", hex(*c)).unwrap());
            xml.push_str("</m:colorgroup>\n");
        }
        ThreeMfColors::Texture => {
            xml.push_str("<m:texture2d id=\"9\" path=\"/3D/Texture/skin.png\" contenttype=\"image/png\"/>");
            xml.push_str("<m:texture2dgroup id=\"1\" texid=\"9\">");
            for [u, v] in &scene.coords {
                write!(xml, "<m:tex2coord u=\"{u}\" v=\"{v}\"/>").unwrap();
            }
            xml.push_str("</m:texture2dgroup>\n");
        }
    }
    xml.push_str("<object id=\"2\" type=\"model\" pid=\"1\" pindex=\"0\"><mesh><vertices>\n");
    for [x, y, z] in &scene.positions {
        writeln!(xml, "<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>").unwrap();
    }
    xml.push_str("</vertices><triangles>\n");
    for ([a, b, c], k) in scene.faces.iter().zip(indices) {
        write!(xml, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\" ").unwrap();
        match colors {
            ThreeMfColors::Texture => writeln!(xml, "pid=\"1\" p1=\"{a}\" p2=\"{b}\" p3=\"{c}\"/>").unwrap(),
            _ => writeln!(xml, "p1=\"{k}\"/>").unwrap(),
        }
    }
    xml.push_str(
        "</triangles></mesh></object>\n</resources>\n<build><item objectid=\"2\"/></build>\n</model>\n",
    );
    xml
}

/// A 3MF package of a model and other parts.
pub fn package(model: &str, others: &[(&str, &[u8])]) -> Vec<u8> {
    let rels = "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">\
        <Relationship Target=\"/3D/thing.model\" Id=\"rel0\" \
        Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>";
    let mut parts = vec![("_rels/.rels", rels.as_bytes()), ("3D/thing.model", model.as_bytes())];
    parts.extend_from_slice(others);
    zipped(&parts)
}

pub fn zipped(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
    for (name, bytes) in parts {
        zip.start_file(*name, options).unwrap();
        zip.write_all(bytes).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

/// As a 3MF package.
pub fn threemf(scene: &Scene, colors: ThreeMfColors) -> Vec<u8> {
    package(&threemf_xml(scene, colors), &[("3D/Texture/skin.png", &picture())])
}
