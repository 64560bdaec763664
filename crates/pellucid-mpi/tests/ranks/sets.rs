//! Sets and training.

use std::fs;

use crate::common::{folder, mpirun, run};

#[test]
fn sets_are_the_same_on_any_number_of_ranks() {
    let folder = folder();
    let made = |ranks: usize| {
        run(ranks, folder.path(), &format!("dataset toy.json --out {ranks} --split test --split loops"));
        let out = folder.path().join(ranks.to_string());
        assert_eq!(fs::read_dir(&out).unwrap().count(), 2, "parts are removed");
        ["test.set", "loops.set"].map(|file| fs::read(out.join(file)).unwrap())
    };
    let one = made(1);
    assert!(made(2) == one && made(4) == one);
    // Finished sets stay.
    assert!(made(2) == one);
}

#[test]
fn training_is_the_same_on_the_same_number_of_ranks_and_goes_on_with_another() {
    let folder = folder();
    let line = "train --recipe toy.json --validation none --window 4 --out run";
    let trained = |ranks: usize, name: &str, more: &str| {
        // The weights' history has the command, so that has to be the same.
        let at = folder.path().join(name);
        fs::create_dir_all(&at).unwrap();
        fs::copy(folder.path().join("toy.json"), at.join("toy.json")).unwrap();
        run(ranks, &at, &format!("{line} {more}"));
        fs::read(at.join("run/weights.safetensors")).unwrap()
    };
    let two = trained(2, "first", "--steps 4");
    assert!(trained(2, "second", "--steps 4") == two);
    assert!(trained(1, "alone", "--steps 4") != two, "other samples");
    let on_three = mpirun(3, folder.path()).args(line.split_whitespace()).output().unwrap();
    assert!(String::from_utf8_lossy(&on_three.stderr).contains("256 samples cannot be shared by 3"));
    let longer = trained(4, "first", "--resume --steps 6");
    assert!(longer != two && !longer.is_empty());
}
