//! What is refused, and what the error says.

use std::fs;

use pellucid_mesh::{ImportLimits, MeshError, import_path, import_slice};
use serde_json::json;

use crate::glb::*;

#[derive(Debug, PartialEq)]
enum Kind {
    Invalid,
    Unsupported,
    Io,
}
use Kind::{Invalid, Io, Unsupported};

/// Asserts the kind of an error, its file, and a part of its object and of its reason.
#[track_caller]
fn refused(result: Result<pellucid_mesh::Model, MeshError>, kind: Kind, object: &str, reason: &str) {
    let error = match result {
        Ok(_) => panic!("imported, but {object} should be refused: {reason}"),
        Err(error) => error,
    };
    let text = error.to_string();
    let (found, file, place, remedy) = match &error {
        MeshError::Invalid { file, object, remedy, .. } => (Invalid, file, object, remedy),
        MeshError::Unsupported { file, object, remedy, .. } => (Unsupported, file, object, remedy),
        MeshError::Io { file, object, remedy, .. } => (Io, file, object, remedy),
        other => panic!("{other}"),
    };
    assert_eq!(found, kind, "{text}");
    assert!(place.contains(object), "{text}: not about {object}");
    assert!(text.contains(reason), "{text}: does not say {reason}");
    assert!(!file.is_empty() && text.contains(file.as_str()) && text.contains(remedy.as_str()));
    assert!(remedy.len() > 10, "{text}: no remedy");
    // The cause is in the chain, once.
    if let Some(cause) = std::error::Error::source(&error) {
        assert!(!text.contains(&cause.to_string()), "{text} repeats its cause");
    }
    assert_eq!(kind == Io, std::error::Error::source(&error).is_some());
}

fn with_limits(glb: &Glb, change: impl Fn(&mut ImportLimits)) -> Result<pellucid_mesh::Model, MeshError> {
    let mut limits = ImportLimits::default();
    change(&mut limits);
    import_slice("test.glb", &glb.bytes(), None, &limits)
}

