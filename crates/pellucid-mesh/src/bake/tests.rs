use pellucid_voxel::Control;

use super::*;
use crate::shapes::Shape;
use crate::{BaseColor, Image, Model, Sampler, Scale, Texture, Triangle, Vertex};

/// A colour that tells where on the print a point lies.
fn place(at: &SurfacePoint) -> [f32; 3] {
    at.position_mm.map(|v| (0.1 + 0.08 * v) as f32)
}

fn decode(code: u8) -> f64 {
    crate::texture::srgb_to_linear(f64::from(code) / 255.0)
}

/// Every point of the surface must show its own colour, read as a renderer reads the texture.
fn check(baked: &TexturedMesh, tolerance: f64) {
    let [width, height] = baked.size;
    let texel = |x: f64, y: f64| {
        let at = |v: f64, edge: u32| v.clamp(0.0, f64::from(edge) - 1.0) as usize;
        baked.texels[at(y, height) * width as usize + at(x, width)].map(decode)
    };
    for (triangle, uv) in baked.triangles.iter().zip(&baked.uv) {
        for weights in
            [[0.98, 0.01, 0.01], [0.01, 0.98, 0.01], [0.01, 0.01, 0.98], [1.0 / 3.0; 3], [0.5, 0.5, 0.0]]
        {
            let blend = |f: &dyn Fn(usize) -> f64| (0..3).map(|k| weights[k] * f(k)).sum::<f64>();
            let (u, v) = (
                blend(&|k| uv[k][0]) * f64::from(width) - 0.5,
                blend(&|k| uv[k][1]) * f64::from(height) - 0.5,
            );
            let (x, y) = (u.floor(), v.floor());
            let (fx, fy) = (u - x, v - y);
            for c in 0..3 {
                let corner = |dx: f64, dy: f64| texel(x + dx, y + dy)[c];
                let shown = (1.0 - fy) * ((1.0 - fx) * corner(0.0, 0.0) + fx * corner(1.0, 0.0))
                    + fy * ((1.0 - fx) * corner(0.0, 1.0) + fx * corner(1.0, 1.0));
                let position = blend(&|k| baked.positions_mm[triangle[k] as usize][c]);
                let wanted = 0.1 + 0.08 * position;
                assert!((shown - wanted).abs() < tolerance, "{shown} {wanted} at {weights:?}");
            }
        }
    }
}

fn placed_sphere() -> Model {
    Shape::sphere([0.0; 3], 5.0, 3).colored(|_| [1.0; 3])
}

#[test]
fn a_new_atlas_shows_every_place_its_own_colour() {
    let model = placed_sphere();
    let placed = PlacedMesh::new(&model, Scale::HeightMm(10.0)).unwrap();
    let baked = placed.bake(&BakeOptions::default(), place, &Control::none()).unwrap();
    assert!(!baked.own_uv_map);
    // Half a texel, and half a code.
    check(&baked, 0.08 * 0.08 + 0.005);
    let again = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(
        again.install(|| placed.bake(&BakeOptions::default(), place, &Control::none())).unwrap(),
        baked
    );
}

#[test]
fn coarser_texels_are_taken_where_fine_ones_do_not_fit() {
    let model = placed_sphere();
    let placed = PlacedMesh::new(&model, Scale::HeightMm(10.0)).unwrap();
    let options = BakeOptions { texel_mm: 0.05, max_edge: 256 };
    let baked = placed.bake(&options, place, &Control::none()).unwrap();
    assert!(baked.size.iter().all(|edge| *edge <= 256), "{:?}", baked.size);
    check(&baked, 0.08 * 0.8 + 0.005);
    let tiny = BakeOptions { texel_mm: 0.05, max_edge: 16 };
    let error = placed.bake(&tiny, place, &Control::none()).unwrap_err().to_string();
    assert!(error.contains("do not fit"), "{error}");
    for bad in [BakeOptions { texel_mm: 0.0, max_edge: 256 }, BakeOptions { texel_mm: 0.1, max_edge: 4 }] {
        assert!(matches!(placed.bake(&bad, place, &Control::none()), Err(MeshError::Invalid { .. })));
    }
    let stop = std::sync::atomic::AtomicBool::new(true);
    let control = Control::none().with_cancel(&stop);
    assert!(matches!(placed.bake(&options, place, &control), Err(MeshError::Cancelled)));
}

/// Two squares of 10 mm, one above the other, with UV maps of their own.
fn squares(maps: [[[f32; 2]; 4]; 2]) -> Model {
    let mut vertices = Vec::new();
    for (z, map) in [0.0, 0.005].into_iter().zip(maps) {
        for ([x, y], uv) in [[0.0, 0.0], [0.01, 0.0], [0.01, 0.01], [0.0, 0.01]].into_iter().zip(map) {
            vertices.push(Vertex { position_m: [x, y, z], uv, color: [1.0; 4] });
        }
    }
    let corners = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let triangles = corners.map(|vertices| Triangle { vertices, material: 0 }).to_vec();
    let image = Image::from_srgb8(40, 20, vec![[255; 3]; 800]).unwrap();
    let texture = Texture::new(std::sync::Arc::new(image), Sampler::default());
    let material = BaseColor { name: String::new(), factor: [1.0; 4], texture: Some(0), double_sided: true };
    Model::new("squares", vertices, triangles, vec![material], vec![texture]).unwrap()
}

const LEFT: [[f32; 2]; 4] = [[0.05, 0.1], [0.45, 0.1], [0.45, 0.9], [0.05, 0.9]];
const RIGHT: [[f32; 2]; 4] = [[0.55, 0.1], [0.95, 0.1], [0.95, 0.9], [0.55, 0.9]];

#[test]
fn an_own_uv_map_is_kept_where_texels_lie_on_one_place() {
    let moved = |map: [[f32; 2]; 4], by: f32| map.map(|[u, v]| [u + by, v]);
    let mirrored = [LEFT[1], LEFT[0], LEFT[3], LEFT[2]];
    for (maps, kept) in [
        ([LEFT, RIGHT], true),
        ([LEFT, LEFT], false),
        ([LEFT, mirrored], false),
        ([LEFT, moved(RIGHT, -0.3)], false),
        ([LEFT, moved(RIGHT, 0.2)], false),
        ([LEFT, [[0.7, 0.5]; 4]], false),
    ] {
        let model = squares(maps);
        let placed = PlacedMesh::new(&model, Scale::Native).unwrap();
        let baked =
            placed.bake(&BakeOptions { texel_mm: 0.1, max_edge: 1024 }, place, &Control::none()).unwrap();
        assert_eq!(baked.own_uv_map, kept, "{maps:?}");
        if kept {
            // 100 mm² in 0.32 of the image, 0.1 mm a texel.
            assert!((baked.size[0] as f64 / 250.0 - 1.0).abs() < 0.05, "{:?}", baked.size);
            assert_eq!(baked.size[0], 2 * baked.size[1]);
            assert!((baked.uv[0][1][0] - 0.45).abs() < 1e-6);
        }
        check(&baked, 0.08 * 0.1 + 0.005);
    }
}
