//! Base colour: factor, texture, vertex colour, coordinates, samplers.

use pellucid_mesh::{Filter, Mip, Model, Sampler, Wrap};
use serde_json::json;

use crate::glb::*;

/// Colour at glTF (x, y) of the square, the texture read as magnified.
fn at(model: &Model, x: f64, y: f64) -> [f32; 3] {
    // Triangle 0 is (0,0) (1,0) (1,1), triangle 1 (0,0) (1,1) (0,1).
    if y <= x {
        model.color_at(0, [1.0 - x, x - y, y], 0.0)
    } else {
        model.color_at(1, [1.0 - y, x, y - x], 0.0)
    }
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
const WHITE: [f32; 3] = [1.0; 3];

fn nearest(glb: &mut Glb) {
    let sampler = glb.push("samplers", json!({"magFilter": 9728, "minFilter": 9984}));
    glb.at("/textures/0")["sampler"] = sampler.into();
}

#[test]
fn the_first_texel_is_the_upper_left_corner() {
    let mut glb = textured_square(&four_colors());
    nearest(&mut glb);
    let model = glb.model();
    assert_eq!(at(&model, 0.25, 0.75), RED);
    assert_eq!(at(&model, 0.75, 0.75), GREEN);
    assert_eq!(at(&model, 0.25, 0.25), BLUE);
    assert_eq!(at(&model, 0.75, 0.25), WHITE);
}

#[test]
fn srgb_texels_decode_to_linear_light() {
    let model = textured_square(&png(1, 1, &[[0, 128, 10]])).model();
    let [r, g, b] = at(&model, 0.5, 0.5);
    assert_eq!(r, 0.0);
    // IEC 61966-2-1: 128/255 is 0.2158605, and 10/255 lies on the straight part's edge.
    assert!((g - 0.215_860_5).abs() < 1e-6, "{g}");
    assert!((f64::from(b) - 10.0 / 255.0 / 12.92).abs() < 1e-6, "{b}");
}

#[test]
fn jpeg_and_sixteen_bit_png_decode() {
    let gray = [[128u8; 3]; 64];
    let model = textured_square(&encode(8, 8, &gray, image::ImageFormat::Jpeg)).model();
    assert!((at(&model, 0.5, 0.5)[0] - 0.2158605).abs() < 0.01);

    let deep =
        image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(1, 1, vec![0x8080u16, 1000, 65535]).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::DynamicImage::ImageRgb16(deep).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    let color = at(&textured_square(bytes.get_ref()).model(), 0.5, 0.5);
    assert!((color[0] - 0.215_860_5).abs() < 2e-5 && color[2] == 1.0);
    assert!((f64::from(color[1]) - 1000.0 / 65535.0 / 12.92).abs() < 1e-5);
}

#[test]
fn a_palette_that_ends_within_a_colour_is_refused() {
    // The regression input of fuzzing: two by two pixels, seven bytes of palette, sound checksums.
    let bytes = include_bytes!("palette-of-part-of-an-entry.png");
    let error = textured_square(bytes).import().unwrap_err().to_string();
    assert!(error.contains("palette ends within a colour"), "{error}");
}

#[test]
fn factor_texture_and_vertex_colour_multiply() {
    let mut glb = textured_square(&png(1, 1, &[[255, 188, 255]]));
    glb.at("/materials/0/pbrMetallicRoughness")["baseColorFactor"] = json!([0.5, 0.5, 0.25, 0.1]);
    glb.at("/materials/0")["alphaMode"] = json!("BLEND");
    let colors =
        glb.floats(&[[1.0, 1.0, 0.5, 0.0], [0.0, 1.0, 0.5, 0.0], [0.0, 1.0, 0.5, 0.0], [1.0, 1.0, 0.5, 0.0]]);
    glb.at("/meshes/0/primitives/0/attributes")["COLOR_0"] = colors.into();
    let model = glb.model();
    let [r, g, b] = at(&model, 0.75, 0.5);
    let texel = (((188.0 / 255.0) + 0.055) / 1.055f64).powf(2.4);
    assert!((r - 0.125).abs() < 1e-6 && (b - 0.125).abs() < 1e-6);
    assert!((f64::from(g) - 0.5 * texel).abs() < 1e-6);
    let note = model.notes().iter().find(|n| n.object == "material 0 \"paint\"").unwrap();
    assert!(note.text.contains("opaque"));
}

#[test]
fn vertex_colours_of_every_type_are_fractions() {
    let types: [(&[u8], u32, &str); 4] = [
        (&[255, 51, 0], U8, "VEC3"),
        (&[255, 51, 0, 9], U8, "VEC4"),
        (&[255, 255, 51, 51, 0, 0], U16, "VEC3"),
        (&[255, 255, 51, 51, 0, 0, 9, 9], U16, "VEC4"),
    ];
    for (element, component, kind) in types {
        let mut glb = square();
        let colors = glb.accessor(&element.repeat(4), component, kind, 4);
        // Even where the file forgets to say so.
        glb.at("/accessors")[colors]["normalized"] = json!(element.len() % 2 == 0);
        glb.at("/meshes/0/primitives/0/attributes")["COLOR_0"] = colors.into();
        let color = glb.model().color_at(0, [0.2, 0.3, 0.5], 0.0);
        assert!((color[1] - 0.2).abs() < 1e-6 && color[0] == 1.0 && color[2] == 0.0, "{color:?}");
    }
}

#[test]
fn texture_coordinates_of_every_type_agree() {
    let expected = textured_square(&four_colors()).model();
    let bytes = |wide: bool| -> Vec<u8> {
        let one = if wide { vec![255, 255] } else { vec![255] };
        SQUARE_UV.as_flattened().iter().flat_map(|&c| one.iter().map(move |b| b * c as u8)).collect()
    };
    for (component, wide) in [(U8, false), (U16, true)] {
        let mut glb = textured_square(&four_colors());
        let uv = glb.accessor(&bytes(wide), component, "VEC2", 4);
        glb.at("/accessors")[uv]["normalized"] = json!(true);
        glb.at("/meshes/0/primitives/0/attributes")["TEXCOORD_0"] = uv.into();
        assert_eq!(glb.model(), expected);
    }
}

#[test]
fn the_material_chooses_the_coordinate_set_and_the_transform_overrides_it() {
    let mut glb = textured_square(&four_colors());
    nearest(&mut glb);
    let left = glb.floats(&[[0.25, 0.25]; 4]);
    let right = glb.floats(&[[0.75, 0.25]; 4]);
    glb.at("/meshes/0/primitives/0/attributes")["TEXCOORD_1"] = left.into();
    glb.at("/meshes/0/primitives/0/attributes")["TEXCOORD_2"] = right.into();
    let info = "/materials/0/pbrMetallicRoughness/baseColorTexture";
    glb.at(info)["texCoord"] = json!(1);
    assert_eq!(at(&glb.model(), 0.1, 0.1), RED);
    glb.at(info)["extensions"] = json!({"KHR_texture_transform": {"texCoord": 2}});
    assert_eq!(at(&glb.model(), 0.1, 0.1), GREEN);
}

#[test]
fn texture_transforms_scale_rotate_then_offset() {
    // The extension's own example: the lower left quadrant, turned a quarter.
    let mut glb = textured_square(&four_colors());
    let info = "/materials/0/pbrMetallicRoughness/baseColorTexture";
    glb.at(info)["extensions"] = json!({"KHR_texture_transform": {
        "offset": [0, 1], "rotation": std::f64::consts::FRAC_PI_2, "scale": [0.5, 0.5],
    }});
    let model = glb.model();
    for (vertex, [u, v]) in model.vertices().iter().zip(SQUARE_UV) {
        let expected = [0.5 * v, 1.0 - 0.5 * u];
        assert!((0..2).all(|i| (vertex.uv[i] - expected[i]).abs() < 1e-6), "{:?}", vertex.uv);
    }
}

#[test]
fn samplers_map_to_wrap_and_filter_modes() {
    let sampler = |json: serde_json::Value| {
        let mut glb = textured_square(&four_colors());
        glb.push("samplers", json);
        glb.at("/textures/0")["sampler"] = json!(0);
        glb.model().textures()[0].sampler()
    };
    assert_eq!(sampler(json!({})), Sampler::default());
    assert_eq!(
        sampler(json!({"wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9985})),
        Sampler {
            wrap_u: Wrap::Clamp,
            wrap_v: Wrap::Mirrored,
            magnify: Filter::Nearest,
            minify: Filter::Linear,
            mip: Mip::Nearest,
        }
    );
    assert_eq!(
        sampler(json!({"wrapS": 10497, "wrapT": 10497, "magFilter": 9729, "minFilter": 9986})),
        Sampler { minify: Filter::Nearest, ..Sampler::default() }
    );
}

#[test]
fn a_footprint_averages_the_surface_it_covers() {
    // Alternating black and white columns, 64 over a square of 1 m.
    let stripes: Vec<[u8; 3]> = (0..64 * 64).map(|i| [if i % 2 == 0 { 0 } else { 255 }; 3]).collect();
    let model = textured_square(&png(64, 64, &stripes)).model();
    let color = model.color_at(0, [0.3, 0.4, 0.3], 0.25);
    // The mean of linear light, not of sRGB values.
    assert!((color[0] - 0.5).abs() < 0.01, "{color:?}");
    let sharp = model.color_at(0, [1.0 - 0.5 / 64.0, 0.5 / 64.0, 0.0], 0.0);
    assert_eq!(sharp, [0.0; 3]);
}

#[test]
fn one_image_serves_many_materials_and_untextured_ones_stay_plain() {
    let mut glb = textured_square(&four_colors());
    let second = glb.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let plain = glb.push("materials", json!({}));
    let mut primitive = glb.at("/meshes/0/primitives/0").clone();
    primitive["material"] = second.into();
    glb.at("/meshes/0/primitives").as_array_mut().unwrap().push(primitive.clone());
    primitive["material"] = plain.into();
    primitive["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
    glb.at("/meshes/0/primitives").as_array_mut().unwrap().push(primitive);
    let model = glb.model();
    assert_eq!((model.materials().len(), model.textures().len()), (3, 1));
    assert_eq!(model.color_at(4, [1.0, 0.0, 0.0], 0.0), WHITE);
}

#[test]
fn specular_glossiness_gives_its_diffuse_colour() {
    let mut glb = square();
    let material = glb.push(
        "materials",
        json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0, 1, 0, 1]}}}),
    );
    glb.at("/meshes/0/primitives/0")["material"] = material.into();
    assert_eq!(at(&glb.model(), 0.5, 0.5), GREEN);
}