#[test]
fn things_that_are_not_gltf() {
    let import = |bytes: &[u8]| import_slice("x", bytes, None, &ImportLimits::default());
    refused(import(b""), Invalid, "file", "neither");
    refused(import(b"<COLLADA/>"), Invalid, "file", "neither");
    refused(import(b"Kaydara FBX Binary  \0"), Unsupported, "file", "FBX");
    refused(import(b"{"), Invalid, "JSON", "EOF");
    refused(import(b"{}"), Invalid, "JSON", "asset");
    refused(import(br#"{"asset":{"version":"1.0"},"nodes":{}}"#), Unsupported, "asset.version", "1.0");
    refused(import(br#"{"asset":{"version":"2.0"}}"#), Invalid, "model", "no triangles");
    let deep = format!("{{\"extras\":{}", "[".repeat(100_000));
    refused(import(deep.as_bytes()), Invalid, "JSON", "EOF");
}

#[test]
fn broken_containers() {
    let good = square().bytes();
    let import = |bytes: &[u8]| import_slice("x.glb", bytes, None, &ImportLimits::default());
    refused(import(&good[..6]), Invalid, "GLB header", "cut short");
    refused(import(&good[..good.len() - 1]), Invalid, "GLB header", "length");
    let edited = |at: usize, value: u32| {
        let mut bytes = good.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        import(&bytes)
    };
    refused(edited(4, 1), Unsupported, "GLB header", "version 1");
    refused(edited(8, 11), Invalid, "GLB header", "length");
    refused(edited(8, u32::MAX), Invalid, "GLB header", "length");
    refused(edited(12, u32::MAX), Invalid, "GLB chunk 0", "claims");
    refused(edited(16, 7), Invalid, "GLB chunk 0", "not JSON");
    let bin_header = 20 + u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    refused(edited(bin_header, u32::MAX - 3), Invalid, "GLB chunk 1", "claims");
    refused(edited(bin_header + 4, 7), Invalid, "buffer 0", "neither");
}

#[test]
fn compression_is_named_wherever_it_is_listed() {
    for list in ["extensionsUsed", "extensionsRequired"] {
        let mut draco = square();
        draco.push(list, "KHR_draco_mesh_compression".into());
        draco.at("/meshes/0/primitives/0")["extensions"] =
            json!({"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}});
        draco.at("/accessors/0").as_object_mut().unwrap().remove("bufferView");
        refused(draco.import(), Unsupported, "mesh 0 \"body\", primitive 0", "Draco");
        // A writer that lists the extension but left it off the primitive.
        draco.at("/meshes/0/primitives/0").as_object_mut().unwrap().remove("extensions");
        refused(draco.import(), Unsupported, "POSITION (accessor 0)", "KHR_draco_mesh_compression");

        for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
            let mut meshopt = square();
            meshopt.push(list, name.into());
            meshopt.at("/bufferViews/0")["extensions"] =
                json!({name: {"buffer": 0, "byteLength": 48, "mode": "ATTRIBUTES"}});
            let kind = if cfg!(feature = "meshopt") { Invalid } else { Unsupported };
            refused(meshopt.import(), kind, "POSITION (accessor 0)", "meshopt");
            meshopt.at("/bufferViews/0").as_object_mut().unwrap().remove("extensions");
            meshopt.at("/accessors/0").as_object_mut().unwrap().remove("bufferView");
            refused(meshopt.import(), Unsupported, "POSITION", name);
        }
    }
}

#[test]
fn unknown_required_extensions() {
    let mut glb = square();
    glb.push("extensionsUsed", "ACME_shape".into());
    glb.model();
    glb.push("extensionsRequired", "ACME_shape".into());
    refused(glb.import(), Unsupported, "extensionsRequired \"ACME_shape\"", "without");
    let mut glb = square();
    glb.at("/nodes/0")["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": {}}});
    refused(glb.import(), Unsupported, "node 0 \"figure\"", "instanc");
}

#[test]
fn textures_that_cannot_be_had() {
    let with_image = |bytes: &[u8]| textured_square(bytes).import();
    let webp = with_image(b"RIFF\x10\0\0\0WEBPVP8 ");
    match cfg!(feature = "webp") {
        true => refused(webp, Invalid, "image 0 \"skin\"", "decoded"),
        false => refused(webp, Unsupported, "image 0 \"skin\"", "webp"),
    }
    refused(with_image(b"\xABKTX 20\xBB\r\n\x1A\n...."), Unsupported, "image 0 \"skin\"", "ktx2");
    refused(with_image(b"\0\0\0\x1cftypavif"), Unsupported, "image 0 \"skin\"", "avif");
    refused(with_image(b"nothing known"), Unsupported, "image 0 \"skin\"", "neither PNG nor JPEG");
    let png = four_colors();
    refused(with_image(&png[..png.len() / 2]), Invalid, "image 0 \"skin\"", "decoded");
    refused(with_image(&png[..8]), Invalid, "image 0 \"skin\"", "decoded");

    for name in ["KHR_texture_basisu", "EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds"] {
        let mut glb = textured_square(&png);
        *glb.at("/textures/0") = json!({"extensions": {name: {"source": 0}}});
        glb.push("extensionsRequired", name.into());
        if name != "EXT_texture_webp" || cfg!(not(feature = "webp")) {
            refused(glb.import(), Unsupported, "material 0 \"paint\", texture 0", name);
        }
        // With a plain image as well, that one is used.
        glb.at("/textures/0")["source"] = json!(0);
        glb.model();
    }
    let mut glb = textured_square(&png);
    *glb.at("/textures/0") = json!({});
    refused(glb.import(), Invalid, "texture 0", "no image");
    let mut glb = textured_square(&png);
    *glb.at("/images/0") = json!({"name": "skin"});
    refused(glb.import(), Invalid, "image 0 \"skin\"", "neither a URI nor");
    let mut glb = textured_square(&png);
    glb.at("/meshes/0/primitives/0/attributes").as_object_mut().unwrap().remove("TEXCOORD_0");
    refused(glb.import(), Invalid, "primitive 0", "TEXCOORD_0");
    let mut glb = textured_square(&png);
    glb.push("samplers", json!({"wrapS": 5}));
    glb.at("/textures/0")["sampler"] = json!(0);
    refused(glb.import(), Invalid, "sampler 0", "wrapS 5");
}

/// A PNG whose header claims a size that its data does not have.
fn claimed_size(width: u32, height: u32) -> Vec<u8> {
    let mut png = four_colors();
    png[16..20].copy_from_slice(&width.to_be_bytes());
    png[20..24].copy_from_slice(&height.to_be_bytes());
    let mut crc = u32::MAX;
    for &byte in &png[12..29] {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ 0xEDB8_8320 } else { crc >> 1 };
        }
    }
    png[29..33].copy_from_slice(&(!crc).to_be_bytes());
    png
}

#[test]
fn picture_sizes_are_checked_before_decoding() {
    // The data would fail to decode, so the message shows that the header was what stopped it.
    let import = |w, h| textured_square(&claimed_size(w, h)).import();
    refused(import(3, 2), Invalid, "image 0", "decoded");
    refused(import(16_385, 1), Unsupported, "image 0", "a side");
    refused(import(1 << 30, 1 << 30), Unsupported, "image 0", "a side");
    refused(import(16_384, 8_193), Unsupported, "image 0", "the limit is 134217728");
    let glb = textured_square(&claimed_size(1000, 1000));
    refused(with_limits(&glb, |l| l.texture_bytes = 2_000_000), Unsupported, "image 0", "2000000 are left");
    refused(import(0, 1), Invalid, "image 0", "decoded");
}

#[test]
fn accessors_and_indices_out_of_range() {
    let edit = |pointer: &str, value: serde_json::Value| {
        let mut glb = square();
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        glb.at(parent)[key] = value;
        glb.import()
    };
    refused(edit("/accessors/0/count", json!(5)), Invalid, "POSITION (accessor 0)", "do not fit");
    refused(edit("/accessors/0/count", json!(u64::MAX)), Invalid, "POSITION (accessor 0)", "do not fit");
    refused(edit("/accessors/0/byteOffset", json!(4)), Invalid, "POSITION", "do not fit");
    refused(edit("/accessors/0/byteOffset", json!(u64::MAX)), Invalid, "POSITION", "do not fit");
    refused(edit("/accessors/0/bufferView", json!(9)), Invalid, "POSITION", "buffer view 9");
    refused(edit("/accessors/0/componentType", json!(5130)), Invalid, "POSITION", "component type 5130");
    refused(
        edit("/accessors/1/componentType", json!(F32)),
        Invalid,
        "indices (accessor 1)",
        "component type",
    );
    refused(edit("/accessors/0/type", json!("VEC2")), Invalid, "POSITION", "VEC3");
    refused(edit("/accessors/0/count", json!(-1)), Invalid, "JSON", "-1");
    refused(edit("/bufferViews/0/byteOffset", json!(1000)), Invalid, "buffer view 0", "past the end");
    refused(edit("/bufferViews/0/byteLength", json!(u64::MAX)), Invalid, "buffer view 0", "past the end");
    refused(edit("/bufferViews/0/byteStride", json!(8)), Invalid, "POSITION", "overlap");
    refused(edit("/bufferViews/0/buffer", json!(1)), Invalid, "buffer view 0", "buffer 1");
    refused(edit("/buffers", json!([{"byteLength": 1_000_000}])), Invalid, "buffer 0", "claims 1000000");
    refused(
        edit("/meshes/0/primitives/0/indices", json!(4_294_967_297u64)),
        Invalid,
        "indices",
        "does not exist",
    );
    refused(edit("/meshes/0/primitives/0/material", json!(0)), Invalid, "primitive 0", "material 0");
    refused(edit("/meshes/0/primitives/0/mode", json!(7)), Invalid, "primitive 0", "mode 7");
    refused(edit("/nodes/0/mesh", json!(1)), Invalid, "node 0 \"figure\"", "mesh 1");
    refused(edit("/nodes/0/skin", json!(0)), Invalid, "skin 0", "does not exist");
    refused(edit("/scene", json!(1)), Invalid, "scene 1", "does not exist");
    refused(edit("/scenes/0/nodes", json!([0, 8])), Invalid, "scene 0", "node 8");

    let mut glb = square();
    let indices = glb.indices(&[0, 1, 4]);
    glb.at("/meshes/0/primitives/0")["indices"] = indices.into();
    refused(glb.import(), Invalid, "mesh 0 \"body\", primitive 0, indices", "index 4 at 2");

    let mut glb = square();
    let colors = glb.floats(&[[1.0; 3]; 3]);
    glb.at("/meshes/0/primitives/0/attributes")["COLOR_0"] = colors.into();
    refused(glb.import(), Invalid, "COLOR_0", "3 elements for 4");
}

#[test]
fn broken_sparse_accessors() {
    let import = |count: usize, indices: &[u8], component: u32| {
        let mut glb = square();
        let (indices, values) = (glb.view(indices), glb.view(&[0; 24]));
        glb.at("/accessors/0")["sparse"] = json!({
            "count": count,
            "indices": {"bufferView": indices, "componentType": component},
            "values": {"bufferView": values},
        });
        glb.import()
    };
    import(2, &[1, 3], U8).unwrap();
    refused(import(2, &[3, 1], U8), Invalid, "POSITION (accessor 0), sparse", "ascending");
    refused(import(2, &[1, 1], U8), Invalid, "sparse", "ascending");
    refused(import(2, &[1, 4], U8), Invalid, "sparse", "below 4");
    refused(import(2, &[1], U8), Invalid, "sparse indices", "do not fit");
    refused(import(3, &[1, 2, 3], U8), Invalid, "sparse values", "do not fit");
    refused(import(5, &[0; 5], U8), Invalid, "sparse", "5 of 4");
    refused(import(1, &[0; 4], F32), Invalid, "sparse", "unsigned");
}

#[test]
fn positions_that_are_no_numbers() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut glb = Glb::new();
        let mut positions = SQUARE;
        positions[2][1] = bad;
        let position = glb.floats(&positions);
        glb.mesh(json!({"attributes": {"POSITION": position}, "mode": 6}));
        refused(glb.import(), Invalid, "mesh 0 \"body\", primitive 0", "vertex 2 is NaN or infinite");
    }
    let mut glb = square();
    glb.at("/nodes/0")["scale"] = json!([1e308, 1, 1]);
    let parent = glb.push("nodes", json!({"children": [0], "scale": [1e308, 1, 1]}));
    glb.at("/scenes/0")["nodes"] = json!([parent]);
    refused(glb.import(), Invalid, "primitive 0", "infinite");
    let mut glb = square();
    glb.at("/nodes/0")["translation"] = json!([1e10, 0, 0]);
    refused(glb.import(), Unsupported, "vertex 0", "1e9 m");
    glb.at("/nodes/0")["rotation"] = json!([0, 0, 0, 0]);
    refused(glb.import(), Invalid, "node 0", "quaternion");
    let mut glb = textured_square(&four_colors());
    let uv = glb.floats(&[[f32::NAN, 0.0]; 4]);
    glb.at("/meshes/0/primitives/0/attributes")["TEXCOORD_0"] = uv.into();
    refused(glb.import(), Invalid, "primitive 0", "texture coordinate");
}

