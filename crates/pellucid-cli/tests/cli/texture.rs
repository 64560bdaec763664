//! `pellucid prepare --output texture` as a user meets it.

use std::fs;

use crate::common::{cube, quick, run, stderr, stdout};

#[test]
fn a_model_comes_back_with_a_texture() {
    let folder = tempfile::tempdir().unwrap();
    let model = cube(folder.path());
    let out = folder.path().join("textured");
    let [model, out_text] = [&model, &out].map(|path| path.to_str().unwrap());
    for (format, files) in [
        (&[][..], &["textured.glb"][..]),
        (&["--texture-format", "obj"], &["textured.obj", "textured.mtl", "textured.png"]),
        (&["--texture-format", "3mf"], &["textured.3mf"]),
    ] {
        let more = [&["--output", "texture", "--force"], format].concat();
        let done = run(&quick(model, out_text, &more));
        assert!(done.status.success(), "{}", stderr(&done));
        assert!(stdout(&done).contains("predicted gain"), "{}", stdout(&done));
        for file in files.iter().chain(&["report.json", "proof.png", "proof.exr", "error.png"]) {
            assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
        }
        assert!(!out.join("slices").exists());
        let report: serde_json::Value =
            serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
        assert_eq!(report["texture"]["files"][0], files[0]);
        assert_eq!(report["record"]["settings"]["strategy"], "surface-color");
    }
    let again = run(&quick(model, out_text, &["--output", "texture"]));
    assert!(!again.status.success() && stderr(&again).contains("--force"), "{}", stderr(&again));
    let mixed = run(&quick(model, out_text, &["--output", "texture", "--strategy", "descent"]));
    assert!(!mixed.status.success() && stderr(&mixed).contains("--strategy"), "{}", stderr(&mixed));
    // A folder of a texture is no print, and is not replaced by one.
    let slices = run(&quick(model, out_text, &["--force"]));
    assert!(!slices.status.success() && out.join("textured.3mf").exists(), "{}", stderr(&slices));
}
