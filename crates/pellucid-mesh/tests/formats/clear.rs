//! See-through parts are the same in every format that can say so, and opaque where nobody asks.

use std::fs;
use std::path::Path;

use pellucid_mesh::{ImportOptions, Model, PlacedMesh, Scale, VoxeliseOptions};
use pellucid_voxel::{Control, LabelGrid, Pitch, Surface, SurfaceOptions};
use serde_json::{Value, json};

use crate::glb::{self, Glb};
use crate::scene::*;

/// An opaque red cube, and a blue one on its right that is see-through: alpha 76 of 255.
fn cubes() -> Scene {
    let (mut scene, other) = (cube(), cube());
    scene.positions.extend(other.positions.iter().map(|[x, y, z]| [x + 10.0, *y, *z]));
    scene.coords.extend(other.coords);
    scene.faces.extend(other.faces.iter().map(|face| face.map(|i| i + 8)));
    scene.colors = [[[230, 20, 30]; 12], [[20, 40, 220]; 12]].concat();
    scene
}

const ALPHA: u8 = 76;

/// A glTF of one material: `color` gives each corner's colour, `image` a texture.
fn gltf_of(scene: &Scene, color: impl Fn(usize) -> [f32; 4], image: Option<&[u8]>, mode: Value) -> Vec<u8> {
    let mut glb = Glb::new();
    let corners = || scene.faces.iter().flatten();
    let place = |&i: &usize| {
        let [x, y, z] = scene.positions[i].map(|c| (c / 1000.0) as f32);
        [x, z, -y]
    };
    let position = glb.floats(&corners().map(place).collect::<Vec<_>>());
    let mut attributes = json!({"POSITION": position});
    let material = match image {
        Some(image) => {
            let uv = |&i: &usize| [scene.coords[i][0] as f32, (1.0 - scene.coords[i][1]) as f32];
            attributes["TEXCOORD_0"] = glb.floats(&corners().map(uv).collect::<Vec<_>>()).into();
            glb.textured_material(image).1
        }
        None => {
            let colors: Vec<[f32; 4]> = (0..scene.faces.len()).flat_map(|f| [color(f); 3]).collect();
            attributes["COLOR_0"] = glb.floats(&colors).into();
            glb.push("materials", json!({"name": "paint"}))
        }
    };
    let fields = glb.at(&format!("/materials/{material}")).as_object_mut().unwrap();
    fields.extend(mode.as_object().unwrap().clone());
    glb.mesh(json!({"attributes": attributes, "material": material}));
    glb.bytes()
}

/// The PLY with an opacity after each face's colour.
fn ply_with_alpha(scene: &Scene) -> Vec<u8> {
    let text = String::from_utf8(ply(scene, Encoding::Ascii, PlyColors::Faces)).unwrap();
    let (header, body) = text.split_once("end_header\n").unwrap();
    let header = header.replace("property uchar blue\n", "property uchar blue\nproperty uchar alpha\n");
    let mut lines: Vec<String> = body.lines().map(str::to_owned).collect();
    let first = scene.positions.len();
    for (line, color) in lines[first..].iter_mut().zip(&scene.colors) {
        line.push_str(if color[2] > 100 { "76" } else { "255" });
    }
    format!("{header}end_header\n{}\n", lines.join("\n")).into_bytes()
}