#[test]
fn harmless_extensions_are_accepted_even_when_required() {
    let mut glb = textured_square(&four_colors());
    for name in ["KHR_materials_unlit", "KHR_texture_transform", "KHR_lights_punctual"] {
        glb.push("extensionsUsed", name.into());
        glb.push("extensionsRequired", name.into());
    }
    glb.at("/materials/0")["extensions"] = json!({"KHR_materials_unlit": {}});
    nearest(&mut glb);
    assert_eq!(at(&glb.model(), 0.25, 0.25), BLUE);
}

#[test]
fn morph_targets_change_vertex_colours_by_their_default_weights() {
    let mut glb = square();
    let red = glb.floats(&[[1.0, 0.0, 0.25, 1.0]; 4]);
    let to_green = glb.floats(&[[-1.0, 1.0, 0.0, 0.0]; 4]);
    let brighter = glb.floats(&[[0.5, 0.5, 0.5]; 4]);
    let signed = glb.accessor(&[0x81, 0, 127, 0].repeat(4), I8, "VEC4", 4);
    let lift = glb.floats(&[[0.0, 0.0, 1.0]; 4]);
    glb.at("/meshes/0/primitives/0/attributes")["COLOR_0"] = red.into();
    glb.at("/meshes/0/primitives/0")["targets"] = json!([
        {"COLOR_0": to_green, "POSITION": lift}, {"COLOR_0": brighter}, {"COLOR_0": signed}
    ]);
    let with = |mesh: serde_json::Value, node: Option<serde_json::Value>| {
        let mut glb = glb.clone();
        glb.at("/meshes/0")["weights"] = mesh;
        if let Some(weights) = node {
            glb.at("/nodes/0")["weights"] = weights;
        }
        let model = glb.model();
        assert!(model.notes().is_empty(), "{:?}", model.notes());
        model.color_at(0, [0.2, 0.3, 0.5], 0.0)
    };
    let close = |found: [f32; 3], expected: [f32; 3]| {
        assert!((0..3).all(|c| (found[c] - expected[c]).abs() < 1e-6), "{found:?} is not {expected:?}");
    };
    close(with(json!([0, 0, 0]), None), [1.0, 0.0, 0.25]);
    close(with(json!([1]), None), [0.0, 1.0, 0.25]);
    close(with(json!([0.25, 0.5]), None), [1.0, 0.5, 0.5]);
    close(with(json!([0, 0, 0.5]), None), [0.5, 0.0, 0.75]);
    // The node's weights stand for the mesh's, and colours end at 0 and 1.
    close(with(json!([0, 0]), Some(json!([1, 1]))), [0.5, 1.0, 0.75]);
    close(with(json!([3, 0]), None), [0.0, 1.0, 0.25]);
}

