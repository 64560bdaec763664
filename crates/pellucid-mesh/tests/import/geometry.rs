//! Positions: transforms, topology, accessor types, skins, morphs.

use pellucid_mesh::{ImportLimits, Model, import_slice};
use serde_json::json;

use crate::glb::*;

/// Corners of the square's two triangles in print axes.
fn square_corners() -> Vec<[f64; 3]> {
    SQUARE_INDICES.iter().map(|&i| print_axes(SQUARE[i as usize].map(f64::from))).collect()
}

fn assert_corners(model: &Model, expected: &[[f64; 3]]) {
    let found = corners(model);
    assert_eq!(found.len(), expected.len());
    for (f, e) in found.iter().zip(expected) {
        assert!(close(*f, *e), "{f:?} is not {e:?}");
    }
}

/// Twice the signed area vector summed over all triangles.
fn area_vector(model: &Model) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for [a, b, c] in corners(model).as_chunks::<3>().0 {
        let (u, v) = ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]);
        sum[0] += u[1] * v[2] - u[2] * v[1];
        sum[1] += u[2] * v[0] - u[0] * v[2];
        sum[2] += u[0] * v[1] - u[1] * v[0];
    }
    sum
}

#[test]
fn y_up_becomes_z_up_without_mirroring() {
    let model = square().model();
    assert_corners(&model, &square_corners());
    // The square faces glTF's +z, which is print's -y.
    assert_eq!(area_vector(&model), [0.0, -2.0, 0.0]);
    assert_eq!(model.bounds_m(), [[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]);
    assert_eq!(model.color_at(0, [1.0, 0.0, 0.0], 0.0), [1.0; 3]);
}

#[test]
fn gltf_text_with_a_data_uri_reads_like_the_glb() {
    let glb = textured_square(&four_colors());
    let limits = ImportLimits::default();
    let text = import_slice("test.glb", &glb.gltf(), None, &limits).unwrap();
    assert_eq!(text, glb.model());
    let mut with_mark = b"\xEF\xBB\xBF \n".to_vec();
    with_mark.extend(glb.gltf());
    assert_eq!(import_slice("test.glb", &with_mark, None, &limits).unwrap(), text);
}

#[test]
fn parents_scale_rotate_then_translate_their_children() {
    let mut glb = square();
    // A quarter turn about z takes x to y.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let parent = glb.push(
        "nodes",
        json!({"children": [0], "translation": [10, 0, 0], "rotation": [0, 0, half, half], "scale": [2, 3, 1]}),
    );
    glb.at("/nodes/0")["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]);
    glb.at("/scenes/0")["nodes"] = json!([parent]);
    let place =
        |[x, y, z]: [f32; 3]| print_axes([10.0 - 3.0 * f64::from(y), 2.0 * f64::from(x), f64::from(z) + 5.0]);
    let expected: Vec<_> = SQUARE_INDICES.iter().map(|&i| place(SQUARE[i as usize])).collect();
    assert_corners(&glb.model(), &expected);
}

#[test]
fn a_mirroring_transform_keeps_the_outside_out() {
    let mut glb = square();
    glb.at("/nodes/0")["scale"] = json!([1, 1, -1]);
    // Mirrored in z, the square must face -z, which is print's +y.
    assert_eq!(area_vector(&glb.model()), [0.0, 2.0, 0.0]);
    glb.at("/nodes/0")["scale"] = json!([-1, 1, -1]);
    assert_eq!(area_vector(&glb.model()), [0.0, 2.0, 0.0]);
}

#[test]
fn only_the_default_scene_is_taken_or_else_every_root() {
    let mut glb = square();
    let second = glb.push("nodes", json!({"mesh": 0, "translation": [5, 0, 0]}));
    glb.push("scenes", json!({"nodes": [second]}));
    assert_eq!(glb.model().triangles().len(), 2);
    assert_eq!(glb.model().bounds_m()[1][0], 1.0);
    *glb.at("/scene") = json!(1);
    assert_eq!(glb.model().bounds_m()[1][0], 6.0);
    glb.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(glb.model().triangles().len(), 4);
    glb.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(glb.model().triangles().len(), 4);
    glb.at("/nodes/0")["extensions"] = json!({"KHR_node_visibility": {"visible": false}});
    assert_eq!(glb.model().bounds_m()[0][0], 5.0);
    assert!(glb.model().notes().iter().any(|n| n.object == "node 0 \"figure\""));
}

#[test]
fn several_meshes_and_primitives_keep_their_materials() {
    let mut glb = square();
    let red = glb.push("materials", json!({"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}));
    let first = glb.at("/meshes/0/primitives/0").clone();
    let mut second = first.clone();
    second["material"] = red.into();
    *glb.at("/meshes/0/primitives") = json!([first, second]);
    let mesh = glb.push("meshes", json!({"primitives": [second]}));
    let node = glb.push("nodes", json!({"mesh": mesh}));
    glb.at("/scenes/0")["nodes"] = json!([0, node]);
    let model = glb.model();
    let materials: Vec<_> = model.triangles().iter().map(|t| t.material).collect();
    assert_eq!(materials, [0, 0, 1, 1, 1, 1]);
    assert_eq!(model.color_at(5, [0.2, 0.3, 0.5], 0.0), [1.0, 0.0, 0.0]);
}

#[test]
fn strips_and_fans_wind_like_lists_and_drop_stitches() {
    let mut glb = square();
    let strip = glb.indices(&[0, 1, 3, 2]);
    glb.at("/meshes/0/primitives/0")["indices"] = strip.into();
    glb.at("/meshes/0/primitives/0")["mode"] = json!(5);
    assert_eq!(area_vector(&glb.model()), [0.0, -2.0, 0.0]);
    let stitched = glb.indices(&[0, 1, 3, 2, 2, 0, 0, 1, 3, 2]);
    glb.at("/meshes/0/primitives/0")["indices"] = stitched.into();
    assert_eq!(glb.model().triangles().len(), 4);
    assert_eq!(area_vector(&glb.model()), [0.0, -4.0, 0.0]);
    // The square's four corners in order are a fan as they stand.
    glb.at("/meshes/0/primitives/0").as_object_mut().unwrap().remove("indices");
    glb.at("/meshes/0/primitives/0")["mode"] = json!(6);
    assert_eq!(area_vector(&glb.model()), [0.0, -2.0, 0.0]);
}

#[test]
fn every_index_type_reads_alike() {
    let expected = square_corners();
    let small: Vec<u8> = SQUARE_INDICES.iter().map(|&i| i as u8).collect();
    let medium: Vec<u8> = SQUARE_INDICES.iter().flat_map(|&i| (i as u16).to_le_bytes()).collect();
    for (bytes, component) in [(small, U8), (medium, U16)] {
        let mut glb = square();
        let indices = glb.accessor(&bytes, component, "SCALAR", 6);
        glb.at("/meshes/0/primitives/0")["indices"] = indices.into();
        assert_corners(&glb.model(), &expected);
    }
    let mut glb = Glb::new();
    let position = glb.floats(&SQUARE_INDICES.map(|i| SQUARE[i as usize]));
    glb.mesh(json!({"attributes": {"POSITION": position}}));
    assert_corners(&glb.model(), &expected);
}

#[test]
fn quantised_positions_scale_by_their_node_and_normalise() {
    // 16-bit at a stride of 8, as the extension asks.
    let mut glb = square();
    let quantised = |scale: f32| -> Vec<u8> {
        let element = |p: &[f32; 3]| [p[0], p[1], p[2], 0.0].map(|c| (c * scale) as i16);
        SQUARE.iter().flat_map(element).flat_map(|c| c.to_le_bytes()).collect()
    };
    glb.push("extensionsRequired", json!("KHR_mesh_quantization"));
    let view = glb.view(&quantised(100.0));
    glb.at("/bufferViews")[view]["byteStride"] = json!(8);
    let accessor = json!({"bufferView": view, "componentType": I16, "type": "VEC3", "count": 4});
    *glb.at("/accessors/0") = accessor;
    glb.at("/nodes/0")["scale"] = json!([0.01, 0.01, 0.01]);
    assert_corners(&glb.model(), &square_corners());

    let view = glb.view(&quantised(32767.0));
    glb.at("/bufferViews")[view]["byteStride"] = json!(8);
    *glb.at("/accessors/0") =
        json!({"bufferView": view, "componentType": I16, "type": "VEC3", "count": 4, "normalized": true});
    glb.at("/nodes/0").as_object_mut().unwrap().remove("scale");
    assert_corners(&glb.model(), &square_corners());

    // -128 normalises to -1 like -127.
    let mut glb = square();
    let bytes: Vec<u8> = [[0, 0, 0], [127, 0, 0], [-128, -127, 0], [0, 127, 0]]
        .as_flattened()
        .iter()
        .map(|&c: &i8| c as u8)
        .collect();
    glb.accessor(&bytes, I8, "VEC3", 4);
    let accessors = glb.at("/accessors").as_array_mut().unwrap();
    let mut last = accessors.pop().unwrap();
    last["normalized"] = json!(true);
    accessors[0] = last;
    assert!(close(corners(&glb.model())[2], [-1.0, 0.0, -1.0]));
}

#[test]
fn interleaved_attributes_follow_the_stride() {
    let mut glb = textured_square(&four_colors());
    let expected = glb.model();
    let bytes: Vec<u8> = SQUARE
        .iter()
        .zip(&SQUARE_UV)
        .flat_map(|(p, uv)| [p[0], p[1], p[2], uv[0], uv[1]])
        .flat_map(f32::to_le_bytes)
        .collect();
    let view = glb.view(&bytes);
    glb.at("/bufferViews")[view]["byteStride"] = json!(20);
    *glb.at("/accessors/0") = json!({"bufferView": view, "componentType": F32, "type": "VEC3", "count": 4});
    *glb.at("/accessors/2") =
        json!({"bufferView": view, "byteOffset": 12, "componentType": F32, "type": "VEC2", "count": 4});
    assert_eq!(glb.model(), expected);
}

#[test]
fn sparse_values_replace_a_base_or_zeros() {
    let mut glb = square();
    let (indices, values) = (glb.view(&[1, 2]), glb.floats(&[[4.0, 0.0, 0.0], [4.0, 7.0, 0.0]]));
    let values = glb.at("/accessors")[values]["bufferView"].clone();
    let sparse = json!({
        "count": 2,
        "indices": {"bufferView": indices, "componentType": U8},
        "values": {"bufferView": values},
    });
    glb.at("/accessors/0")["sparse"] = sparse;
    let wide = |i: u32| match i {
        1 => [4.0, 0.0, 0.0],
        2 => [4.0, 0.0, 7.0],
        other => print_axes(SQUARE[other as usize].map(f64::from)),
    };
    assert_corners(&glb.model(), &SQUARE_INDICES.map(wide));
    // Without a buffer view the rest are zeros.
    glb.at("/accessors/0").as_object_mut().unwrap().remove("bufferView");
    let zeros = |i: u32| if i == 1 || i == 2 { wide(i) } else { [0.0; 3] };
    assert_corners(&glb.model(), &SQUARE_INDICES.map(zeros));
}

#[test]
fn shared_vertex_buffers_bring_only_the_vertices_in_use() {
    let mut glb = square();
    let half = glb.indices(&[0, 2, 3]);
    glb.at("/meshes/0/primitives/0")["indices"] = half.into();
    assert_eq!(glb.model().vertices().len(), 3);
}

#[test]
fn morph_targets_move_by_their_default_weights() {
    let mut glb = square();
    let lift = glb.floats(&[[0.0, 0.0, 1.0]; 4]);
    let unused = glb.floats(&[[f32::NAN; 3]; 4]);
    let zeros = glb.push("accessors", json!({"componentType": F32, "type": "VEC3", "count": 4}));
    glb.at("/meshes/0/primitives/0")["targets"] =
        json!([{"POSITION": lift}, {"POSITION": unused}, {"POSITION": zeros}, {"NORMAL": unused}]);
    assert_corners(&glb.model(), &square_corners());
    glb.at("/meshes/0")["weights"] = json!([0.5, 0, 1, 1]);
    assert_eq!(glb.model().bounds_m()[0][1], -0.5);
    glb.at("/nodes/0")["weights"] = json!([2]);
    assert_eq!(glb.model().bounds_m()[0][1], -2.0);
}

/// The square with its top edge on one joint and its bottom edge on another.
fn skinned() -> Glb {
    let mut glb = square();
    let joints: Vec<u8> = [[0, 1, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]].as_flattened().to_vec();
    let joints = glb.accessor(&joints, U8, "VEC4", 4);
    // Two thirds and one third of 255 below; all of one joint above.
    let weights: Vec<u8> =
        [[170, 85, 0, 0], [170, 85, 0, 0], [255, 0, 0, 0], [255, 0, 0, 0]].as_flattened().to_vec();
    let weights = glb.accessor(&weights, U8, "VEC4", 4);
    let bind = |x: f32| [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, 0.0, 0.0, 1.0];
    let matrices = glb.floats(&[bind(0.0), bind(-1.0)]);
    let root = glb.push("nodes", json!({"children": [2], "translation": [0, 0, 3]}));
    let tip = glb.push("nodes", json!({"translation": [4, 0, 0]}));
    glb.push("skins", json!({"joints": [root, tip], "inverseBindMatrices": matrices}));
    glb.at("/nodes/0")["skin"] = json!(0);
    // A skinned mesh ignores its own node.
    glb.at("/nodes/0")["translation"] = json!([100, 100, 100]);
    let attributes = &mut glb.at("/meshes/0/primitives/0")["attributes"];
    attributes["JOINTS_0"] = joints.into();
    attributes["WEIGHTS_0"] = weights.into();
    glb
}

#[test]
fn skins_blend_world_joints_times_inverse_binds() {
    let bottom = |x: f64| print_axes([x + 1.0, 0.0, 3.0]);
    let top = |x: f64| print_axes([x + 3.0, 1.0, 3.0]);
    let expected = [bottom(0.0), bottom(1.0), top(1.0), bottom(0.0), top(1.0), top(0.0)];
    assert_corners(&skinned().model(), &expected);
}

#[test]
fn a_skin_that_mirrors_keeps_the_outside_out() {
    let mut glb = skinned();
    glb.at("/nodes/1")["scale"] = json!([1, 1, -1]);
    let area = area_vector(&glb.model());
    assert!(area[1] > 0.0, "{area:?}");
}

#[test]
fn positions_agree_with_the_gltf_crate() {
    for mut glb in [square(), textured_square(&four_colors())] {
        // That crate insists on bounds.
        glb.at("/accessors/0")["min"] = json!([0, 0, 0]);
        glb.at("/accessors/0")["max"] = json!([1, 1, 0]);
        let bytes = glb.bytes();
        let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&bytes).unwrap();
        let mut expected = Vec::new();
        for node in document.default_scene().unwrap().nodes() {
            for primitive in node.mesh().unwrap().primitives() {
                let reader = primitive.reader(|_| blob.as_deref());
                let positions: Vec<_> = reader.read_positions().unwrap().collect();
                let corner = |i: u32| print_axes(positions[i as usize].map(f64::from));
                expected.extend(reader.read_indices().unwrap().into_u32().map(corner));
            }
        }
        assert_corners(&glb.model(), &expected);
    }
}

/// Objects of the notes whose text holds `words`.
fn noted(model: &Model, words: &str) -> Vec<String> {
    model.notes().iter().filter(|n| n.text.contains(words)).map(|n| n.object.clone()).collect()
}

#[test]
fn what_a_scale_collapses_is_left_out_with_a_note() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    for node in [
        json!({"scale": [0, 0, 0], "translation": [0, 4, 0]}),
        json!({"scale": [0, 0, 1], "rotation": [0.5, 0.5, 0.5, 0.5], "translation": [0, 4, 0]}),
        json!({"scale": [3, 0, 0], "rotation": [half, 0, half, 0], "translation": [-4, 0, 0]}),
        json!({"matrix": [1, 2, 3, 0, 2, 4, 6, 0, 0, 0, 0, 0, 9, 9, 9, 1]}),
    ] {
        let mut glb = square();
        let mut hidden = node.clone();
        hidden["mesh"] = json!(0);
        hidden["name"] = json!("hidden");
        let hidden = glb.push("nodes", hidden);
        glb.at("/scenes/0")["nodes"] = json!([hidden, 0]);
        let model = glb.model();
        assert_eq!(model.bounds_m(), square().model().bounds_m(), "{node}");
        assert_eq!(noted(&model, "left out"), ["node 1 \"hidden\""], "{node}");
        // The same from a parent.
        let mut glb = square();
        let child = glb.push("nodes", json!({"mesh": 0, "translation": [1, 2, 3]}));
        let mut parent = node.clone();
        parent["children"] = json!([child]);
        let parent = glb.push("nodes", parent);
        glb.at("/scenes/0")["nodes"] = json!([0, parent]);
        assert_eq!(glb.model().bounds_m(), square().model().bounds_m(), "{node}");
    }
    // A mirror image and a flat one stay.
    for scale in [[-1.0, 1.0, 1.0], [2.0, 1.0, 0.0]] {
        let mut glb = square();
        glb.at("/nodes/0")["scale"] = json!(scale);
        assert_eq!(glb.model().triangles().len(), 2);
    }
}

#[test]
fn triangles_without_area_do_not_count_for_the_size() {
    let corners = [[0.0, -9.0, 0.0], [5.0, -9.0, 0.0], [9.0, -9.0, 0.0]];
    for (stray, indices) in [
        ([corners[0]; 3], [0, 1, 2]),
        ([corners[0], corners[0], corners[1]], [0, 1, 2]),
        (corners, [0, 1, 2]),
        (corners, [0, 2, 2]),
    ] {
        let mut glb = square();
        let (position, indices) = (glb.floats(&stray), glb.indices(&indices));
        let primitive = json!({"attributes": {"POSITION": position}, "indices": indices});
        glb.at("/meshes/0/primitives").as_array_mut().unwrap().insert(0, primitive);
        let model = glb.model();
        assert_eq!(model.bounds_m(), square().model().bounds_m(), "{stray:?}");
        assert_eq!(noted(&model, "without area").len(), 1, "{:?}", model.notes());
    }
}