fn import(opacity: bool, name: &str, bytes: &[u8], folder: Option<&Path>) -> Model {
    let options = ImportOptions { opacity, ..ImportOptions::default() };
    options.import_slice(name, bytes, folder).unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// The opaque bodies' voxels, and what their surface looks like and whether it is see-through.
fn looks(model: &Model) -> (LabelGrid, Vec<([f32; 3], bool)>) {
    let control = Control::none();
    let placement = pellucid_mesh::Placement::new(model, Scale::Native).unwrap();
    let opaque = model.without(&model.clear_bodies()).unwrap();
    let mesh = PlacedMesh::at(&opaque, placement);
    let options = VoxeliseOptions { pitch: Pitch::new([0.5; 3]).unwrap(), ..VoxeliseOptions::default() };
    let grid = mesh.voxelise(&options, &control).unwrap().grid;
    let surface = Surface::extract(&grid, &SurfaceOptions::default(), &control).unwrap();
    let looks = mesh.surface_looks(&surface, &control).unwrap();
    (grid, looks)
}

#[test]
fn a_clear_body_is_the_same_in_every_format() {
    let scene = cubes();
    let color = |face: usize| {
        let [r, g, b] = scene.colors[face].map(linear);
        [r, g, b, if face < 12 { 1.0 } else { f32::from(ALPHA) / 255.0 }]
    };
    let (text, mtl) = obj(&scene, false);
    // The library has the colours in ascending order.
    let clear_by = |line: &str| mtl.replacen("newmtl color 0\n", &format!("newmtl color 0\n{line}\n"), 1);
    let folders = [clear_by("d 0.3"), clear_by("Tr 0.7")].map(|mtl| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.mtl"), mtl).unwrap();
        folder
    });
    let translucent = |kind| {
        threemf_xml(&scene, kind).replace("#1428DCFF\"", "#1428DC4C\"").replace("#1428DC\"", "#1428DC4C\"")
    };
    let hex = |kind| package(&translucent(kind), &[]);
    let files: Vec<(&str, Vec<u8>, Option<&Path>)> = vec![
        ("a.glb", gltf_of(&scene, color, None, json!({"alphaMode": "BLEND"})), None),
        ("d.obj", text.clone().into_bytes(), Some(folders[0].path())),
        ("tr.obj", text.into_bytes(), Some(folders[1].path())),
        ("a.ply", ply_with_alpha(&scene), None),
        ("base.3mf", hex(ThreeMfColors::Base), None),
        ("group.3mf", hex(ThreeMfColors::Group), None),
    ];
    let expected = looks(&import(true, files[0].0, &files[0].1, None));
    assert_eq!(expected.0.solid_count(), 20 * 20 * 20);
    for (name, bytes, folder) in &files {
        let model = import(true, name, bytes, *folder);
        let clear: Vec<bool> = scene.colors.iter().map(|c| c[2] > 100).collect();
        assert_eq!(model.clear_bodies(), clear, "{name}");
        assert!(model.notes().is_empty(), "{name}: {:?}", model.notes());
        let found = looks(&model);
        assert!(found.0 == expected.0, "{name}: other voxels are opaque");
        let same = |a: &([f32; 3], bool), b: &([f32; 3], bool)| {
            (0..3).all(|c| (a.0[c] - b.0[c]).abs() < 0.004) && a.1 == b.1
        };
        assert!(found.1.iter().zip(&expected.1).all(|(a, b)| same(a, b)), "{name}: other looks");

        let opaque = import(false, name, bytes, *folder);
        assert!(opaque.opacity().is_empty() && opaque.clear_bodies().iter().all(|c| !c), "{name}");
        assert_eq!(opaque.triangles(), model.triangles());
        let told = opaque.notes().iter().any(|n| n.text.contains("transparency"));
        assert_eq!(told, !name.ends_with("ply"), "{name}");
    }
}

