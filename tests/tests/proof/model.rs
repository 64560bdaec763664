//! `proof.glb` read back by the importer.

use pellucid::mesh::{ImportLimits, import_path};

use crate::PRINT;

#[test]
fn the_model_reads_back_with_size_and_colours() {
    let model = import_path(PRINT.file("proof.glb"), &ImportLimits::default()).unwrap();
    assert!(model.notes().is_empty(), "{:?}", model.notes());
    let [low, high] = model.bounds_m();
    let extent = &PRINT.json("report.json")["extent_mm"];
    // A voxel is 0.085 mm at most.
    for axis in 0..3 {
        let (mm, wanted) = (1000.0 * (high[axis] - low[axis]), extent[axis].as_f64().unwrap());
        assert!((mm - wanted).abs() < 0.1, "{axis}: {mm} mm, the print is {wanted}");
    }
    // What is seen without choosing a variant is the refined appearance.
    let (aimed, refined) = (&PRINT.prepared.aimed, &PRINT.prepared.judged.appearance[1]);
    let surface = aimed.object.surface();
    let mut off = Vec::new();
    for triangle in (0..model.triangles().len() as u32).step_by(97) {
        let corners = model.corners_m(triangle);
        let place: [f64; 3] =
            std::array::from_fn(|a| 1000.0 * corners.iter().map(|c| c[a]).sum::<f64>() / 3.0);
        let distance = |p: &usize| {
            let mm = surface.position_mm(*p as u32);
            (0..3).map(|a| (mm[a] - place[a]).powi(2)).sum::<f64>()
        };
        let near: Vec<usize> = (0..surface.len()).filter(|p| distance(p) < 0.12f64.powi(2)).collect();
        let shown = model.color_at(triangle, [1.0 / 3.0; 3], 0.0);
        for c in 0..3 {
            let values = near.iter().map(|&p| refined[p][c].clamp(0.0, 1.0));
            let [least, most] = values.fold([1.0f32, 0.0], |[low, high], v| [low.min(v), high.max(v)]);
            off.push((least - shown[c]).max(shown[c] - most).max(0.0));
        }
    }
    assert!(off.len() > 100 && off.iter().all(|&v| v < 0.01), "{off:?}");
    let names: Vec<&str> = model.materials().iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["refined"], "variants are other programs' business");
}
