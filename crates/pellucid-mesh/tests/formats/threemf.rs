//! 3MF alone.

use pellucid_mesh::{ImportLimits, LengthUnit, Model};

use crate::refused::Kind::{Invalid, Unsupported};
use crate::refused::*;
use crate::scene::*;

/// A triangle of 10 units as an object.
fn triangle(id: u32, attributes: &str, of_triangle: &str) -> String {
    format!(
        "<object id=\"{id}\" {attributes}><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/>\
        <vertex x=\"10\" y=\"0\" z=\"0\"/><vertex x=\"0\" y=\"10\" z=\"0\"/></vertices>\
        <triangles><triangle v1=\"0\" v2=\"1\" v3=\"2\" {of_triangle}/></triangles></mesh></object>"
    )
}

fn model(resources: &str, build: &str) -> String {
    format!("{MODEL}><resources>{resources}</resources><build>{build}</build></model>")
}

fn read(xml: &str) -> Result<Model, pellucid_mesh::MeshError> {
    import("a.3mf", &package(xml, &[("3D/Texture/skin.png", &picture())]), None)
}

/// Corners in millimetres, rounded.
fn corners(model: &Model) -> Vec<[f64; 3]> {
    let all = (0..model.triangles().len() as u32).flat_map(|t| model.corners_m(t));
    all.map(|p| p.map(|c| (c * 1e6).round() / 1e3)).collect()
}

#[test]
fn items_and_components_are_placed() {
    let resources = triangle(1, "", "")
        + "<object id=\"2\"><components><component objectid=\"1\" transform=\"1 0 0 0 1 0 0 0 1 0 0 5\"/>\
           <component objectid=\"1\" transform=\"-1 0 0 0 1 0 0 0 1 0 0 0\"/></components></object>";
    // Turned by a quarter about z, after the component's own transform.
    let build = "<item objectid=\"2\" transform=\"0 1 0 -1 0 0 0 0 1 100 0 0\"/><item objectid=\"1\"/>";
    let found = corners(&read(&model(&resources, build)).unwrap());
    assert_eq!(found[..3], [[100.0, 0.0, 5.0], [100.0, 10.0, 5.0], [90.0, 0.0, 5.0]]);
    // What is mirrored keeps its outside.
    assert_eq!(found[3..6], [[100.0, 0.0, 0.0], [90.0, 0.0, 0.0], [100.0, -10.0, 0.0]]);
    assert_eq!(found[6..], [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]]);
}

#[test]
fn the_package_says_the_unit() {
    for (name, unit) in [
        ("micron", LengthUnit::Micrometre),
        ("millimeter", LengthUnit::Millimetre),
        ("centimeter", LengthUnit::Centimetre),
        ("inch", LengthUnit::Inch),
        ("foot", LengthUnit::Foot),
        ("meter", LengthUnit::Metre),
    ] {
        let xml = model(&triangle(1, "", ""), "<item objectid=\"1\"/>").replace("millimeter", name);
        let found = read(&xml).unwrap();
        assert_eq!(found.read_as().unwrap().unit, unit);
        assert!((found.corners_m(0)[1][0] - 10.0 * unit.metres()).abs() < 1e-12);
    }
    let xml = model(&triangle(1, "", ""), "<item objectid=\"1\"/>");
    let plain = read(&xml.replace("unit=\"millimeter\"", "")).unwrap();
    assert_eq!(plain.read_as().unwrap().unit, LengthUnit::Millimetre);
    refused(read(&xml.replace("millimeter", "mile")), Invalid, "3D/thing.model", "\"mile\"");
}

