//! The checked model and its filtered colour.

use std::sync::Arc;

use pellucid_mesh::{BaseColor, Image, MeshError, Model, Sampler, Texture, Triangle, Vertex};

fn vertex(position_m: [f64; 3], uv: [f32; 2]) -> Vertex {
    Vertex { position_m, uv, color: [1.0; 4] }
}

fn corner_vertices() -> Vec<Vertex> {
    vec![
        vertex([0.0, 0.0, 0.0], [0.0, 0.0]),
        vertex([1.0, 0.0, 0.0], [1.0, 0.0]),
        vertex([0.0, 0.0, 1.0], [0.0, 1.0]),
    ]
}

fn plain(texture: Option<u32>) -> Vec<BaseColor> {
    vec![BaseColor { name: "paint".into(), factor: [1.0; 4], texture, double_sided: false }]
}

const FACE: Triangle = Triangle { vertices: [0, 1, 2], material: 0 };

#[test]
fn parts_that_do_not_fit_are_refused() {
    let build = |vertices, triangles, materials| Model::new("m", vertices, triangles, materials, vec![]);
    assert!(build(corner_vertices(), vec![FACE], plain(None)).is_ok());
    let refused = |vertices, triangles, materials, object: &str| match build(vertices, triangles, materials) {
        Err(MeshError::Invalid { file, object: found, .. }) => {
            assert_eq!((file.as_str(), found.as_str()), ("m", object))
        }
        other => panic!("{other:?}"),
    };
    refused(corner_vertices(), vec![], plain(None), "model");
    let outside = Triangle { vertices: [0, 1, 3], material: 0 };
    refused(corner_vertices(), vec![FACE, outside], plain(None), "triangle 1");
    refused(corner_vertices(), vec![Triangle { material: 1, ..FACE }], plain(None), "triangle 0");
    refused(corner_vertices(), vec![FACE], plain(Some(0)), "material 0");
    let mut vertices = corner_vertices();
    vertices[1].position_m[2] = f64::NAN;
    refused(vertices, vec![FACE], plain(None), "vertex 1");
    let mut vertices = corner_vertices();
    vertices[2].uv[0] = f32::INFINITY;
    refused(vertices, vec![FACE], plain(None), "vertex 2");
    let mut vertices = corner_vertices();
    vertices[0].position_m[0] = -2e9;
    let far = build(vertices, vec![FACE], plain(None));
    assert!(matches!(far, Err(MeshError::Unsupported { .. })), "{far:?}");
}

/// A smooth pattern whose finest waves are a few texels long.
fn waves(size: u32) -> Arc<Image> {
    let texel = |i: u32| {
        let (x, y) = (f64::from(i % size), f64::from(i / size));
        let value = 0.5 + 0.25 * (x * 0.9).sin() + 0.25 * (y * 0.35 + x * 0.1).cos();
        [(value * 65535.0) as u16; 3]
    };
    Arc::new(Image::from_linear16(size, size, (0..size * size).map(texel).collect()).unwrap())
}

#[test]
fn colour_is_the_mean_over_the_footprint_of_a_stretched_texture() {
    // One metre is 4 images along x and half an image along z, sheared.
    let mut vertices = corner_vertices();
    (vertices[1].uv, vertices[2].uv) = ([4.0, 0.3], [1.0, 0.5]);
    let texture = Texture::new(waves(64), Sampler::default());
    let model = Model::new("m", vertices, vec![FACE], plain(Some(0)), vec![texture]).unwrap();
    let at = |x: f64, z: f64, footprint: f64| f64::from(model.color_at(0, [1.0 - x - z, x, z], footprint)[0]);
    let (mut worst, mut unfiltered) = (0.0f64, 0.0f64);
    for footprint in [0.01, 0.03, 0.1, 0.3] {
        for k in 0..50 {
            let (x, z) = (0.3 + f64::from(k % 7) * 0.031, 0.3 + f64::from(k) * 0.003);
            let mut mean = 0.0;
            for i in 0..1600 {
                let offset = |n: i32| (f64::from(n) + 0.5) / 40.0 - 0.5;
                mean += at(x + footprint * offset(i % 40), z + footprint * offset(i / 40), 0.0) / 1600.0;
            }
            worst = worst.max((at(x, z, footprint) - mean).abs());
            unfiltered = unfiltered.max((at(x, z, 0.0) - mean).abs());
        }
    }
    // Mip levels are boxes on a grid, so some error is left; without them it is ten times larger.
    assert!(worst < 0.03 && unfiltered > 10.0 * worst, "{worst} filtered, {unfiltered} not");
}

#[test]
fn a_triangle_without_area_still_has_a_colour() {
    let mut vertices = corner_vertices();
    vertices[2].position_m = [2.0, 0.0, 0.0];
    let texture = Texture::new(waves(8), Sampler::default());
    let model = Model::new("m", vertices, vec![FACE], plain(Some(0)), vec![texture]).unwrap();
    let color = model.color_at(0, [0.2, 0.3, 0.5], 0.1);
    assert!(color.iter().all(|c| (0.0..=1.0).contains(c)));
}
