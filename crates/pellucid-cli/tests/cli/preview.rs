//! `pellucid preview` as a user meets it.

use std::fs;

use serde_json::Value;

use crate::common::{cube, run, stderr, stdout};

#[test]
fn a_preview_is_written_told_and_prepared_from() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (model, out) = (cube(folder.path()).to_str().unwrap().to_owned(), path("look"));
    let done = run(&["preview", &model, "--out", &out, "--seed", "3"]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(stdout(&done).contains("unrefined, off the texture by"), "{}", stdout(&done));
    let report: Value = serde_json::from_slice(&fs::read(format!("{out}/preview.json")).unwrap()).unwrap();
    assert_eq!((report["detail"].as_str(), &report["record"]["settings"]["seed"]), (Some("full"), &3.into()));
    let page = fs::read_to_string(format!("{out}/preview.html")).unwrap();
    assert!(page.contains("Preview before refinement") && page.contains("cube.glb"));
    assert!(fs::metadata(format!("{out}/preview.png")).unwrap().len() > 100);

    // Only with --force, and never what is not a preview's.
    let again = run(&["preview", &model, "--out", &out]);
    assert!(!again.status.success() && stderr(&again).contains("already exists"), "{}", stderr(&again));
    let picture = || fs::read(format!("{out}/preview.png")).unwrap();
    let relative = picture();
    let done = run(&["preview", &model, "--out", &out, "--force", "--seed", "3", "--intent", "absolute"]);
    assert!(done.status.success(), "{}", stderr(&done));
    assert!(picture() != relative, "the print's white is no perfect one");
    let done = run(&["preview", &model, "--out", &out, "--force", "--absolute"]);
    assert!(done.status.success(), "{}", stderr(&done));
    fs::write(format!("{out}/notes.txt"), "mine").unwrap();
    let again = run(&["preview", &model, "--out", &out, "--force"]);
    assert!(stderr(&again).contains("notes.txt"), "{}", stderr(&again));

    // glTF has no profiles.
    let done = run(&["preview", &model, "--out", &path("icc"), "--icc", &model]);
    assert!(stderr(&done).contains("ICC profile"), "{}", stderr(&done));

    // Its settings are those of the print.
    let (settings, print) = (format!("{out}/preview.json"), path("print"));
    let quick = ["--spp", "1", "--iterations", "1"];
    let done = run(&[&["prepare", &model, "--settings", &settings, "--out", &print][..], &quick].concat());
    assert!(done.status.success(), "{}", stderr(&done));
    let report: Value = serde_json::from_slice(&fs::read(format!("{print}/report.json")).unwrap()).unwrap();
    assert_eq!(report["record"]["settings"]["absolute"], true);
}