#[test]
fn models_in_other_parts() {
    let object = triangle(7, "", "");
    let other = format!("{MODEL}><resources>{object}</resources></model>");
    let root = |path: &str| {
        let component =
            format!("<component p:path=\"{path}\" objectid=\"7\" transform=\"1 0 0 0 1 0 0 0 1 0 0 2\"/>");
        model(
            &format!("<object id=\"1\"><components>{component}</components></object>"),
            &format!("<item objectid=\"1\"/><item p:path=\"{path}\" objectid=\"7\"/>"),
        )
        .replace("<model", "<model requiredextensions=\"p m\"")
    };
    let read = |path: &str| {
        import("a.3mf", &package(&root(path), &[("3D/Objects/my object.model", other.as_bytes())]), None)
    };
    for path in ["/3D/Objects/my object.model", "/3d/objects/MY%20object.model"] {
        let found = corners(&read(path).unwrap());
        assert_eq!((found.len(), found[0], found[3]), (6, [0.0, 0.0, 2.0], [0.0; 3]));
    }
    refused(read("/3D/Objects/gone.model"), Invalid, "part \"/3D/Objects/gone.model\"", "does not hold");
    refused(read("/3D/../x.model"), Invalid, "build", "leaves the package");
}

#[test]
fn properties_of_every_kind() {
    let color = |resources: &str, object: &str, of_triangle: &str| {
        let xml =
            model(&(resources.to_owned() + &triangle(50, object, of_triangle)), "<item objectid=\"50\"/>");
        let model = read(&xml).unwrap_or_else(|e| panic!("{e}"));
        (
            [0, 1, 2].map(|k| model.color_at(0, std::array::from_fn(|i| f64::from(u8::from(i == k))), 0.0)),
            model,
        )
    };
    const RED: [f32; 3] = [1.0, 0.0, 0.0];
    const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
    let base = "<basematerials id=\"1\"><base name=\"a\" displaycolor=\"#FF0000\"/>\
        <base name=\"b\" displaycolor=\"#00FF00FF\"/></basematerials>";
    let group = "<m:colorgroup id=\"2\"><m:color color=\"#FF0000\"/><m:color color=\"#00ff0080\"/>\
        <m:color color=\"#0000FF\"/></m:colorgroup>";
    let texture = "<m:texture2d id=\"3\" path=\"/3D/Texture/skin.png\" contenttype=\"image/png\" tilestyleu=\"mirror\" \
        filter=\"nearest\"/><m:texture2dgroup id=\"4\" texid=\"3\"><m:tex2coord u=\"0\" v=\"0.99\"/></m:texture2dgroup>";
    assert_eq!(color(base, "", "").0, [[1.0; 3]; 3]);
    assert_eq!(color(base, "pid=\"1\" pindex=\"1\"", "").0, [GREEN; 3]);
    // A triangle's own comes first; one index is for all corners; base materials are not blended.
    assert_eq!(color(base, "pid=\"1\" pindex=\"1\"", "pid=\"1\" p1=\"0\"").0, [RED; 3]);
    assert_eq!(color(base, "pid=\"1\" pindex=\"1\"", "p1=\"0\" p2=\"1\" p3=\"1\"").0, [RED; 3]);
    let (found, with_notes) = color(group, "", "pid=\"2\" p1=\"0\" p2=\"1\" p3=\"2\"");
    assert_eq!(found, [RED, GREEN, BLUE]);
    assert!(notes(&with_notes).contains("transparency"));
    let (found, with_texture) = color(texture, "", "pid=\"4\" p1=\"0\"");
    // The upper left texel.
    assert_eq!(found[0], [0, 0, 200].map(linear));
    assert_eq!(with_texture.textures()[0].sampler().wrap_u, pellucid_mesh::Wrap::Mirrored);

    let composite = "<m:compositematerials id=\"5\" matid=\"1\" matindices=\"0 1\"><m:composite values=\"3 1\"/>\
        </m:compositematerials>";
    let (found, _) = color(&(base.to_owned() + composite), "", "pid=\"5\" p1=\"0\"");
    assert_eq!(found[0], [0.75, 0.25, 0.0]);
    let multi = |pids: &str, methods: &str, indices: &str| {
        let multi = format!(
            "<m:multiproperties id=\"6\" pids=\"{pids}\" {methods}><m:multi pindices=\"{indices}\"/></m:multiproperties>"
        );
        color(&[base, group, texture, &multi].concat(), "", "pid=\"6\" p1=\"0\"").0[0]
    };
    // Half green over red; blue times red; blue over a texture; a texture over red; red times it.
    let half = multi("1 2", "", "0 1");
    assert!((half[0] - 127.0 / 255.0).abs() < 1e-3 && (half[1] - 128.0 / 255.0).abs() < 1e-3, "{half:?}");
    assert_eq!(multi("1 2", "blendmethods=\"multiply\"", "0 2"), [0.0; 3]);
    assert_eq!(multi("4 2", "", "0 2"), BLUE);
    assert_eq!(multi("1 4", "blendmethods=\"mix\"", "0"), [0, 0, 200].map(linear));
    assert_eq!(multi("2 4", "blendmethods=\"multiply\"", "2 0"), [0, 0, 200].map(linear));
    assert_eq!(multi("2 4", "blendmethods=\"multiply\"", "0 0"), [0.0; 3]);
}

