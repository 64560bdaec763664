//! One print by all, and a plate.

use crate::common::{folder, print, run};

fn same_on_1_2_and_4(options: &str) {
    let folder = folder();
    let prepared = |ranks: usize| {
        let line = format!("prepare a.glb --height-mm 1.2 --settings quick.json --out {ranks} {options}");
        run(ranks, folder.path(), &line);
        print(&folder.path().join(ranks.to_string()))
    };
    let one = prepared(1);
    assert!(one.len() > 10);
    assert!(prepared(2) == one, "2 ranks");
    assert!(prepared(4) == one, "4 ranks");
}

#[test]
fn descent() {
    same_on_1_2_and_4("--strategy descent --iterations 3");
}

#[test]
fn surface_first() {
    same_on_1_2_and_4("--strategy surface-first --iterations 3");
}

#[test]
fn the_corrected_network() {
    same_on_1_2_and_4("--strategy surface-first --iterations 2 --predictor rpnn");
}

#[test]
fn a_plate_is_dealt_out_and_gone_on_with() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let options = "--height-mm 1.2 --settings quick.json --strategy surface-first --iterations 1";
    run(1, folder.path(), &format!("prepare a.glb --out alone {options}"));
    let alone = print(&at("alone"));
    run(2, folder.path(), &format!("prepare a.glb b.glb --out plate {options}"));
    let pages = print(&at("plate/a"));
    assert!(pages.keys().eq(alone.keys()));
    let slices = |print: &std::collections::BTreeMap<_, _>| {
        let mut print = print.clone();
        // It names the model.
        print.remove(std::path::Path::new("manifest.json"));
        print
    };
    assert!(pages == alone && slices(&print(&at("plate/b"))) == slices(&alone));
    // What is done stays.
    std::fs::remove_dir_all(at("plate/b")).unwrap();
    let before = std::fs::metadata(at("plate/a/report.json")).unwrap().modified().unwrap();
    run(3, folder.path(), &format!("prepare a.glb b.glb --out plate --resume {options}"));
    assert_eq!(std::fs::metadata(at("plate/a/report.json")).unwrap().modified().unwrap(), before);
    assert!(slices(&print(&at("plate/b"))) == slices(&alone));
}