#[test]
fn no_triangles() {
    let mut glb = square();
    glb.at("/meshes/0/primitives/0")["mode"] = json!(1);
    refused(glb.import(), Invalid, "model", "no triangles");
    let mut glb = square();
    glb.at("/scenes/0")["nodes"] = json!([]);
    refused(glb.import(), Invalid, "model", "no triangles");
    let mut glb = square();
    let repeated = glb.indices(&[0, 0, 1]);
    glb.at("/meshes/0/primitives/0")["indices"] = repeated.into();
    refused(glb.import(), Invalid, "model", "no triangles");
    let mut glb = square();
    *glb.at("/meshes/0/primitives/0/attributes") = json!({});
    refused(glb.import(), Invalid, "model", "no triangles");
}

#[test]
fn node_graphs_that_are_no_forest() {
    let nodes = |nodes: serde_json::Value| {
        let mut glb = square();
        *glb.at("/nodes") = nodes;
        glb.import()
    };
    refused(nodes(json!([{"mesh": 0, "children": [0]}])), Invalid, "node 0", "cycle");
    refused(nodes(json!([{"mesh": 0}, {"children": [2]}, {"children": [1]}])), Invalid, "node 1", "cycle");
    refused(
        nodes(json!([{"mesh": 0, "children": [1]}, {"name": "arm"}, {"children": [1]}])),
        Invalid,
        "node 1 \"arm\"",
        "two parents",
    );
    refused(nodes(json!([{"mesh": 0, "children": [1, 1]}, {}])), Invalid, "node 1", "two parents");
    refused(nodes(json!([{"mesh": 0, "children": [5]}])), Invalid, "node 0", "child 5");
}

