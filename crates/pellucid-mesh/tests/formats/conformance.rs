//! The same solid gives the same voxels and colours, whatever format it comes in.

use std::fs;
use std::path::Path;

use pellucid_mesh::{ImportOptions, LengthUnit, Model, UpAxis, VoxeliseOptions, surface_colors, voxelise};
use pellucid_voxel::{Control, LabelGrid, Pitch, Surface, SurfaceOptions};

use crate::scene::*;

/// What a model gives: its voxels, and the colours of its surface with whether each voxel is within a
/// side and not at an edge of its box.
struct Voxels {
    grid: LabelGrid,
    colors: Vec<[f32; 3]>,
    within: Vec<bool>,
}

fn voxels(model: &Model) -> Voxels {
    let control = Control::none();
    let options = VoxeliseOptions { pitch: Pitch::new([0.5; 3]).unwrap(), ..VoxeliseOptions::default() };
    let voxelised = voxelise(model, &options, &control).unwrap();
    let surface = Surface::extract(&voxelised.grid, &SurfaceOptions::default(), &control).unwrap();
    let colors = surface_colors(model, &voxelised.placement, &surface, &control).unwrap();
    let last = voxelised.grid.size().map(|s| s - 2);
    let at_border = |v: &[u32; 3]| (0..3).filter(|&a| v[a] == 1 || v[a] == last[a]).count();
    let within = surface.voxels().iter().map(|v| at_border(v) == 1).collect();
    Voxels { grid: voxelised.grid, colors, within }
}

fn layers(grid: &LabelGrid) -> Vec<u8> {
    let [x, y, z] = grid.size();
    let mut out = vec![0; (x * y * z) as usize];
    let layer = (x * y) as usize;
    (0..z).for_each(|k| grid.copy_layer(k, &mut out[k as usize * layer..][..layer]).unwrap());
    out
}

fn import(name: &str, bytes: &[u8], folder: Option<&Path>) -> Model {
    let model = ImportOptions::default().import_slice(name, bytes, folder);
    model.unwrap_or_else(|e| panic!("{name}: {e}"))
}

/// A folder with the library and the texture of a scene.
fn folder(mtl: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.mtl"), mtl).unwrap();
    fs::write(folder.path().join("skin.png"), picture()).unwrap();
    folder
}

#[track_caller]
fn same(found: &Model, expected: &Voxels, colors: bool, odd: f64) {
    let name = found.name();
    let found = voxels(found);
    assert_eq!(found.grid.size(), expected.grid.size(), "{name}");
    assert!(layers(&found.grid) == layers(&expected.grid), "{name}: other voxels are solid");
    let differ = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > 0.004);
    if colors {
        let pairs = found.colors.iter().zip(&expected.colors).zip(&expected.within);
        // At an edge two sides are equally near, and rounding decides.
        let (all, wrong) = pairs
            .filter(|(_, within)| **within || odd > 0.0)
            .fold((0, 0), |(n, w), (pair, _)| (n + 1, w + usize::from(differ(pair))));
        assert!(all > 500 && wrong as f64 <= odd * all as f64, "{name}: {wrong} of {all} colours differ");
    }
}

#[test]
fn a_cube_of_six_colours_is_the_same_in_every_format() {
    let cube = cube();
    let expected = voxels(&import("cube.glb", &gltf(&cube, false), None));
    assert_eq!(expected.grid.histogram()[5], 20 * 20 * 20);
    let seen = SIDES.iter().filter(|side| {
        let side = side.map(linear);
        expected.colors.iter().any(|c| (0..3).all(|k| (c[k] - side[k]).abs() < 1e-4))
    });
    assert_eq!(seen.count(), 6);
    let (text, mtl) = obj(&cube, false);
    let folder = folder(&mtl);
    let models = [
        import("kd.obj", text.as_bytes(), Some(folder.path())),
        import("vertices.obj", obj_vertex_colors(&cube).as_bytes(), None),
        import("ascii.ply", &ply(&cube, Encoding::Ascii, PlyColors::Faces), None),
        import("little.ply", &ply(&cube, Encoding::Little, PlyColors::Faces), None),
        import("big.ply", &ply(&cube, Encoding::Big, PlyColors::Faces), None),
        import("base.3mf", &threemf(&cube, ThreeMfColors::Base), None),
        import("group.3mf", &threemf(&cube, ThreeMfColors::Group), None),
    ];
    for model in &models {
        same(model, &expected, true, 0.0);
        assert!(model.notes().is_empty(), "{}: {:?}", model.name(), model.notes());
    }
    for bytes in [stl_ascii(&cube), stl_binary(&cube)] {
        let model = import("cube.stl", &bytes, None);
        same(&model, &expected, false, 0.0);
        assert_eq!(model.vertices().len(), 8);
        assert!(voxels(&model).colors.iter().all(|c| *c == [1.0; 3]));
    }
}

