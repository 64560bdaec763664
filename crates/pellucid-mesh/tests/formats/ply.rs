//! PLY alone.

use std::fs;

use pellucid_mesh::{ImportLimits, Model};

use crate::refused::Kind::{Invalid, Io, Unsupported};
use crate::refused::*;
use crate::scene::*;

/// A square of 2 mm whose header and rows can be changed.
const SQUARE: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nelement face 1\nproperty list uchar int vertex_index\nend_header\n\
    0 0 0\n2 0 0\n2 2 0\n0 2 0\n4 0 1 2 3\n";

fn read(text: &str) -> Model {
    import("a.ply", text.as_bytes(), None).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn polygons_strips_and_what_is_passed_over() {
    let expected = read(SQUARE);
    assert_eq!(expected.triangles().len(), 2);
    assert_eq!(expected.corners_m(0)[1], [0.002, 0.0, 0.0]);
    for changed in [
        SQUARE.replace('\n', "\r\n"),
        SQUARE.replace('\n', "\r"),
        SQUARE.replace("0 0 0\n2 0 0\n", "0 0 0 2 0\n0 "),
        SQUARE
            .replace("property float z\n", "property float z\nproperty list int float tags\n")
            .replace(" 0\n2 0 0\n2 2 0\n0 2 0", " 0 0\n2 0 0 2 nan x\n2 2 0 0\n0 2 0 1 7"),
        SQUARE
            .replace("element face", "element edge 2\nproperty int a\nproperty uchar b\nelement face")
            .replace("\n4 0 1", "\n1 2\n3 4\n4 0 1"),
        SQUARE.replace("element face", "element nothing 4000000000\nelement face"),
    ] {
        let model = read(&changed);
        assert_eq!(model.vertices(), expected.vertices(), "{changed}");
        assert_eq!(model.triangles(), expected.triangles(), "{changed}");
    }
    let strips =
        SQUARE.replace("element face 1", "element tristrips 1").replace("4 0 1 2 3", "8 0 1 3 2 -1 0 1 3");
    let model = read(&strips);
    let corners = |t: u32| model.corners_m(t).map(|c| [c[0] * 500.0, c[1] * 500.0]);
    assert_eq!(corners(0), [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    // Every second triangle of a strip is turned.
    assert_eq!(corners(1), [[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
    assert_eq!(corners(2), corners(0));
}

#[test]
fn colours_of_every_type() {
    let colored = |kind: &str, row: &str| {
        let header = format!("property float z\nproperty {kind} r\nproperty {kind} g\nproperty {kind} b\n");
        let text = SQUARE.replace("property float z\n", &header);
        let rows = ["0 0 0", "2 0 0", "2 2 0", "0 2 0"];
        let text = rows
            .iter()
            .fold(text, |text, r| text.replacen(&format!("\n{r}\n"), &format!("\n{r} {row}\n"), 1));
        import("a.ply", text.as_bytes(), None)
    };
    let expected = [128u8, 0, 255].map(linear);
    for (kind, row) in [
        ("uchar", "128 0 255"),
        ("int", "128 0 255"),
        ("ushort", "32896 0 65535"),
        ("float", "0.50196078 0 1"),
        ("double", "0.50196078 -0.5 1.5"),
    ] {
        let model = colored(kind, row).unwrap();
        let found = model.color_at(1, [0.2, 0.3, 0.5], 0.0);
        assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 1e-5), "{kind}: {found:?}");
        assert_eq!(notes(&model).contains("clamped"), row.contains('-'));
    }
    refused(colored("float", "nan 0 0"), Invalid, "vertex 0", "finite");
}

#[test]
fn textures_are_beside_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let sphere = sphere();
    let text = String::from_utf8(ply(&sphere, Encoding::Ascii, PlyColors::Wedges)).unwrap();
    let read = |text: &str| import("a.ply", text.as_bytes(), Some(folder.path()));
    refused(read(&text), Io, "texture 0, file name \"skin.png\"", "cannot be read");
    fs::write(folder.path().join("skin.png"), picture()).unwrap();
    fs::write(folder.path().join("my skin.png"), picture()).unwrap();
    let model = read(&text).unwrap();
    assert_eq!(
        read(&text.replace("TextureFile skin", "TextureFile my skin")).unwrap().textures(),
        model.textures()
    );
    let outside = text.replace("TextureFile skin", "TextureFile ../skin");
    refused(read(&outside), Invalid, "texture 0", "leaves the model's folder");
    // The second face, of a texture that is not there, and of none.
    let face = |number: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        let last = lines.last_mut().unwrap();
        *last = format!("{} {number}", last.trim_end().strip_suffix(" 0").unwrap());
        read(&(lines.join("\n") + "\n"))
    };
    refused(face("1"), Invalid, &format!("face {}", sphere.faces.len() - 1), "texture 1 does not exist");
    refused(face("0.5"), Invalid, "face", "texture 0.5 does not exist");
    assert_eq!(face("-1").unwrap().materials().len(), model.materials().len());
    let none = text.replace("texcoord", "other");
    assert!(notes(&read(&none).unwrap()).contains("no texture coordinates"));
}

#[test]
fn damage_is_told_by_element() {
    let changed = |from: &str, to: &str| import("a.ply", SQUARE.replacen(from, to, 1).as_bytes(), None);
    refused(changed("ascii", "text"), Invalid, "header, line 2", "encoding");
    refused(changed("vertex 4", "vertex many"), Invalid, "header, line 3", "count");
    refused(changed("vertex 4", "vertex -4"), Invalid, "header, line 3", "count");
    refused(changed("float x", "half x"), Invalid, "header, line 4", "no property");
    refused(changed("list uchar", "list float"), Invalid, "header, line 8", "no property");
    refused(changed("float z", "float w"), Invalid, "element vertex", "lacks");
    refused(changed("vertex_index", "vertices"), Invalid, "element face", "lacks");
    refused(changed("end_header", "end"), Invalid, "header, line 9", "no line");
    refused(changed("format ascii 1.0\n", ""), Invalid, "header, line 8", "no format");
    refused(import("a.ply", &SQUARE.as_bytes()[..21], None), Invalid, "header", "no end");
    refused(changed("2 2 0", "2 two 0"), Invalid, "vertex 2", "\"two\"");
    refused(changed("2 2 0", "2 inf 0"), Invalid, "vertex 2", "finite");
    refused(changed("4 0 1 2 3", "4 0 1 2 4"), Invalid, "face 0", "vertex 4 does not exist");
    refused(changed("4 0 1 2 3", "4 0 1 2 -1"), Invalid, "face 0", "vertex -1 does not exist");
    refused(changed("4 0 1 2 3", "4 0 1 2 1.5"), Invalid, "face 0", "vertex 1.5");
    refused(changed("4 0 1 2 3", "4 0 1 2"), Invalid, "face 0", "");
    refused(changed("4 0 1 2 3", "2 0 1"), Invalid, "face 0", "2 corners");
    refused(changed("4 0 1 2 3", "-1"), Invalid, "face 0", "list of -1");
    refused(changed("face 1", "face 0"), Invalid, "model", "no triangles");
    let before = SQUARE.replace(
        "element vertex 4",
        "element face 1\nproperty list uchar int vertex_index\nelement vertex 4",
    );
    refused(import("a.ply", before.as_bytes(), None), Invalid, "face 0", "0 corners");
    let twice = SQUARE.replace(
        "element face 1",
        "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1",
    );
    refused(import("a.ply", twice.as_bytes(), None), Invalid, "element vertex", "second element");
}

#[test]
fn claims_are_checked_before_memory_is_taken() {
    let changed = |from: &str, to: &str| import("a.ply", SQUARE.replacen(from, to, 1).as_bytes(), None);
    refused(changed("vertex 4", "vertex 30000000"), Invalid, "element vertex", "claims 30000000 rows");
    refused(changed("vertex 4", "vertex 18446744073709551615"), Invalid, "element vertex", "claims");
    refused(changed("face 1", "face 18446744073709551615"), Invalid, "element face", "claims");
    refused(changed("4 0 1 2 3", "4000000000 0 1"), Invalid, "face 0", "list of 4000000000");
    let few = ImportLimits { vertices: 3, ..ImportLimits::default() };
    refused(limited("a.ply", SQUARE.as_bytes(), few), Unsupported, "element vertex", "more than 3 vertices");
    let few = ImportLimits { triangles: 1, ..ImportLimits::default() };
    refused(limited("a.ply", SQUARE.as_bytes(), few), Unsupported, "face 0", "");
    for encoding in [Encoding::Little, Encoding::Big] {
        let bytes = ply(&cube(), encoding, PlyColors::Faces);
        for cut in [1, 3, 100] {
            refused(import("a.ply", &bytes[..bytes.len() - cut], None), Invalid, "face", "");
        }
    }
}