#[test]
fn broken_skins() {
    let skinned = |joints: serde_json::Value, vertex_joint: u8, weight: f32| {
        let mut glb = square();
        let joint = glb.accessor(&[vertex_joint, 0, 0, 0].repeat(4), U8, "VEC4", 4);
        let weights = glb.floats(&[[weight, 0.0, 0.0, 0.0]; 4]);
        let bind = glb.floats(&[[1.0; 16]]);
        glb.push("skins", json!({"name": "rig", "joints": joints, "inverseBindMatrices": bind}));
        glb.at("/nodes/0")["skin"] = json!(0);
        let attributes = &mut glb.at("/meshes/0/primitives/0")["attributes"];
        attributes["JOINTS_0"] = joint.into();
        attributes["WEIGHTS_0"] = weights.into();
        glb.import()
    };
    skinned(json!([0]), 0, 1.0).unwrap();
    // A vertex on no joint stays with its node.
    skinned(json!([0]), 9, 0.0).unwrap();
    refused(skinned(json!([0]), 1, 1.0), Invalid, "primitive 0", "joint 1");
    refused(skinned(json!([0]), 0, f32::NAN), Invalid, "primitive 0", "weight");
    refused(skinned(json!([7]), 0, 1.0), Invalid, "skin 0 \"rig\"", "joint 7");
    refused(skinned(json!([0, 0]), 0, 1.0), Invalid, "skin 0 \"rig\"", "1 matrices for 2");
}

