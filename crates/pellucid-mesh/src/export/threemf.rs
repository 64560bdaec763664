//! The 3MF writer: core and materials specification, one object with a texture.

use std::fmt::Write as _;
use std::io::{self, Cursor, Write as _};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

use crate::bake::TexturedMesh;

const CONTENT_TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
<Default Extension="png" ContentType="image/png"/>
</Types>
"#;
const ROOT: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;
const TEXTURES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/Textures/texture.png" Id="texture" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dtexture"/>
</Relationships>
"#;

/// A package in millimetres, +Z up; the same mesh gives the same bytes.
pub(super) fn to_3mf(mesh: &TexturedMesh, png: &[u8]) -> io::Result<Vec<u8>> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let plain = SimpleFileOptions::default().last_modified_time(DateTime::default());
    let packed = plain.compression_method(CompressionMethod::Deflated);
    let stored = plain.compression_method(CompressionMethod::Stored);
    let parts: [(&str, &[u8], SimpleFileOptions); 5] = [
        ("[Content_Types].xml", CONTENT_TYPES.as_bytes(), packed),
        ("_rels/.rels", ROOT.as_bytes(), packed),
        ("3D/3dmodel.model", &model(mesh).into_bytes(), packed),
        ("3D/_rels/3dmodel.model.rels", TEXTURES.as_bytes(), packed),
        ("3D/Textures/texture.png", png, stored),
    ];
    for (name, bytes, options) in parts {
        zip.start_file(name, options).map_err(io::Error::other)?;
        zip.write_all(bytes)?;
    }
    Ok(zip.finish().map_err(io::Error::other)?.into_inner())
}

/// The model part. Writing to a string cannot fail.
fn model(mesh: &TexturedMesh) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"millimeter\" \
         xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" \
         xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\" requiredextensions=\"m\">\n<resources>\n\
         <m:texture2d id=\"1\" path=\"/3D/Textures/texture.png\" contenttype=\"image/png\" tilestyleu=\"clamp\" \
         tilestylev=\"clamp\"/>\n<m:texture2dgroup id=\"2\" texid=\"1\">\n",
    );
    for [u, v] in mesh.uv.iter().flatten() {
        // v grows upwards.
        let _ = writeln!(text, "<m:tex2coord u=\"{u:.7}\" v=\"{:.7}\"/>", 1.0 - v);
    }
    text.push_str(
        "</m:texture2dgroup>\n<object id=\"3\" type=\"model\" pid=\"2\" pindex=\"0\">\n<mesh>\n<vertices>\n",
    );
    for [x, y, z] in &mesh.positions_mm {
        let _ = writeln!(text, "<vertex x=\"{x:.6}\" y=\"{y:.6}\" z=\"{z:.6}\"/>");
    }
    text.push_str("</vertices>\n<triangles>\n");
    for (i, [a, b, c]) in mesh.triangles.iter().enumerate().filter(|(_, t)| is_triangle(**t)) {
        let [p1, p2, p3] = [3 * i, 3 * i + 1, 3 * i + 2];
        let _ = writeln!(
            text,
            "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\" pid=\"2\" p1=\"{p1}\" p2=\"{p2}\" p3=\"{p3}\"/>"
        );
    }
    text.push_str("</triangles>\n</mesh>\n</object>\n</resources>\n<build>\n<item objectid=\"3\"/>\n</build>\n</model>\n");
    text
}

/// The format forbids triangles that have a corner twice.
fn is_triangle([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}
