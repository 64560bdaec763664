//! Buffer views that meshopt compressed.

use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{self, IndexEncoding, VertexEncoding};
use pellucid_mesh::{ImportLimits, MeshError, Model, import_slice};
use proptest::prelude::*;
use serde_json::json;

use crate::glb::*;

/// A grid of 8 x 8 vertices, uncompressed.
fn grid() -> Glb {
    let mut glb = Glb::new();
    let at = |i: u32| [(i % 8) as f32 * 0.25, (i / 8) as f32 * 0.5, ((i * 7) % 5) as f32 * 0.125];
    let position = glb.floats(&(0..64).map(at).collect::<Vec<_>>());
    let quads = (0..56u32).filter(|i| i % 8 < 7).flat_map(|i| [i, i + 1, i + 9, i, i + 9, i + 8]);
    let indices = glb.indices(&quads.collect::<Vec<_>>());
    glb.mesh(json!({"attributes": {"POSITION": position}, "indices": indices}));
    glb
}

fn bytes_of(glb: &Glb, view: usize) -> Vec<u8> {
    let field = |name: &str| glb.json["bufferViews"][view][name].as_u64().unwrap_or(0) as usize;
    glb.bin[field("byteOffset")..][..field("byteLength")].to_vec()
}

/// Replaces a view's bytes by compressed ones at the end of the buffer; the parent then stands for nothing.
fn compress(glb: &mut Glb, view: usize, name: &str, mode: &str, stride: usize, compressed: &[u8]) {
    let length = bytes_of(glb, view).len();
    glb.bin.resize(glb.bin.len().next_multiple_of(4), 0);
    let extension = json!({
        "buffer": 0, "byteOffset": glb.bin.len(), "byteLength": compressed.len(),
        "byteStride": stride, "count": length / stride, "mode": mode
    });
    glb.bin.extend_from_slice(compressed);
    let view = &mut glb.at("/bufferViews")[view];
    // Where the fallback lies that a file without the extension would have.
    view["buffer"] = 1.into();
    view["byteOffset"] = 0.into();
    view["extensions"] = json!({name: extension});
    glb.push("extensionsRequired", name.into());
    let length = glb.bin.len();
    glb.json["buffers"] = json!([{"byteLength": length}, {"byteLength": 1 << 16}]);
}

fn compressed(name: &str, mode: &str, version: u8) -> Glb {
    let mut glb = grid();
    let mut workspace = Workspace::default();
    let (positions, indices) = (bytes_of(&glb, 0), bytes_of(&glb, 1));
    let indices: Vec<u32> = indices.as_chunks::<4>().0.iter().map(|b| u32::from_le_bytes(*b)).collect();
    let vertices = VertexEncoding::new(version, 2).unwrap();
    let positions = codec::encode_vertex_buffer(&positions, 64, 12, vertices, &mut workspace).unwrap();
    let order = IndexEncoding::DEFAULT;
    let indices = match mode {
        "TRIANGLES" => codec::encode_index_buffer(&indices, order, &mut workspace),
        _ => codec::encode_index_sequence(&indices, order, &mut workspace),
    };
    compress(&mut glb, 0, name, "ATTRIBUTES", 12, &positions);
    compress(&mut glb, 1, name, mode, 4, &indices.unwrap());
    glb
}