#[test]
fn what_is_no_part_of_the_model_is_left_out() {
    let resources = triangle(1, "", "slic3rpe:mmu_segmentation=\"4\"") + &triangle(2, "type=\"support\"", "");
    let xml = model(&resources, "<item objectid=\"1\"/><item objectid=\"2\"/>")
        .replace("<build>", "<metadata><object><mesh/></object></metadata><!-- <object> --><build>");
    let found = read(&xml).unwrap();
    assert_eq!(found.triangles().len(), 1);
    let notes = notes(&found);
    assert!(notes.contains("\"support\"") && notes.contains("painting"), "{notes}");
}

#[test]
fn damage_is_told_by_part_and_element() {
    let good = model(&triangle(1, "", ""), "<item objectid=\"1\"/>");
    let bad = |from: &str, to: &str, object: &str, reason: &str| {
        assert!(good.contains(from), "{from}");
        refused(read(&good.replacen(from, to, 1)), Invalid, object, reason);
    };
    bad("v3=\"2\"", "v3=\"3\"", "object 1, triangle 0", "vertex 3 does not exist");
    bad("v3=\"2\"", "v3=\"-1\"", "object \"1\", triangle 0", "no indices");
    bad("v3=\"2\"", "", "object \"1\", triangle 0", "no indices");
    bad("v3=\"2\"", "v3=\"2\" pid=\"8\" p1=\"0\"", "triangle 0", "group 8 does not exist");
    bad("x=\"10\"", "x=\"ten\"", "object \"1\", vertex 1", "finite");
    bad("x=\"10\"", "x=\"1e999\"", "object \"1\", vertex 1", "finite");
    bad("x=\"10\"", "", "object \"1\", vertex 1", "finite");
    bad("object id=\"1\"", "object id=\"0\"", "object \"0\"", "above 0");
    bad("objectid=\"1\"", "objectid=\"3\"", "object 3", "does not exist");
    bad("objectid=\"1\"", "objectid=\"1\" transform=\"1 2 3\"", "build item", "twelve");
    bad(
        "objectid=\"1\"",
        "objectid=\"1\" transform=\"1e308 0 0 0 1 0 0 0 1 0 0 0\"",
        "triangle 0",
        "beyond all numbers",
    );
    bad("<item objectid=\"1\"/>", "", "model", "no triangles");
    bad("</mesh>", "</mush>", "3D/thing.model, line 1", "XML");
    bad("</build></model>", "", "3D/thing.model", "cut short");
    bad("core/2015/02", "core/2035/02", "3D/thing.model", "no 3MF model");
    bad("<model", "<!DOCTYPE x [<!ENTITY a \"b\">]>\n<model", "3D/thing.model, line", "document type");
    let twice = model(&(triangle(1, "", "") + &triangle(1, "", "")), "<item objectid=\"1\"/>");
    refused(read(&twice), Invalid, "object \"1\"", "another object");
    let deep = model(&"<a>".repeat(300), "");
    refused(read(&deep), Invalid, "3D/thing.model", "");
    let textures = good.replace(
        "<object",
        "<m:texture2dgroup id=\"4\" texid=\"3\"><m:tex2coord u=\"0\" v=\"nan\"/></m:texture2dgroup><object",
    );
    refused(read(&textures), Invalid, "texture2dgroup \"4\", tex2coord 0", "finite");
    let colors =
        good.replace("<object", "<m:colorgroup id=\"4\"><m:color color=\"red\"/></m:colorgroup><object");
    refused(read(&colors), Invalid, "colorgroup \"4\", color 0", "\"red\"");
    let required =
        good.replace("<model", "<model xmlns:b=\"http://example.com/lattice\" requiredextensions=\"b\"");
    refused(read(&required), Unsupported, "3D/thing.model", "http://example.com/lattice");

    let sphere = threemf_xml(&sphere(), ThreeMfColors::Texture);
    refused(import("a.3mf", &package(&sphere, &[]), None), Invalid, "texture2d 9", "does not hold");
    let other = package(&sphere, &[("3D/Texture/skin.png", b"nothing")]);
    refused(import("a.3mf", &other, None), Unsupported, "texture2d 9", "neither PNG nor JPEG");
    let outside = sphere.replace("/3D/Texture/skin.png", "/3D/../../skin.png");
    refused(import("a.3mf", &package(&outside, &[]), None), Invalid, "texture2d 9", "leaves the package");
    refused(
        import("a.3mf", &zipped(&[("word/document.xml", b"<a/>")]), None),
        Invalid,
        "package",
        "no 3D model",
    );
    refused(import("a.3mf", b"PK\x03\x04 nothing", None), Invalid, "package", "damaged");
    let usual = zipped(&[("3D/3dmodel.model", good.as_bytes())]);
    assert_eq!(import("a.3mf", &usual, None).unwrap().triangles().len(), 1);
}

