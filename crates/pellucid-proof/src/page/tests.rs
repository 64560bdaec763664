use super::*;
use pellucid_voxel::{Frame, Pitch, SurfaceOptions};
use serde_json::json;
use std::io::Read;

fn block() -> (LabelGrid, Surface) {
    let frame = Frame::new([0.0; 3], Pitch::j750(), [24, 12, 36]).unwrap();
    let labels = LabelGrid::from_fn(frame, |[x, y, z]| 1 + ((x / 5 + y / 3 + z / 7) % 3) as u8);
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), &Control::none()).unwrap();
    (labels, surface)
}

fn inflated(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    flate2::read::DeflateDecoder::new(bytes).read_to_end(&mut out).unwrap();
    out
}

fn manifest() -> Value {
    json!({
        "generator": "test", "target": "j750", "pitch_mm": [0.0423, 0.0847, 0.027], "dpi": [600, 300, 940.7],
        "size": [24, 12, 36], "layers": 36, "padding_layers": 0, "files": "slices/slice_%05d.png",
        "orientation": "up </script>", "row_order": "highest_y_first", "background": [0, 0, 0, 0],
        "materials": [{ "label": 1, "name": "white", "rgba": [255, 255, 255, 255], "voxels": 10368 }],
    })
}

fn page(size: PageSize) -> ProofPage {
    let (labels, surface) = block();
    let colors: Vec<[f32; 3]> = surface.normals().iter().map(|n| n.map(|v| 0.5 + 0.4 * v)).collect();
    let values: Vec<f32> = surface.voxels().iter().map(|v| v[2] as f32).collect();
    let fields = [
        PageField { key: "refined", label: "Refined", under: None, values: FieldValues::Colors(&colors) },
        PageField {
            key: "error",
            label: "Error",
            under: None,
            values: FieldValues::Quantity { values: &values, most: 51.0, shown: 20.0, unit: "dE2000" },
        },
    ];
    ProofPage::new(&labels, &surface, &fields, true, size, &Control::none()).unwrap()
}

fn packed(page: &ProofPage) -> &PackedSlices {
    page.slices.as_ref().unwrap()
}

#[test]
fn slices_are_those_of_the_images() {
    let (labels, _) = block();
    let page = page(PageSize::default());
    assert_eq!(packed(&page).index_json()["every"], 1);
    let ends = packed(&page).index_json()["ends"].as_array().unwrap().clone();
    assert_eq!(ends.len(), 36);
    let [from, to] = [4, 5].map(|i| ends[i].as_u64().unwrap() as usize);
    let image = inflated(&packed(&page).bytes[from..to]);
    for (row, pixels) in image.chunks(24).enumerate() {
        for (x, &label) in pixels.iter().enumerate() {
            assert_eq!(label, labels.get([x as u32, 11 - row as u32, 5]), "the top row is the highest y");
        }
    }
}

#[test]
fn a_page_of_little_room_holds_fewer_slices_and_vertices() {
    let all = page(PageSize::default());
    let small = page(PageSize { most_vertices: 200, most_slice_bytes: packed(&all).bytes.len() as u64 / 3 });
    let every = packed(&small).index_json()["every"].as_u64().unwrap();
    assert!((3..=5).contains(&every), "{every}");
    assert!(packed(&small).bytes.len() < packed(&all).bytes.len() / 2);
    assert!(small.surface.bytes.len() < all.surface.bytes.len() / 2);
    let text = small.render("small", &Value::Null, &manifest()).unwrap();
    assert!(text.len() < all.render("small", &Value::Null, &manifest()).unwrap().len());
}

#[test]
fn fields_come_back_from_the_bytes() {
    let (labels, surface) = block();
    let size = PageSize::default();
    let page = page(size);
    let mesh = SurfaceMesh::build(&labels, &surface, size.most_vertices, &Control::none()).unwrap();
    let heights: Vec<[f32; 1]> = surface.voxels().iter().map(|v| [v[2] as f32]).collect();
    let means = mesh.means(&heights).unwrap();
    let bytes = inflated(&page.surface.bytes);
    let last = &bytes[bytes.len() - means.len()..];
    let mut value = 0u8;
    for (step, [mean]) in last.iter().zip(&means) {
        value = value.wrapping_add(*step);
        assert!((f32::from(value) * 51.0 / 255.0 - mean).abs() <= 0.1001, "{value} {mean}");
    }
}

#[test]
fn nothing_of_the_data_can_end_the_script_or_ask_for_more() {
    let report = json!({ "record": { "model": { "name": "a<b", "digest": "0", "notes": ["</script><img src=x>"] },
        "settings": { "seed": 1, "strategy": "descent" }, "predictor": { "name": "mc" } } });
    let html = page(PageSize::default()).render("a & <b>", &report, &manifest()).unwrap();
    assert_eq!(html.matches("</script").count(), 6, "as many as the template has");
    assert!(!html.contains("<img"));
    assert!(html.contains("a &amp; &lt;b&gt;") && html.contains("default-src 'none'"));
    for word in ["http://", "https://", "@import", "url("] {
        let namespace =
            if word == "http://" { html.matches("http://www.w3.org/2000/svg").count() } else { 0 };
        assert_eq!(html.matches(word).count(), namespace, "{word}");
    }
}

#[test]
fn a_report_without_a_needed_figure_is_refused() {
    let report = json!({ "thin": { "below_1_mm": 0.5 } });
    let error = page(PageSize::default()).render("a", &report, &manifest()).unwrap_err();
    assert!(error.to_string().contains("report.thin.below_2_mm"), "{error}");
}