#[test]
fn a_see_through_texture_is_the_same_in_every_format() {
    let sphere = sphere();
    // See-through on the left half of the picture.
    let pixels: Vec<u8> = (0..128u32)
        .flat_map(|i| [(i % 16 * 16) as u8, (i / 16 * 30) as u8, 90, if i % 16 < 8 { 0 } else { 255 }])
        .collect();
    let encoded = |pixels: Vec<u8>| {
        let picture = image::RgbaImage::from_raw(16, 8, pixels).unwrap();
        let mut bytes = std::io::Cursor::new(Vec::new());
        picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let skin = encoded(pixels);
    let greys: Vec<[u8; 3]> = (0..128).map(|i| if i % 16 < 8 { [0; 3] } else { [255; 3] }).collect();
    let (text, mtl) = obj(&sphere, true);
    let folder_of = |mtl: &str, skin: &[u8]| {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("scene.mtl"), mtl).unwrap();
        fs::write(folder.path().join("skin.png"), skin).unwrap();
        fs::write(folder.path().join("mask.png"), glb::png(16, 8, &greys)).unwrap();
        folder
    };
    let beside = folder_of(&mtl, &skin);
    let masked = folder_of(&format!("{mtl}map_d mask.png\n"), &picture());
    let files = [
        ("mask.glb", gltf_of(&sphere, |_| [1.0; 4], Some(&skin), json!({"alphaMode": "MASK"})), None),
        ("blend.glb", gltf_of(&sphere, |_| [1.0; 4], Some(&skin), json!({"alphaMode": "BLEND"})), None),
        ("skin.obj", text.clone().into_bytes(), Some(beside.path())),
        ("map_d.obj", text.into_bytes(), Some(masked.path())),
        ("a.ply", ply(&sphere, Encoding::Little, PlyColors::Texture), Some(beside.path())),
        (
            "a.3mf",
            package(&threemf_xml(&sphere, ThreeMfColors::Texture), &[("3D/Texture/skin.png", &skin)]),
            None,
        ),
    ];
    let expected = looks(&import(true, files[0].0, &files[0].1, None));
    let clear = expected.1.iter().filter(|l| l.1).count();
    assert!(
        (0.45..0.55).contains(&(clear as f64 / expected.1.len() as f64)),
        "{clear} of {}",
        expected.1.len()
    );
    for (name, bytes, folder) in &files {
        let model = import(true, name, bytes, *folder);
        // A window in a body, and no body.
        assert!(model.clear_bodies().iter().all(|c| !c), "{name}");
        let found = looks(&model);
        assert!(found.0 == expected.0, "{name}: other voxels are solid");
        let odd = found.1.iter().zip(&expected.1).filter(|(a, b)| a.1 != b.1).count();
        assert!(odd * 200 <= expected.1.len(), "{name}: {odd} of {} differ", expected.1.len());
        let opaque = import(false, name, bytes, *folder);
        assert_eq!(opaque.textures().len(), 1, "{name}");
    }
    // An opaque material is opaque, whatever its texture holds.
    let opaque = import(
        true,
        "a.glb",
        &gltf_of(&sphere, |_| [1.0; 4], Some(&skin), json!({"alphaMode": "OPAQUE"})),
        None,
    );
    assert!(looks(&opaque).1.iter().all(|l| !l.1));
}

#[test]
fn a_mask_is_cut_where_the_file_says() {
    let scene = cubes();
    let color = |face: usize| [0.5, 0.5, 0.5, if face < 12 { 1.0 } else { 0.3 }];
    for (cutoff, clear) in [(0.25, false), (0.35, true)] {
        let bytes = gltf_of(&scene, color, None, json!({"alphaMode": "MASK", "alphaCutoff": cutoff}));
        let model = import(true, "a.glb", &bytes, None);
        assert_eq!(model.clear_bodies().iter().any(|c| *c), clear, "{cutoff}");
    }
}

#[test]
fn colours_after_vertices_may_have_an_opacity() {
    let scene = cubes();
    let mut text = String::new();
    for (number, line) in obj_vertex_colors(&scene).lines().enumerate() {
        // A comment, then three vertices and a face for each triangle.
        let of_second = number > 12 * 4;
        match line.starts_with("v ") && of_second {
            true => text.push_str(&format!("{line} 0.3\n")),
            false => text.push_str(&format!("{line}\n")),
        }
    }
    let model = import(true, "a.obj", text.as_bytes(), None);
    let expected: Vec<bool> = (0..24).map(|face| face >= 12).collect();
    assert_eq!(model.clear_bodies(), expected);
}
