use super::*;
use crate::bake::BakeOptions;
use crate::shapes::Shape;
use crate::{PlacedMesh, Scale, import_path};
use pellucid_voxel::Control;

/// A cube of 8 mm whose texture tells places, in every format, and read again.
#[test]
fn what_is_written_is_read_back_as_the_same_mesh() {
    let model = Shape::cuboid([0.0; 3], [8.0, 6.0, 4.0]).colored(|_| [1.0; 3]);
    let placed = PlacedMesh::new(&model, Scale::Native).unwrap();
    let color = |at: &crate::bake::SurfacePoint| at.position_mm.map(|v| (0.1 + 0.1 * v) as f32);
    let baked = placed.bake(&BakeOptions { texel_mm: 0.1, max_edge: 1024 }, color, &Control::none()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for format in MeshFormat::ALL.into_iter().filter(|f| f.is_available()) {
        write(&baked, format, folder.path(), "cube").unwrap();
        for file in format.files("cube") {
            assert!(folder.path().join(file).is_file());
        }
        let back = import_path(folder.path().join(&format.files("cube")[0]), &crate::ImportLimits::default());
        let back = back.unwrap_or_else(|e| panic!("{format:?}: {e}"));
        assert_eq!(back.triangles().len(), 12, "{format:?}");
        let [low, high] = back.bounds_m();
        for (a, edge) in [0.008, 0.006, 0.004].into_iter().enumerate() {
            assert!((high[a] - low[a] - edge).abs() < 1e-7, "{format:?}: {low:?} {high:?}");
        }
        for t in 0..12 {
            let corners = back.corners_m(t);
            for weights in [[1.0 / 3.0; 3], [0.8, 0.1, 0.1], [0.1, 0.1, 0.8]] {
                let at: [f64; 3] =
                    std::array::from_fn(|a| (0..3).map(|k| weights[k] * (corners[k][a] - low[a])).sum());
                let shown = back.color_at(t, weights, 0.0);
                for c in 0..3 {
                    let wanted = 0.1 + 0.1 * 1000.0 * at[c];
                    assert!((f64::from(shown[c]) - wanted).abs() < 0.02, "{format:?} {at:?}: {shown:?}");
                }
            }
        }
    }
}
