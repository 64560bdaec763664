//! A print of bands under several lights: what the page lets one choose, and its numbers.

use std::sync::LazyLock;

use pellucid::color::spectrum::Illuminant;
use pellucid::job::ProofFiles;
use pellucid::voxel::{Channels, Material, MaterialTable};
use pellucid::{Monitor, PrintJob, Workspace};
use pellucid_tests::{lit_settings, patched_ball, spectral_cmykw};

use crate::Print;
use crate::figures::check_figures;

/// Five of the bands: enough to see lights differ.
fn few_bands() -> MaterialTable {
    let some = |values: &[f32]| values.iter().copied().step_by(7).collect();
    let materials = spectral_cmykw()
        .materials()
        .iter()
        .map(|m| Material { sigma_s: some(&m.sigma_s), sigma_a: some(&m.sigma_a), ..m.clone() })
        .collect();
    let channels = Channels::Bands { start_nm: 400.0, step_nm: 70.0, count: 5 };
    MaterialTable::over(channels, materials).unwrap()
}

pub static LIT: LazyLock<Print> = LazyLock::new(|| {
    let settings = lit_settings(1.5, few_bands(), &[Illuminant::A, Illuminant::Led]);
    let job = PrintJob::new(settings).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (out, monitor) = (folder.path().join("print"), Monitor::silent());
    // Judged twice, the second time from what the first one kept.
    let workspace = Workspace::create(&out).unwrap();
    let first = job.prepare(&patched_ball(), &workspace, &monitor).unwrap();
    let prepared = job.prepare(&patched_ball(), &workspace, &monitor).unwrap();
    assert_eq!(prepared.judged.light_looks, first.judged.light_looks);
    assert_eq!(prepared.judged.appearance, first.judged.appearance);
    prepared.write_with(ProofFiles { html: true, glb: false }, &out, false, &monitor).unwrap();
    Print { prepared, folder }
});

#[test]
fn the_page_has_the_print_under_each_light() {
    let (report, judged) = (LIT.json("report.json"), &LIT.prepared.judged);
    assert_eq!((judged.light_looks.len(), report["lights"].as_array().unwrap().len()), (2, 3));
    for (i, look) in judged.light_looks.iter().enumerate() {
        let light = &report["lights"][i + 1];
        let mean =
            look.inconstancy.iter().map(|&v| f64::from(v)).sum::<f64>() / look.inconstancy.len() as f64;
        let reported = light["inconstancy"][1]["mean"].as_f64().unwrap();
        assert!((mean - reported).abs() < 1e-4 && mean > 0.0, "{mean} {reported}");
        let white = light["media_white"][0].as_f64().unwrap();
        assert!((white - f64::from(LIT.prepared.aimed.viewing.media_white()[0])).abs() > 1e-6);
    }
    let mut html = LIT.text("proof.html");
    for field in [r#""under":"A""#, r#""under":"LED""#, r#""key":"inconstancy""#] {
        assert!(html.contains(field), "{field}");
    }
    check_figures(&mut html, |from| LIT.figure(from));
    assert!(html.contains("Under each light"));
}
