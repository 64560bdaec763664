//! Printers that take fewer materials than cyan, magenta, yellow, black and white: the whole job, on a small block.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};

use pellucid::core::Control;
use pellucid::slice::{PrintTarget, read_stack};
use pellucid::stage::{Observer, Stage};
use pellucid::voxel::{Frame, LabelGrid, MaterialTable};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};

use common::quick;

fn settings(printer: &str, inks: &[&str], strategy: StrategyKind) -> PrintSettings {
    let all = MaterialTable::cmykw();
    let chosen = inks.iter().map(|name| all.get(all.label_of(name).unwrap()).unwrap().clone()).collect();
    PrintSettings {
        printer: PrintTarget::by_name(printer).unwrap(),
        materials: MaterialTable::new(all.channel_names().to_vec(), chosen).unwrap(),
        strategy,
        ..quick()
    }
}

#[test]
fn two_and_three_materials_go_through_the_whole_job() {
    let monitor = Monitor::silent();
    let folder = tempfile::tempdir().unwrap();
    for (inks, strategy) in [
        (&["magenta", "yellow", "white"][..], StrategyKind::Descent),
        (&["magenta", "yellow", "white"], StrategyKind::SurfaceFirst),
        (&["white", "black"], StrategyKind::Descent),
    ] {
        let job = PrintJob::new(settings("j750-high-speed-vivid", inks, strategy)).unwrap();
        let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [24, 12, 32]).unwrap();
        let block = LabelGrid::from_fn(frame, |_| 1);
        // Orange and white; blue is out of reach.
        let color = |[x, _, z]: [u32; 3]| match (x < 12, z < 16) {
            (true, true) => [0.8, 0.35, 0.1],
            (true, false) => [0.1, 0.1, 0.8],
            _ => [0.95, 0.95, 0.95],
        };
        let prepared = job.prepare_volume("block", &block, color, &Workspace::none(), &monitor).unwrap();
        let out = folder.path().join(format!("{}-{}", inks.len(), strategy.name()));
        let report = prepared.write(&out, false, &monitor).unwrap();
        let (back, manifest) = read_stack(&out, &Control::none()).unwrap();
        assert!(back == prepared.refined.labels);
        let printed: Vec<&str> = manifest.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(printed, inks, "every ink is of use, and no other");
        assert!(manifest.materials.iter().all(|m| m.resin.is_some()));
        assert_eq!(back.solid_count(), 24 * 12 * 32);
        let (before, after) = (&report.evaluation.unrefined, &report.evaluation.refined);
        let [before, after] = [before, after].map(|e| e.at_0_2_mm.printable.mean);
        assert!(after.is_finite() && after < 1.2 * before, "{inks:?}: {before} {after}");
        assert!(report.refinement.out_of_gamut > 0.0);
    }
}

#[test]
fn every_choice_of_inks_goes_through_the_whole_job() {
    let monitor = Monitor::silent();
    let inks = ["cyan", "magenta", "yellow", "black"];
    // Two, three and four materials: one, two or three inks, and white.
    for chosen in
        (1..15u8).map(|mask| (0..4).filter(|i| mask >> i & 1 == 1).map(|i| inks[i]).collect::<Vec<_>>())
    {
        let names: Vec<&str> = chosen.iter().copied().chain(["white"]).collect();
        let mut settings = settings("j750-high-mix-opaque", &names, StrategyKind::SurfaceFirst);
        settings.refine.iterations = Some(1);
        let job = PrintJob::new(settings).unwrap();
        let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [20, 10, 24]).unwrap();
        let block = LabelGrid::from_fn(frame, |_| 1);
        // Each ink's own colour beside white.
        let color = |[x, _, z]: [u32; 3]| match (x < 10, z < 12) {
            (true, true) => [0.1, 0.3, 0.5],
            (true, false) => [0.5, 0.1, 0.05],
            (false, true) => [0.2, 0.2, 0.2],
            (false, false) => [0.95, 0.95, 0.95],
        };
        let prepared = job.prepare_volume("block", &block, color, &Workspace::none(), &monitor).unwrap();
        let counts = prepared.refined.labels.histogram();
        let used: Vec<bool> = (1..=names.len()).map(|label| counts[label] > 0).collect();
        assert!(used.iter().all(|u| *u), "{names:?} {used:?}");
        assert_eq!(prepared.refined.labels.solid_count(), 20 * 10 * 24);
        let errors = &prepared.judged.evaluation;
        let [before, after] = [&errors.unrefined, &errors.refined].map(|e| e.at_0_2_mm.printable.mean);
        assert!(after.is_finite() && after < 1.2 * before, "{names:?}: {before} {after}");
    }
}

