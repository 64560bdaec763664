//! `pellucid prepare --spectral-texture` as a user meets it.

use std::fs;
use std::path::Path;

use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
use pellucid::voxel::{Channels, Material, MaterialTable};

use crate::common::{cube, quick, run, stderr, text};

/// The default materials' R, G and B as thirds of 16 bands.
fn bands(path: &Path) {
    let spread = |v: &[f32]| (0..16).map(|k| v[2 - (3 * k / 16).min(2)]).collect();
    let bands =
        |m: &Material| Material { sigma_s: spread(&m.sigma_s), sigma_a: spread(&m.sigma_a), ..m.clone() };
    let materials = MaterialTable::cmykw().materials().iter().map(bands).collect();
    let channels = Channels::Bands { start_nm: 400.0, step_nm: 20.0, count: 16 };
    let table = MaterialTable::over(channels, materials).unwrap();
    fs::write(path, serde_json::to_string(&table).unwrap()).unwrap();
}

/// Red, as a file of reflectances.
fn reflectances(path: &Path, prefix: &str) {
    let channel = |k: u32| {
        let nm = 400 + 20 * k;
        let value = if nm > 580 { 0.6 } else { 0.1 };
        AnyChannel::new(format!("{prefix}{nm},000nm").as_str(), FlatSamples::F32(vec![value; 4]))
    };
    let channels = AnyChannels::sort((0..16).map(channel).collect());
    Image::from_channels((2, 2), channels).write().to_file(path).unwrap();
}

#[test]
fn reflectances_take_the_place_of_the_texture() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let plain = cube(folder.path());
    // A model with a UV map.
    let made = run(&quick(text(&plain), text(&at("textured")), &["--output", "texture"]));
    assert!(made.status.success(), "{}", stderr(&made));
    let model = at("textured/textured.glb");
    bands(&at("bands.json"));
    reflectances(&at("red.exr"), "T.");
    reflectances(&at("lamp.exr"), "S0.");
    let (table, image, out) = (at("bands.json"), at("red.exr"), at("print"));
    let lit = ["--materials", text(&table), "--illuminants", "D65,A"];
    let done =
        run(&quick(text(&model), text(&out), &[&lit[..], &["--spectral-texture", text(&image)]].concat()));
    assert!(done.status.success(), "{}", stderr(&done));
    let report: serde_json::Value =
        serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    assert!(report["record"]["model"]["spectral_image"].is_string(), "{}", report["record"]["model"]);

    let says = |model: &Path, more: &[&str], expected: &str| {
        let done = run(&quick(text(model), text(&at("none")), &[&lit[..], more].concat()));
        assert_eq!(done.status.code(), Some(1), "{}", stderr(&done));
        assert!(stderr(&done).contains(expected), "{}", stderr(&done));
    };
    says(&model, &["--spectral-texture", text(&at("missing.exr"))], "missing.exr");
    says(&model, &["--spectral-texture", text(&at("lamp.exr"))], "sent out");
    says(&plain, &["--spectral-texture", text(&image)], "no texture");
    says(&model, &["--spectral-texture", text(&image), "--output", "texture"], "--spectral-texture");
    // Without the image the settings of the print make another one, and that is told.
    let (manifest, again) = (out.join("manifest.json"), at("again"));
    let done = run(&["prepare", text(&model), "--settings", text(&manifest), "--out", text(&again)]);
    assert!(done.status.success() && stderr(&done).contains("another spectral texture"), "{}", stderr(&done));
}