#[test]
fn morph_targets_shift_texture_coordinates() {
    let mut glb = textured_square(&four_colors());
    nearest(&mut glb);
    let shift = glb.floats(&[[0.5, 0.0]; 4]);
    glb.at("/meshes/0/primitives/0")["targets"] = json!([{"TEXCOORD_0": shift}]);
    glb.at("/meshes/0")["weights"] = json!([1]);
    assert_eq!(at(&glb.model(), 0.25, 0.75), GREEN);
}

#[test]
fn a_morph_target_for_colours_that_are_not_there_is_noted() {
    let mut glb = square();
    let delta = glb.floats(&[[-1.0, 0.0, 0.0, 0.0]; 4]);
    glb.at("/meshes/0/primitives/0")["targets"] = json!([{"COLOR_0": delta}]);
    glb.at("/meshes/0")["weights"] = json!([1]);
    let model = glb.model();
    assert_eq!(at(&model, 0.5, 0.5), WHITE);
    assert!(model.notes().iter().any(|n| n.text.contains("COLOR_0")), "{:?}", model.notes());
}

#[test]
fn emission_that_is_left_out_is_noted() {
    for (material, noted) in [
        (json!({"emissiveFactor": [0, 0.5, 0]}), true),
        (json!({"emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 0}}), true),
        // The default factor is black.
        (json!({"emissiveTexture": {"index": 0}}), false),
        (json!({"emissiveFactor": [0, 0, 0]}), false),
        (json!({}), false),
    ] {
        let mut glb = textured_square(&four_colors());
        let material = glb.push("materials", material);
        glb.at("/meshes/0/primitives/0")["material"] = material.into();
        let model = glb.model();
        let note = model.notes().iter().find(|n| n.text.contains("emission"));
        assert_eq!(note.is_some(), noted, "{:?}", model.notes());
        assert!(note.is_none_or(|n| n.object == "material 1"));
    }
}
