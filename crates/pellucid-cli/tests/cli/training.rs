//! Sets, training and judging as a user meets them: generate, info, verify, five steps, resume, judge.

use std::fs;

use crate::common::{run, stderr, stdout};

#[test]
fn a_toy_recipe_is_labelled_trained_on_and_judged() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().expect("plain names").to_owned();
    let recipe = path("toy.json");
    fs::write(&recipe, include_str!("toy.json")).unwrap();
    let done = |arguments: &[&str]| {
        let output = run(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        stdout(&output)
    };
    done(&["dataset", "generate", &recipe, "--out", &path("sets")]);
    let set = path("sets/test.set");
    let bytes = fs::read(&set).unwrap();
    // A set that is there is left alone.
    done(&["dataset", "generate", &recipe, "--out", &path("sets")]);
    assert_eq!(fs::read(&set).unwrap(), bytes);
    assert!(done(&["dataset", "info", &set]).contains("test"));
    assert!(done(&["dataset", "verify", &set, "--volumes", "1"]).contains("1 volume"));

    let train = |out: &str, steps: &str, more: &[&str]| {
        let out = path(out);
        done(&[&["train", "--recipe", &recipe, "--out", &out, "--steps", steps][..], more].concat());
        fs::read(format!("{out}/weights.safetensors")).unwrap()
    };
    let five = train("whole", "5", &[]);
    assert!(!five.is_empty());
    let judged = done(&["dataset", "judge", &set, "--weights", &path("whole/weights.safetensors")]);
    assert!(judged.to_lowercase().contains("rmse"), "{judged}");
    // A run that is complete says so, and resuming it changes nothing.
    assert_eq!(train("whole", "5", &["--resume"]), five);

    let missing = run(&["dataset", "info", &path("none.set")]);
    assert_eq!(missing.status.code(), Some(1));
    assert_eq!(stderr(&missing).matches("No such file").count(), 1, "{}", stderr(&missing));
    let refused = run(&["dataset", "judge", &set, "--weights", &recipe]);
    assert!(stderr(&refused).contains("pellucid train"), "{}", stderr(&refused));
}