/// Triangles by their corners, each begun at its least.
fn triangles(model: &Model) -> Vec<[[u64; 3]; 3]> {
    let mut all: Vec<_> = (0..model.triangles().len() as u32)
        .map(|t| {
            let mut corners = model.corners_m(t).map(|p| p.map(f64::to_bits));
            let least = (0..3).min_by_key(|&k| corners[k]).unwrap();
            corners.rotate_left(least);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

#[test]
fn compressed_buffers_give_the_same_mesh() {
    let expected = triangles(&grid().model());
    assert_eq!(expected.len(), 98);
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        for mode in ["TRIANGLES", "INDICES"] {
            for version in [0, 1] {
                let glb = compressed(name, mode, version);
                assert_eq!(triangles(&glb.model()), expected, "{name} {mode} {version}");
            }
        }
    }
}

#[test]
fn filters_are_undone() {
    let (plain, mut glb) = (grid(), grid());
    let positions: Vec<f32> =
        bytes_of(&plain, 0).as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let mut workspace = Workspace::default();
    // Multiples of 1/8 are exact in 12 bits.
    let mode = codec::ExpMode::SharedVector;
    let filtered = codec::encode_filter_exp(64, 12, 12, &positions, mode, &mut workspace).unwrap();
    let encoded =
        codec::encode_vertex_buffer(&filtered, 64, 12, VertexEncoding::new(0, 2).unwrap(), &mut workspace);
    compress(&mut glb, 0, "EXT_meshopt_compression", "ATTRIBUTES", 12, &encoded.unwrap());
    let without = glb.import().ok().map(|model| triangles(&model));
    glb.at("/bufferViews")[0]["extensions"]["EXT_meshopt_compression"]["filter"] = "EXPONENTIAL".into();
    assert_eq!(triangles(&glb.model()), triangles(&plain.model()));
    assert_ne!(without, Some(triangles(&plain.model())));
}

#[test]
fn what_cannot_be_decompressed_is_refused_by_name() {
    let refused = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut glb = compressed("EXT_meshopt_compression", "TRIANGLES", 0);
        change(&mut glb.at("/bufferViews")[0]["extensions"]["EXT_meshopt_compression"]);
        glb.import().unwrap_err()
    };
    for (field, value) in [("filter", json!("SPHERICAL")), ("mode", json!("STRIPS"))] {
        let error = refused(&|e| e[field] = value.clone());
        assert!(matches!(error, MeshError::Unsupported { .. }), "{error}");
        assert!(error.to_string().contains("buffer view 0") && error.to_string().contains(field), "{error}");
    }
    for (field, value) in [("count", 63), ("byteStride", 16), ("byteLength", 20), ("byteOffset", 1 << 30)] {
        let error = refused(&|e| e[field] = value.into());
        assert!(matches!(error, MeshError::Invalid { .. }), "{field}: {error}");
        assert!(error.to_string().contains("buffer view 0"), "{error}");
    }
    // What the header claims is weighed before it is allocated.
    let mut glb = compressed("EXT_meshopt_compression", "TRIANGLES", 0);
    let claimed = 1u64 << 40;
    glb.at("/bufferViews")[0]["byteLength"] = (12 * claimed).into();
    glb.at("/bufferViews")[0]["extensions"]["EXT_meshopt_compression"]["count"] = claimed.into();
    let error = glb.import().unwrap_err();
    assert!(matches!(error, MeshError::Unsupported { .. }), "{error}");
    assert!(error.to_string().contains("ImportLimits::file_bytes"), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
    #[test]
    fn damaged_compression_does_not_panic(
        at in any::<prop::sample::Index>(),
        byte in any::<u8>(),
        indices in any::<bool>(),
        version in 0..2u8,
    ) {
        use std::sync::LazyLock;
        static SEEDS: LazyLock<[Glb; 2]> = LazyLock::new(|| [0, 1].map(|v| compressed("KHR_meshopt_compression", "TRIANGLES", v)));
        let mut glb = SEEDS[usize::from(version)].clone();
        let view = usize::from(indices);
        let field = |name: &str| {
            glb.json["bufferViews"][view]["extensions"]["KHR_meshopt_compression"][name].as_u64().unwrap() as usize
        };
        let (start, length) = (field("byteOffset"), field("byteLength"));
        glb.bin[start + at.index(length)] = byte;
        if let Ok(model) = import_slice("mutant", &glb.bytes(), None, &ImportLimits::default()) {
            prop_assert!(model.bounds_m().as_flattened().iter().all(|c| c.is_finite()));
        }
    }
}