#[test]
fn limits_hold() {
    let glb = square();
    let size = glb.bytes().len() as u64;
    with_limits(&glb, |l| (l.file_bytes, l.vertices, l.triangles) = (size, 4, 2)).unwrap();
    refused(with_limits(&glb, |l| l.file_bytes = size - 1), Unsupported, "file", "bytes");
    refused(with_limits(&glb, |l| l.vertices = 3), Unsupported, "primitive 0", "3 vertices");
    refused(with_limits(&glb, |l| l.triangles = 1), Unsupported, "primitive 0", "1 triangles");
    refused(with_limits(&glb, |l| l.items = 5), Unsupported, "JSON", "objects and arrays");
    refused(with_limits(&glb, |l| l.json_values = 5), Unsupported, "JSON", "values");

    let mut nested = square();
    for child in 0..20 {
        nested.push("nodes", json!({"children": [child]}));
    }
    nested.at("/scenes/0")["nodes"] = json!([20]);
    with_limits(&nested, |l| l.nesting = 21).unwrap();
    refused(with_limits(&nested, |l| l.nesting = 20), Unsupported, "node 0", "nested deeper than 20");

    let mut morphed = square();
    let target = morphed.floats(&[[1.0; 3]; 4]);
    morphed.at("/meshes/0/primitives/0")["targets"] = json!(vec![json!({"POSITION": target}); 10]);
    morphed.at("/meshes/0")["weights"] = json!(vec![1.0; 10]);
    with_limits(&morphed, |l| l.deformations = 40).unwrap();
    refused(with_limits(&morphed, |l| l.deformations = 39), Unsupported, "primitive 0", "morphs");

    // Claims without data behind them meet the limit before any allocation.
    let mut claim = square();
    let (index, value) = (claim.view(&[0, 0, 0, 0]), claim.view(&[0; 12]));
    *claim.at("/accessors/0") = json!({
        "componentType": F32, "type": "VEC3", "count": 1u64 << 60,
        "sparse": {"count": 1, "indices": {"bufferView": index, "componentType": U32}, "values": {"bufferView": value}},
    });
    claim.at("/meshes/0/primitives/0").as_object_mut().unwrap().remove("indices");
    refused(claim.import(), Unsupported, "primitive 0", "triangles");
}