#[test]
fn a_textured_sphere_is_the_same_in_every_format() {
    let sphere = sphere();
    let expected = voxels(&import("sphere.glb", &gltf(&sphere, true), None));
    let (text, mtl) = obj(&sphere, true);
    let folder = folder(&mtl);
    let beside = Some(folder.path());
    let models = [
        import("sphere.obj", text.as_bytes(), beside),
        import("ascii.ply", &ply(&sphere, Encoding::Ascii, PlyColors::Texture), beside),
        import("little.ply", &ply(&sphere, Encoding::Little, PlyColors::Wedges), beside),
        import("big.ply", &ply(&sphere, Encoding::Big, PlyColors::Texture), beside),
        import("sphere.3mf", &threemf(&sphere, ThreeMfColors::Texture), None),
    ];
    for model in &models {
        same(model, &expected, true, 0.01);
        assert_eq!(model.textures().len(), 1);
    }
    for bytes in [stl_ascii(&sphere), stl_binary(&sphere)] {
        same(&import("sphere.stl", &bytes, None), &expected, false, 0.0);
    }
}

#[test]
fn units_and_axes_are_the_formats_habits_or_those_asked_for() {
    let mut scene = cube();
    // Distinct extents: 10, 20 and 40 in print axes.
    scene.positions.iter_mut().for_each(|p| (p[1], p[2]) = (2.0 * p[1], 4.0 * p[2]));
    let extent = |model: &Model| {
        let [low, high] = model.bounds_m();
        let mm: [f64; 3] = std::array::from_fn(|a| 1000.0 * (high[a] - low[a]));
        mm.map(|c| (c * 1e3).round() / 1e3)
    };
    let files = [
        ("a.glb", gltf(&scene, false), "gltf", LengthUnit::Metre, UpAxis::Y),
        ("a.obj", obj_vertex_colors(&scene).into_bytes(), "obj", LengthUnit::Millimetre, UpAxis::Y),
        ("a.ply", ply(&scene, Encoding::Ascii, PlyColors::Faces), "ply", LengthUnit::Millimetre, UpAxis::Z),
        ("a.stl", stl_ascii(&scene), "stl", LengthUnit::Millimetre, UpAxis::Z),
        ("a.3mf", threemf(&scene, ThreeMfColors::Base), "3mf", LengthUnit::Millimetre, UpAxis::Z),
    ];
    for (name, bytes, format, unit, up) in files {
        // The content tells, whatever the name.
        for name in [name, "a", "a.txt", "a.stl"] {
            let model = import(name, &bytes, None);
            assert_eq!(extent(&model), [10.0, 20.0, 40.0], "{name}");
            let read_as = *model.read_as().unwrap();
            assert_eq!((read_as.format.name(), read_as.unit, read_as.up), (format, unit, up));
        }
        let other = if up == UpAxis::Y { UpAxis::Z } else { UpAxis::Y };
        let asked = ImportOptions {
            unit: Some(LengthUnit::Inch),
            up: Some(other),
            color: [0.5, 0.25, 0.125],
            ..ImportOptions::default()
        };
        let model = asked.import_slice(name, &bytes, None).unwrap();
        let scale = 0.0254 / unit.metres();
        let expected = [10.0, 40.0, 20.0].map(|c| (c * scale * 1e3).round() / 1e3);
        assert_eq!(extent(&model), expected, "{name}");
        assert_eq!(model.read_as().unwrap().unit, LengthUnit::Inch);
        assert_eq!(model.read_as().unwrap().up, other);
        let plain = model.color_at(0, [0.2, 0.3, 0.5], 0.0) == [0.5, 0.25, 0.125];
        assert_eq!(plain, format == "stl", "{name}");
    }
    let bad = ImportOptions { color: [0.0, 1.5, 0.0], ..ImportOptions::default() };
    let error = bad.import_slice("a.stl", &stl_ascii(&scene), None).unwrap_err().to_string();
    assert!(error.contains("ImportOptions::color"), "{error}");
}

#[test]
fn faces_look_outwards_in_every_format() {
    let cube = cube();
    let volume = |model: &Model| -> f64 {
        (0..model.triangles().len() as u32)
            .map(|t| {
                let [a, b, c] = model.corners_m(t);
                let cross = |k: usize| b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3];
                (0..3).map(|k| a[k] * cross(k)).sum::<f64>() / 6.0
            })
            .sum()
    };
    for (name, bytes) in [
        ("a.glb", gltf(&cube, false)),
        ("a.obj", obj_vertex_colors(&cube).into_bytes()),
        ("a.ply", ply(&cube, Encoding::Big, PlyColors::Faces)),
        ("a.stl", stl_binary(&cube)),
        ("a.3mf", threemf(&cube, ThreeMfColors::Group)),
    ] {
        for up in [UpAxis::Y, UpAxis::Z] {
            let options = ImportOptions { up: Some(up), ..ImportOptions::default() };
            let found = volume(&options.import_slice(name, &bytes, None).unwrap());
            assert!((found - 1e-6).abs() < 1e-11, "{name}: {found}");
        }
    }
}
