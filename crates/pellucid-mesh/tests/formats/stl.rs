//! STL alone.

use pellucid_mesh::ImportLimits;

use crate::refused::Kind::{Invalid, Unsupported};
use crate::refused::*;
use crate::scene::*;

#[test]
fn text_in_any_case_and_with_any_line_ends() {
    let text = String::from_utf8(stl_ascii(&cube())).unwrap();
    let expected = import("a", text.as_bytes(), None).unwrap();
    for changed in [
        text.to_uppercase(),
        text.replace('\n', "\r\n"),
        text.replace('\n', "\r"),
        format!("\u{feff}\n{text}{text}"),
        text.replace("endsolid a name\n", ""),
    ] {
        let model = import("a", changed.as_bytes(), None).unwrap();
        assert_eq!(model.vertices(), expected.vertices());
        assert_eq!(model.triangles()[..12], *expected.triangles());
    }
}

#[test]
fn damage_is_told_by_line_or_triangle() {
    let text = String::from_utf8(stl_ascii(&cube())).unwrap();
    let changed = |from: &str, to: &str| import("a.stl", text.replacen(from, to, 1).as_bytes(), None);
    refused(changed("vertex 0 0 0", "vertex 0 0"), Invalid, "line 4", "three finite numbers");
    refused(changed("vertex 0 0 0", "vertex 0 nan 0"), Invalid, "line 4", "three finite numbers");
    refused(changed("vertex 0 0 0", "vertex 0 1e39 0"), Invalid, "line 4", "three finite numbers");
    refused(changed("vertex 0 0 0\n", ""), Invalid, "line 6", "2 vertices");
    refused(changed("endloop\n", "vertex 1 1 1\n"), Invalid, "line 7", "more than three");
    refused(changed("endloop", "endlop"), Invalid, "line 7", "\"endlop\"");
    refused(import("a.stl", &text.as_bytes()[..150], None), Invalid, "line", "");
    refused(import("a.stl", b"solid nothing\nendsolid nothing", None), Invalid, "model", "no triangles");
    // With a byte order mark, which fuzzing found to panic where there is little after it.
    refused(import("a.stl", "\u{feff}solid nothing".as_bytes(), None), Invalid, "model", "no triangles");

    let bytes = stl_binary(&cube());
    refused(import("a.stl", &bytes[..bytes.len() - 1], None), Invalid, "header", "claims 12 triangles, 11");
    refused(import("a.stl", &[0; 40], None), Invalid, "file", "40 bytes");
    let mut claims = bytes.clone();
    claims[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    refused(import("a.stl", &claims, None), Invalid, "header", "claims 4294967295");
    let mut infinite = bytes.clone();
    infinite[84 + 50 + 12..][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    refused(import("a", &infinite, None), Invalid, "triangle 1", "infinite");
}

#[test]
fn limits_and_what_is_left_out() {
    let bytes = stl_binary(&cube());
    let few = ImportLimits { triangles: 11, ..ImportLimits::default() };
    refused(limited("a", &bytes, few), Unsupported, "triangle 11", "more than 11 triangles");
    let few = ImportLimits { vertices: 7, ..ImportLimits::default() };
    refused(limited("a", &bytes, few), Unsupported, "triangle", "more than 7 vertices");
    let few = ImportLimits { file_bytes: 683, ..ImportLimits::default() };
    refused(limited("a", &bytes, few), Unsupported, "file", "684 bytes");

    let mut odd = bytes;
    odd[84 + 48] = 1;
    odd.extend([7; 3]);
    // The first triangle becomes a line.
    let start = odd[84 + 12..84 + 24].to_vec();
    odd[84 + 24..84 + 36].copy_from_slice(&start);
    let model = import("a.stl", &odd, None).unwrap();
    assert_eq!(model.triangles().len(), 11);
    let notes = notes(&model);
    for part in ["follows the last triangle", "attribute bytes", "1 triangles without area"] {
        assert!(notes.contains(part), "{notes}");
    }
}