#[test]
fn without_white_or_ink_a_job_is_refused() {
    for inks in [&["cyan", "magenta", "yellow", "black"][..], &["magenta", "black"]] {
        let error =
            PrintJob::new(settings("j750-high-mix-opaque", inks, StrategyKind::Descent)).err().unwrap();
        assert!(matches!(error, PrintError::Invalid(_)) && error.to_string().contains("white"), "{error}");
    }
    // White alone shows no colour.
    let job = PrintJob::new(settings("j750-high-mix-opaque", &["white"], StrategyKind::Descent)).unwrap();
    let frame = Frame::new([0.0; 3], PrintTarget::j750().pitch(), [8, 8, 8]).unwrap();
    let (worked, never) = (Worked(false.into()), AtomicBool::new(false));
    let block = LabelGrid::from_fn(frame, |_| 1);
    let error = job.place_volume("block", &block, |_| [0.5; 3], &Monitor::new(&worked, &never)).unwrap_err();
    assert!(error.to_string().contains("white and an ink"), "{error}");
    assert!(!worked.0.into_inner());
}

/// Notes whether a job began to voxelise.
struct Worked(AtomicBool);

impl Observer for Worked {
    fn begin(&self, _: Stage) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(feature = "obj")]
#[test]
fn what_is_larger_than_the_printer_is_refused_before_any_work() {
    let bar = |mm: [f64; 3]| {
        let [x, y, z] = mm;
        let text = format!("v 0 0 0\nv {x} 0 0\nv 0 {y} 0\nv 0 0 {z}\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n");
        let options =
            pellucid::mesh::ImportOptions { up: Some(pellucid::mesh::UpAxis::Z), ..Default::default() };
        options.import_slice("bar.obj", text.as_bytes(), None).unwrap()
    };
    let job = PrintJob::new(settings("j750-high-quality-vivid", &["black", "white"], StrategyKind::Descent))
        .unwrap();
    // 490 x 390 x 200 mm hold it, but not the air around it.
    for mm in [[490.0, 5.0, 5.0], [5.0, 390.0, 5.0], [5.0, 5.0, 200.0], [5.0, 5.0, 1e7]] {
        let (worked, never) = (Worked(false.into()), AtomicBool::new(false));
        let error = job.place(&bar(mm), &Monitor::new(&worked, &never)).unwrap_err();
        assert!(error.to_string().contains("scale or turn the model"), "{error}");
        assert!(!worked.0.into_inner(), "{mm:?}");
    }
}

#[cfg(feature = "obj")]
#[test]
fn models_become_prints_of_three_materials_and_of_vivid_resins() {
    // A tetrahedron of 3 mm, its corners coloured.
    let text = "v 0 0 0 0.9 0.2 0.1\nv 3 0 0 0.9 0.8 0.1\nv 0 3 0 0.95 0.95 0.95\nv 0 0 3 0.1 0.1 0.1\n\
        f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";
    let model =
        pellucid::mesh::ImportOptions::default().import_slice("a.obj", text.as_bytes(), None).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let all = ["cyan", "magenta", "yellow", "black", "white"];
    for (printer, inks, resins) in [
        (
            "j750-high-speed-opaque",
            &["magenta", "black", "white"][..],
            &["VeroMgnt", "VeroBlack", "VeroPureWht"][..],
        ),
        ("j750-high-speed-vivid", &["cyan", "yellow", "white"], &["VeroCY-V", "VeroYL-V", "VUltraWhite"]),
        ("j750-high-mix-vivid", &all, &["VeroCY-V", "VeroMGT-V", "VeroYL-V", "VUltraBlack", "VUltraWhite"]),
    ] {
        let job = PrintJob::new(settings(printer, inks, StrategyKind::Descent)).unwrap();
        let prepared = job.prepare(&model, &Workspace::none(), &Monitor::silent()).unwrap();
        let out = folder.path().join(format!("{printer}-{}", inks.len()));
        let report = prepared.write(&out, false, &Monitor::silent()).unwrap();
        let (back, manifest) = read_stack(&out, &Control::none()).unwrap();
        assert!(back == prepared.refined.labels);
        let printed: Vec<&str> = manifest.materials.iter().filter_map(|m| m.resin.as_deref()).collect();
        assert_eq!(printed, resins);
        let errors = &report.evaluation;
        let [before, after] = [&errors.unrefined, &errors.refined].map(|e| e.at_0_2_mm.printable.mean);
        assert!(after < 1.1 * before, "{printer}: {before} {after}");
    }
}

#[test]
fn more_than_the_printer_takes_are_refused_before_any_work() {
    let printer = PrintTarget::by_name("j750-high-speed-opaque").unwrap();
    let refused = PrintJob::new(PrintSettings { printer, ..PrintSettings::default() }).err().unwrap();
    assert!(matches!(refused, PrintError::Slice(_)));
    let text = refused.to_string();
    assert!(text.contains("5 are needed") && text.contains("takes 3"), "{text}");
    assert!(text.contains("prepare with fewer"), "{text}");
}

#[test]
fn a_material_that_the_printer_lacks_is_refused_before_any_work() {
    let printer =
        PrintTarget::j750().with_palette([("white", [255; 4]), ("cyan", [0, 174, 239, 255])]).unwrap();
    let refused = PrintJob::new(PrintSettings { printer, ..PrintSettings::default() }).err().unwrap();
    let text = refused.to_string();
    assert!(text.contains("no colour for material \"magenta\"") && text.contains("add one"), "{text}");
}