#[test]
fn files_beside_the_model() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    fs::create_dir_all(model.join("textures")).unwrap();
    let glb = textured_square(&four_colors());
    let write = |uri: &str, image: &str| {
        let mut json = glb.json.clone();
        json["buffers"] = json!([{"byteLength": glb.bin.len(), "uri": uri}]);
        json["images"] = json!([{"uri": image}]);
        fs::write(model.join("figure.gltf"), json.to_string()).unwrap();
        import_path(model.join("figure.gltf"), &ImportLimits::default())
    };
    fs::write(model.join("figure.bin"), &glb.bin).unwrap();
    fs::write(model.join("textures/my skin é.png"), four_colors()).unwrap();
    fs::write(folder.path().join("secret.png"), four_colors()).unwrap();
    let skin = "textures/my%20skin%20%C3%A9.png";

    let imported = write("figure.bin", skin).unwrap();
    let expected = glb.model();
    assert_eq!(imported.vertices(), expected.vertices());
    assert_eq!(imported.textures(), expected.textures());
    assert!(imported.name().ends_with("figure.gltf"));
    write("./figure.bin", "./textures/my skin é.png").unwrap();

    refused(write("gone.bin", skin), Io, "buffer 0, URI \"gone.bin\"", "cannot be read");
    refused(write("figure.bin", "gone.png"), Io, "image 0, URI \"gone.png\"", "cannot be read");
    let absolute = folder.path().join("secret.png").display().to_string();
    let escapes = [
        "../secret.png",
        "textures/../../secret.png",
        "%2e%2e/secret.png",
        "..%2Fsecret.png",
        "..\\secret.png",
        absolute.as_str(),
        "file:///secret.png",
        "https://example.com/secret.png",
        "C:/secret.png",
        "",
        "a%00.png",
        "%zz.png",
        "%ff.png",
    ];
    for uri in escapes {
        refused(write("figure.bin", uri), Invalid, "image 0", "URI");
        refused(write(uri, skin), Invalid, "buffer 0", "URI");
    }
    refused(write("figure.bin", "%zz.png"), Invalid, "image 0", "a % that is no escape");
    refused(write("textures", skin), Invalid, "buffer 0", "not a regular file");
    refused(write("data:;base64,%%%", skin), Invalid, "buffer 0", "base64");
    refused(write("data:nothing", skin), Invalid, "buffer 0", "comma");
    refused(write("data:,abc", skin), Invalid, "buffer 0", "claims");

    let bytes = fs::read(model.join("figure.gltf")).unwrap();
    let mut beside = serde_json::from_slice::<serde_json::Value>(&bytes).unwrap();
    beside["buffers"][0]["uri"] = json!("figure.bin");
    let text = beside.to_string();
    let alone = import_slice("figure.gltf", text.as_bytes(), None, &ImportLimits::default());
    refused(alone, Invalid, "buffer 0", "without a folder");
    let small = ImportLimits { file_bytes: text.len() as u64 + 1, ..ImportLimits::default() };
    fs::write(model.join("figure.bin"), vec![0; text.len() + 2]).unwrap();
    let large = import_slice("figure.gltf", text.as_bytes(), Some(&model), &small);
    refused(large, Unsupported, "buffer 0", "allowed for the model's files");
    refused(import_path(model.join("none.glb"), &small), Io, "file", "cannot be read");
    refused(import_path(&model, &small), Invalid, "file", "not a regular file");
}