#[test]
fn bombs_are_refused() {
    // A mebibyte of nothing packs into a kibibyte.
    let nothing = vec![b' '; 1 << 20];
    let bomb = zipped(&[("3D/3dmodel.model", &nothing)]);
    assert!(bomb.len() < 4096);
    let small = ImportLimits { file_bytes: 1 << 16, ..ImportLimits::default() };
    refused(
        limited("a.3mf", &bomb, small),
        Unsupported,
        "part \"3D/3dmodel.model\"",
        "1048576 bytes unpacked",
    );
    // The same with a size that is a lie, in local header and directory.
    let mut lie = bomb.clone();
    let size = (nothing.len() as u32).to_le_bytes();
    for at in 0..lie.len() - 4 {
        if lie[at..at + 4] == size {
            lie[at..at + 4].copy_from_slice(&100u32.to_le_bytes());
        }
    }
    assert_ne!(lie, bomb);
    assert!(limited("a.3mf", &lie, small).is_err());
    // Each part by itself is within the limit, all together are not.
    let part = vec![b' '; 40_000];
    let object =
        "<object id=\"1\"><components><component p:path=\"/b.model\" objectid=\"1\"/></components></object>";
    let root = model(object, "<item objectid=\"1\"/>") + &" ".repeat(40_000);
    let together = zipped(&[("3D/3dmodel.model", root.as_bytes()), ("b.model", &part)]);
    refused(limited("a.3mf", &together, small), Unsupported, "part \"/b.model\"", "left");

    // Components that double at every level, or hold themselves.
    let doubled: String = (2..60)
        .map(|id| {
            let inner = id - 1;
            let component = format!("<component objectid=\"{inner}\"/>");
            format!("<object id=\"{id}\"><components>{component}{component}</components></object>")
        })
        .collect();
    let xml = model(&("<object id=\"1\"><mesh/></object>".to_owned() + &doubled), "<item objectid=\"59\"/>");
    let few = ImportLimits { items: 10_000, ..ImportLimits::default() };
    refused(limited("a.3mf", &package(&xml, &[]), few), Unsupported, "build", "more than 10000 objects");
    let itself = "<object id=\"1\"><components><component objectid=\"1\"/></components></object>";
    let xml = model(itself, "<item objectid=\"1\"/>");
    refused(read(&xml), Unsupported, "build", "hold themselves");

    let limits = |change: fn(&mut ImportLimits)| {
        let mut limits = ImportLimits::default();
        change(&mut limits);
        limited("a.3mf", &threemf(&cube(), ThreeMfColors::Group), limits)
    };
    refused(limits(|l| l.vertices = 7), Unsupported, "object \"2\", vertex 7", "more than 7 vertices");
    refused(limits(|l| l.triangles = 5), Unsupported, "object \"2\", triangle 5", "more than 5 triangles");
    refused(limits(|l| l.vertices = 8), Unsupported, "object 2, triangle", "more than 8 vertices");
}
