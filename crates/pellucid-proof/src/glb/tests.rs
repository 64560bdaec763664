use super::*;
use pellucid_voxel::{Frame, Pitch, SurfaceOptions};

fn block(size: [u32; 3]) -> (LabelGrid, Surface) {
    let frame = Frame::new([1.0, 2.0, 3.0], Pitch::j750(), size).unwrap();
    let labels = LabelGrid::from_fn(frame, |_| 1);
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none()).unwrap();
    (labels, surface)
}

fn json_of(glb: &Glb) -> Value {
    let length = u32::from_le_bytes(glb.bytes()[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb.bytes()[20..20 + length]).unwrap()
}

#[test]
fn a_block_has_its_size_in_metres_and_a_variant_for_each_look() {
    let (labels, surface) = block([24, 12, 36]);
    let colors = vec![[0.5, 0.25, 0.125]; surface.len()];
    let looks = ["refined", "target", "unrefined"].map(|name| Look { name, colors: &colors });
    let glb = Glb::of(&labels, &surface, &looks, &Control::none()).unwrap();
    let json = json_of(&glb);
    let extent = [24.0 * 25.4 / 600.0, 36.0 * 0.027, 12.0 * 25.4 / 300.0].map(|mm: f64| mm / 1000.0);
    let low = [1.0, 3.0, -2.0 - 12.0 * 25.4 / 300.0].map(|mm: f64| mm / 1000.0);
    let accessor = &json["accessors"][0];
    for a in 0..3 {
        let [min, max] = ["min", "max"].map(|end| accessor[end][a].as_f64().unwrap());
        assert!(
            (max - min - extent[a]).abs() < 0.09e-3 && (min - low[a]).abs() < 0.09e-3,
            "{a}: {min} {max}"
        );
    }
    let variants = json["extensions"]["KHR_materials_variants"]["variants"].as_array().unwrap();
    let names: Vec<&str> = variants.iter().map(|v| v["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["refined", "target", "unrefined"]);
    assert_eq!(json["materials"].as_array().unwrap().len(), 3);
    assert_eq!(json["meshes"][0]["primitives"][0]["material"], 0);
    let total = u32::from_le_bytes(glb.bytes()[8..12].try_into().unwrap()) as usize;
    assert_eq!(total, glb.bytes().len());
    assert!(glb.quads() > 1000 && glb.cell_mm() == labels.frame().pitch().mm());
}

#[test]
fn quads_have_the_colour_of_their_place() {
    let (labels, surface) = block([24, 12, 36]);
    let colors: Vec<[f32; 3]> =
        surface.voxels().iter().map(|v| [if v[0] < 12 { 0.0 } else { 1.0 }; 3]).collect();
    let mesh = SurfaceMesh::build(&labels, &surface, 100_000, &Control::none()).unwrap();
    let edge = (mesh.quads().len() as f64).sqrt().ceil() as usize;
    let texels = texels(&mesh, &Look { name: "a", colors: &colors }, edge).unwrap();
    for (quad, texel) in mesh.quads().iter().zip(&texels) {
        let x = quad.iter().map(|&v| mesh.positions_mm()[v as usize][0]).sum::<f32>() / 4.0;
        let middle = 1.0 + 12.0 * 25.4 / 600.0;
        let wanted = if x < middle { 0 } else { 255 };
        assert!(texel[0] == wanted || (x - middle).abs() < 0.07, "{x}: {texel:?}");
    }
}

#[test]
fn a_large_surface_stays_below_the_limit() {
    let (labels, surface) = block([520, 260, 700]);
    let colors: Vec<[f32; 3]> = (0..surface.len() as u32)
        .map(|i| {
            [7, 13, 29].map(|k| (i.wrapping_mul(k).wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0)
        })
        .collect();
    let looks = ["a", "b", "c"].map(|name| Look { name, colors: &colors });
    let glb = Glb::of(&labels, &surface, &looks, &Control::none()).unwrap();
    let share = glb.bytes().len() as f64 / GLB_LIMIT as f64;
    assert!((0.5..1.0).contains(&share), "{share} of the limit, {} quads", glb.quads());
    assert!(Glb::of(&labels, &surface, &[], &Control::none()).is_err());
    let short = [Look { name: "a", colors: &colors[1..] }];
    assert!(matches!(Glb::of(&labels, &surface, &short, &Control::none()), Err(ProofError::Invalid(_))));
}
