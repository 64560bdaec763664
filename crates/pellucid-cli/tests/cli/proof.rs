//! `pellucid proof` as a user meets it: slices of a print, images of another tool, messages.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::common::{cube, quick, run, stderr, stdout, text};

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&fs::read(folder.join("report.json")).unwrap()).unwrap()
}

/// A print whose judge takes little time, in `folder`.
fn print(folder: &Path) -> std::path::PathBuf {
    let (model, out, settings) = (cube(folder), folder.join("print"), folder.join("quick.json"));
    fs::write(&settings, r#"{ "judge": { "points": 40 }, "judge_point_spp": 64, "proof_edge": 32 }"#)
        .unwrap();
    let done = run(&quick(text(&model), text(&out), &["--settings", text(&settings)]));
    assert!(done.status.success(), "{}", stderr(&done));
    out
}

#[test]
fn slices_are_proved_with_and_without_their_manifest() {
    let folder = tempfile::tempdir().unwrap();
    let print = print(folder.path());
    let own = folder.path().join("own");
    let done = run(&["proof", text(&print), "--out", text(&own)]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(stdout(&done).contains("appearance off by 0.0"), "{}", stdout(&done));
    for file in ["proof.html", "proof.glb", "proof.png", "proof.exr"] {
        assert!(own.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let (of_print, of_slices) = (report(&print), report(&own));
    assert_eq!(of_slices["resins"], of_print["resins"]);
    assert_eq!(of_slices["surface_voxels"], of_print["surface_voxels"]);
    assert_eq!(of_slices["settings"]["materials"], of_print["record"]["settings"]["materials"]);

    // The same images, as another tool would leave them: colours and pitch by hand.
    let palette = folder.path().join("palette.json");
    let colors = &of_print["record"]["settings"]["printer"]["palette"];
    fs::write(&palette, colors.to_string()).unwrap();
    let foreign = folder.path().join("foreign");
    let pitch = "0.042333333,0.084666667,0.027";
    let slices = print.join("slices");
    let images =
        ["proof", text(&slices), "--pattern", "slice_*.png", "--palette", text(&palette), "--spp", "1"];
    let done = run(&[&images[..], &["--pitch-mm", pitch, "--out", text(&foreign)]].concat());
    assert!(done.status.success(), "{}", stderr(&done));
    let of_images = report(&foreign);
    assert_eq!(of_images["surface_voxels"], of_print["surface_voxels"]);
    let volume = |report: &Value| report["resins"]["volume_cm3"].as_f64().unwrap();
    assert!((volume(&of_images) / volume(&of_print) - 1.0).abs() < 1e-6);
    // Twice as thick layers take twice as much.
    let thick = folder.path().join("thick");
    let done = run(&[&images[..], &["--pitch-mm", "0.05,0.05,0.1", "--out", text(&thick)]].concat());
    assert!(done.status.success(), "{}", stderr(&done));
    let ratio = volume(&report(&thick)) / volume(&of_print);
    let expected = 0.05 * 0.05 * 0.1 / (0.042333333 * 0.084666667 * 0.027);
    assert!((ratio / expected - 1.0).abs() < 1e-6, "{ratio}");
    // Only with --force, and nothing else is touched.
    let again = run(&["proof", text(&print), "--out", text(&own)]);
    assert!(!again.status.success() && stderr(&again).contains("already exists"), "{}", stderr(&again));
}

#[test]
fn what_the_slices_do_not_say_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let coupon = folder.path().join("coupon");
    assert!(run(&["coupon", "--out", text(&coupon)]).status.success());
    // Another printer's colours.
    let slices = coupon.join("slices");
    let other = run(&["proof", text(&slices), "--printer", "j750-high-mix-vivid", "--out", text(&out)]);
    assert!(stderr(&other).contains("colours that stand for nothing"), "{}", stderr(&other));
    // Materials in another order.
    let materials = folder.path().join("materials.json");
    let table = r#"{ "channel_names": ["R", "G", "B"], "materials": [
        { "name": "white", "sigma_s": [6, 9, 24], "sigma_a": [0.01, 0.01, 0.01], "g": 0.4 } ] }"#;
    fs::write(&materials, table).unwrap();
    let other = run(&["proof", text(&coupon), "--materials", text(&materials), "--out", text(&out)]);
    let message = stderr(&other);
    assert!(message.contains("manifest.json") && message.contains("--materials"), "{message}");
    let bad = run(&["proof", text(&slices), "--pitch-mm", "1,2", "--out", text(&out)]);
    assert!(stderr(&bad).contains("three lengths"), "{}", stderr(&bad));
    assert!(!out.exists());
}