#[test]
fn names_that_an_exporter_did_not_escape_are_found() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir_all(folder.path().join("tex%/deep")).unwrap();
    let glb = square();
    let read = |uri: &str| {
        let mut json = glb.json.clone();
        json["buffers"] = json!([{"byteLength": glb.bin.len(), "uri": uri}]);
        let limits = ImportLimits::default();
        import_slice("f.gltf", json.to_string().as_bytes(), Some(folder.path()), &limits)
    };
    // The name in the folder and the URIs that mean it.
    let cases: [(&str, &[&str]); 8] = [
        ("example 10%.bin", &["example 10%.bin", "example%2010%25.bin", "example 10%25.bin"]),
        ("50%", &["50%", "50%25"]),
        ("%zz.bin", &["%zz.bin", "%25zz.bin"]),
        ("%4", &["%4"]),
        ("100%é.bin", &["100%é.bin", "100%%C3%A9.bin"]),
        // Escaped as it stands on the disk, by accident or not.
        ("a%20b.bin", &["a%20b.bin", "a%2520b.bin"]),
        ("%ff.bin", &["%ff.bin"]),
        ("tex%/deep/a.bin", &["tex%\\deep\\a.bin", ".\\tex%/deep\\a.bin", "tex%25%5Cdeep%5ca.bin"]),
    ];
    for (name, uris) in cases {
        let path = folder.path().join(name);
        fs::write(&path, &glb.bin).unwrap();
        for uri in uris {
            read(uri).unwrap_or_else(|e| panic!("{uri:?} for {name:?}: {e}"));
        }
        fs::remove_file(path).unwrap();
    }
    fs::write(folder.path().join("a b.bin"), &glb.bin).unwrap();
    fs::write(folder.path().join("a%20b.bin"), [0; 1]).unwrap();
    read("a%20b.bin").expect("an escape comes before the name as it is written");
    for outside in
        ["..\\f.bin", "tex%\\..\\..\\f.bin", "\\\\host\\f.bin", "C:\\f.bin", "%2e%2e%5cf.bin", "a%00%.bin"]
    {
        refused(read(outside), Invalid, "buffer 0", "URI");
    }
}

#[cfg(unix)]
#[test]
fn links_out_of_the_folder_are_not_followed() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("model");
    fs::create_dir(&model).unwrap();
    let glb = square();
    fs::write(folder.path().join("outside.bin"), &glb.bin).unwrap();
    fs::write(model.join("inside.bin"), &glb.bin).unwrap();
    std::os::unix::fs::symlink("../outside.bin", model.join("out.bin")).unwrap();
    std::os::unix::fs::symlink("inside.bin", model.join("in.bin")).unwrap();
    std::os::unix::fs::symlink("..", model.join("up")).unwrap();
    let import = |uri: &str| {
        let mut json = glb.json.clone();
        json["buffers"] = json!([{"byteLength": glb.bin.len(), "uri": uri}]);
        import_slice("f.gltf", json.to_string().as_bytes(), Some(&model), &ImportLimits::default())
    };
    import("in.bin").unwrap();
    refused(import("out.bin"), Invalid, "buffer 0", "through a link");
    refused(import("up/outside.bin"), Invalid, "buffer 0", "through a link");
}
