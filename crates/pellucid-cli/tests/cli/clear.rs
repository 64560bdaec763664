//! `pellucid prepare --clear-from-alpha` as a user meets it.

use std::fs;

use crate::common::{quick, run, slices, stderr, stdout, text};

#[test]
fn what_is_see_through_is_printed_clear_on_request() {
    let folder = tempfile::tempdir().unwrap();
    let cube = |x: u32, first: u32| {
        let corners = (0..8u32).map(|i| format!("v {} {} {}\n", x + (i & 1), i >> 1 & 1, i >> 2));
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces =
            sides.iter().map(|side| format!("f {}\n", side.map(|i| (first + i).to_string()).join(" ")));
        corners.chain(faces).collect::<String>()
    };
    let model = folder.path().join("two.obj");
    let text_of = format!("mtllib two.mtl\nusemtl red\n{}usemtl glass\n{}", cube(0, 1), cube(1, 9));
    fs::write(&model, text_of).unwrap();
    fs::write(
        folder.path().join("two.mtl"),
        "newmtl red\nKd 0.8 0.1 0.1\nnewmtl glass\nKd 0.5 0.7 0.9\nd 0.2\n",
    )
    .unwrap();
    let (out, again) = (folder.path().join("clear"), folder.path().join("again"));
    let done = run(&quick(text(&model), text(&out), &["--clear-from-alpha"]));
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(
        stdout(&done).contains("clear resin: ") && stdout(&done).contains("% of the print"),
        "{}",
        stdout(&done)
    );
    assert!(!stderr(&done).contains("transparency is ignored"), "{}", stderr(&done));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    assert!(report["clear"]["voxels"].as_u64().unwrap() > 1000);
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("manifest.json")).unwrap()).unwrap();
    assert!(manifest["materials"].as_array().unwrap().iter().any(|m| m["name"] == "clear"));
    // The record makes it again, and its slices can be looked at.
    let manifest = out.join("manifest.json");
    let done = run(&["prepare", text(&model), "--settings", text(&manifest), "--out", text(&again)]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(slices(&again) == slices(&out));
    let look = folder.path().join("look");
    let done = run(&["proof", text(&out), "--out", text(&look), "--spp", "2"]);
    assert!(done.status.success(), "{}", stderr(&done));
    // Without the request it is opaque, and that is told.
    let opaque = folder.path().join("opaque");
    let done = run(&quick(text(&model), text(&opaque), &[]));
    assert!(done.status.success() && !stdout(&done).contains("clear resin"));
    assert!(stderr(&done).contains("transparency is ignored"), "{}", stderr(&done));
    let three = run(&quick(
        text(&model),
        text(&opaque),
        &["--clear-from-alpha", "--printer", "j750-high-speed-vivid"],
    ));
    assert!(!three.status.success() && stderr(&three).contains("takes 3"), "{}", stderr(&three));
}
