//! OBJ and MTL alone.

use std::fs;
use std::path::Path;

use pellucid_mesh::{ImportLimits, Model, UpAxis, Wrap};

use crate::glb;
use crate::refused::Kind::{Invalid, Io, Unsupported};
use crate::refused::*;
use crate::scene::linear;

const SQUARE: &str = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 0 4 0\n";

fn read(text: &str) -> Model {
    import("a.obj", text.as_bytes(), None).unwrap_or_else(|e| panic!("{e}"))
}

/// Area of all triangles in square millimetres.
fn area(model: &Model) -> f64 {
    (0..model.triangles().len() as u32)
        .map(|t| {
            let [a, b, c] = model.corners_m(t).map(|p| p.map(|c| 1000.0 * c));
            let (u, v): ([f64; 3], [f64; 3]) =
                (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
            let cross = |k: usize| u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
            0.5 * (0..3).map(|k| cross(k).powi(2)).sum::<f64>().sqrt()
        })
        .sum()
}

#[test]
fn faces_in_every_way_to_write_them() {
    let expected = read(&format!("{SQUARE}f 1 2 3\nf 1 3 4\n"));
    assert_eq!(expected.read_as().unwrap().up, UpAxis::Y);
    // y up: the file's (4, 4, 0) is (4, 0, 4) mm.
    assert_eq!(expected.corners_m(0)[2], [0.004, 0.0, 0.004]);
    for faces in [
        "f 1 2 3 4",
        "f -4 -3 -2 -1",
        "f 1//1 2//2 3//-1 4//9",
        "vt 0 0\nf 1/1 2/1 3/1 4/-1",
        "vt 0.5\nf 1/1/1 2/1/2 3/1/3 4/1/4 # a comment",
        "# C:\\models\\\nf 1 2 3 4",
        "s off\ng a b\no c\nf 1 2 \\\n3 4",
        "usemtl nothing\nf 1 2 3 4",
        "fo 1 2 3 4",
        "l 1 2\np 1\nf\t1   2 3  4  ",
    ] {
        for text in [format!("{SQUARE}{faces}\n"), format!("{SQUARE}{faces}").replace('\n', "\r\n")] {
            let model = read(&text);
            assert_eq!(model.vertices(), expected.vertices(), "{faces}");
            assert_eq!(model.triangles(), expected.triangles(), "{faces}");
        }
    }
    assert!(notes(&read(&format!("{SQUARE}l 1 2\nf 1 2 3"))).contains("points and lines"));
    assert!(notes(&read(&format!("{SQUARE}usemtl x\nf 1 2 3"))).contains("no library"));
}

#[test]
fn concave_polygons_are_not_overfilled() {
    let l = "v 0 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\n";
    for face in ["f 1 2 3 4 5 6", "f 4 5 6 1 2 3", "f 6 5 4 3 2 1", "f 3 2 1 6 5 4"] {
        let model = read(&format!("{l}{face}"));
        assert_eq!(model.triangles().len(), 4);
        assert!((area(&model) - 4.0).abs() < 1e-9, "{face}: {}", area(&model));
    }
}

/// A folder with libraries, textures, and a file outside that must not be opened.
fn folder(mtl: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    fs::create_dir_all(model.join("my textures")).unwrap();
    fs::write(model.join("a library.mtl"), mtl).unwrap();
    fs::write(model.join("my textures/skin 1.png"), glb::four_colors()).unwrap();
    fs::write(folder.path().join("secret.png"), glb::four_colors()).unwrap();
    folder
}

fn with_library(folder: &Path, rest: &str) -> Result<Model, pellucid_mesh::MeshError> {
    let text = format!("mtllib a library.mtl\n{SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n{rest}");
    import("a.obj", text.as_bytes(), Some(&folder.join("model")))
}

const FACE: &str = "f 1/1 2/2 3/3 4/4\n";

#[test]
fn the_most_detailed_colour_counts() {
    let mtl = "# a library\r\n\
        newmtl paint\r\nKd 0.5 0.25 1 # a comment\r\nKe 1 1 1\nd 0.5\r\n\
        newmtl grey\r\nKd 0.5\r\n\
        newmtl skin\r\nKd 0.8 0.8 0.8\r\nmap_Kd -clamp on my textures\\skin 1.png\r\n\
        newmtl \"in quotes\"\nmap_Kd -s 0.5 0.5 -o 0.25 0.5 \"my textures/skin 1.png\"\n\
        newmtl nothing\n";
    let folder = folder(mtl);
    let color = |rest: &str| {
        let model = with_library(folder.path(), rest).unwrap();
        // Near the file's (4, 4), where u and v are 1.
        (model.color_at(0, [0.1, 0.1, 0.8], 0.0), model)
    };
    let (paint, model) = color(&format!("usemtl paint\n{FACE}"));
    let display = |c: f64| (((c + 0.055) / 1.055f64).powf(2.4)) as f32;
    let expected = [display(0.5), display(0.25), 1.0];
    assert!((0..3).all(|c| (paint[c] - expected[c]).abs() < 1e-5), "{paint:?}");
    assert_eq!(model.materials()[0].name, "paint");
    assert!(notes(&model).contains("transparency") && notes(&model).contains("emission"));
    assert!((color(&format!("usemtl grey\n{FACE}")).0[2] - display(0.5)).abs() < 1e-5);
    assert_eq!(color(&format!("usemtl nothing\n{FACE}")).0, [1.0; 3]);
    assert_eq!(color(&format!("usemtl unknown\n{FACE}")).0, [1.0; 3]);

    // v is up: (1, 1) is the upper right texel, green; Kd is not multiplied.
    let (skin, model) = color(&format!("usemtl skin\n{FACE}"));
    assert_eq!(skin, [0.0, 1.0, 0.0]);
    assert_eq!(model.textures()[0].sampler().wrap_u, Wrap::Clamp);
    assert!(notes(&model).contains("Kd is left out"), "{}", notes(&model));
    // Scaled by a half, then moved, then turned v down.
    let (_, model) = color(&format!("usemtl in quotes\n{FACE}"));
    let uvs: Vec<[f32; 2]> = model.vertices().iter().map(|v| v.uv).collect();
    assert_eq!(uvs, [[0.25, 0.5], [0.75, 0.5], [0.75, 0.0], [0.25, 0.0]]);

    // Colours of the vertices come before Kd, but not before a texture, and only if all have one.
    let vertices = "v 0 0 0 1 0 0\nv 4 0 0 1 0 0\nv 4 4 0 1.0 0 0\n";
    assert_eq!(color(&format!("{vertices}usemtl paint\nf 5 6 7")).0, [1.0, 0.0, 0.0]);
    assert_eq!(color(&format!("{vertices}usemtl skin\nf 5/1 6/2 7/3")).0, [0.0, 1.0, 0.0]);
    assert_eq!(color(&format!("{vertices}usemtl paint\nf 5 6 3")).0, paint);
    assert_eq!(color(&format!("{vertices}f 5 6 7")).0, [1.0, 0.0, 0.0]);
}

#[test]
fn blender_writes_linear_kd() {
    for (head, expected) in [("# Blender 4.2.0 MTL File: 'None'\n", 0.5), ("", linear(128))] {
        let folder = folder(&format!("{head}newmtl m\nKd 0.501960784 0 0\n"));
        let model = with_library(folder.path(), &format!("usemtl m\n{FACE}")).unwrap();
        let found = model.color_at(0, [1.0, 0.0, 0.0], 0.0)[0];
        assert!((found - expected).abs() < 0.003, "{found} is not {expected}");
    }
}

#[test]
fn libraries_and_textures_that_are_not_there_or_not_beside_the_model() {
    let library = folder("newmtl m\nKd 1 1 1\n");
    let at = library.path().join("model");
    let read = |line: &str| import("a.obj", format!("{line}\n{SQUARE}f 1 2 3").as_bytes(), Some(&at));
    read("mtllib \"a library.mtl\"").unwrap();
    fs::write(at.join("b.mtl"), "newmtl n\nKd 0 0 0\n").unwrap();
    read("mtllib b.mtl b.mtl").unwrap();
    read("mtllib ./b.mtl").unwrap();
    refused(read("mtllib gone.mtl"), Io, "line 1, file name \"gone.mtl\"", "cannot be read");
    refused(read("mtllib b.mtl gone.mtl"), Io, "line 1, file name \"gone.mtl\"", "cannot be read");
    let absolute = library.path().join("secret.png").display().to_string();
    let escapes = [
        "../secret.png",
        "my textures/../../secret.png",
        "..\\secret.png",
        "%2e%2e/secret.png",
        absolute.as_str(),
        "file:///secret.png",
        "C:/secret.png",
        "a%00.png",
    ];
    for name in escapes {
        refused(read(&format!("mtllib {name}")), Invalid, "line 1", "its file name");
        let library = folder(&format!("newmtl m\nmap_Kd {name}\n"));
        let textured = with_library(library.path(), &format!("usemtl m\n{FACE}"));
        refused(textured, Invalid, "a library.mtl, material \"m\", map_Kd", "its file name");
    }
    refused(import("a.obj", b"mtllib b.mtl\n", None), Invalid, "line 1", "without a folder");

    let library = folder("newmtl m\nmap_Kd gone.png\n");
    let textured = with_library(library.path(), &format!("usemtl m\n{FACE}"));
    refused(textured, Io, "map_Kd, file name \"gone.png\"", "cannot be read");
    with_library(library.path(), FACE).expect("what is not used need not be there");
    let library = folder("newmtl m\nmap_Kd a library.mtl\n");
    let textured = with_library(library.path(), &format!("usemtl m\n{FACE}"));
    refused(textured, Unsupported, "map_Kd", "neither PNG nor JPEG");
    let library = folder("newmtl m\nmap_Kd my textures/skin 1.png\n");
    let bare = with_library(library.path(), "usemtl m\nf 1 2 3");
    refused(bare, Invalid, "line 11", "no texture coordinate");
    for (mtl, line) in
        [("newmtl m\nKd red\n", 2), ("newmtl m\n\nKd 1 2\n", 3), ("newmtl m\nmap_Kd -clamp\n", 2)]
    {
        let library = folder(mtl);
        refused(with_library(library.path(), FACE), Invalid, &format!("a library.mtl, line {line}"), "");
    }
}

#[test]
fn damage_is_told_by_line() {
    let bad = |text: &str, reason: &str| {
        let line = 5 + text.matches('\n').count();
        refused(
            import("a.obj", format!("{SQUARE}{text}").as_bytes(), None),
            Invalid,
            &format!("line {line}"),
            reason,
        );
    };
    bad("f 1 2 5", "vertex 5 does not exist, there are 4");
    bad("f 1 2 -5", "vertex -5 does not exist");
    bad("f 1 2 0", "\"0\" is no corner");
    bad("f 1 2 99999999999999999999", "no corner");
    bad("f 1 2 9223372036854775807", "does not exist");
    bad("f 1 2 -9223372036854775808", "does not exist");
    bad("f 1/1 2 3", "texture coordinate 1 does not exist, there are 0");
    bad("f 1 2", "2 corners");
    bad("f", "0 corners");
    bad("f 1 a 3", "\"a\" is no corner");
    bad("\n\nv 1 2", "\"1 2\"");
    bad("v 1 2 nan", "finite");
    bad("v 1 2 1e999", "finite");
    bad("v 1 2 3 4 5", "finite");
    bad("v 1 2 3 4 5 6 7 8", "finite");
    bad("vt inf", "finite");
    bad("vt 1e39 0", "too large");
    let far = import("a.obj", b"v 1e300 0 0\nv 0 0 0\nv 0 1 0\nf 1 2 3", None);
    refused(far, Unsupported, "vertex 0", "beyond");
    refused(import("a.obj", b"# nothing\n", None), Invalid, "model", "no triangles");
    refused(import("a.obj", b"\xff\xfe\0v", None), Invalid, "model", "no triangles");
}

#[test]
fn limits() {
    let text = format!("{SQUARE}f 1 2 3 4");
    let limited = |change: fn(&mut ImportLimits)| {
        let mut limits = ImportLimits::default();
        change(&mut limits);
        limited("a.obj", text.as_bytes(), limits)
    };
    refused(limited(|l| l.vertices = 3), Unsupported, "line 4", "more than 3 vertices");
    refused(limited(|l| l.triangles = 1), Unsupported, "line 5", "more than 1 triangles");
    refused(limited(|l| l.file_bytes = 10), Unsupported, "file", "the limit is 10");
    let large = format!("{SQUARE}f {}", "1 2 3 ".repeat(30_000));
    refused(import("a.obj", large.as_bytes(), None), Unsupported, "line 5", "corners");
    let library = folder("newmtl a\nnewmtl b\nnewmtl c\n");
    let options = pellucid_mesh::ImportOptions::from(ImportLimits { items: 2, ..Default::default() });
    let beside = library.path().join("model");
    let many = options.import_slice("a.obj", b"mtllib a library.mtl\n", Some(&beside));
    refused(many, Unsupported, "a library.mtl, line 3", "more than 2 materials");
    let options = pellucid_mesh::ImportOptions::from(ImportLimits { file_bytes: 22, ..Default::default() });
    let large = options.import_slice("a.obj", b"mtllib a library.mtl\n", Some(&beside));
    refused(large, Unsupported, "line 1", "27 bytes");
}
