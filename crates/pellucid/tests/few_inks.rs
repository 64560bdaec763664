//! Printers that take fewer materials than cyan, magenta, yellow, black and white: the whole job, on a small block.

use pellucid::core::Control;
use pellucid::refine::Effort;
use pellucid::slice::{PrintTarget, read_stack};
use pellucid::voxel::{Frame, LabelGrid, MaterialTable};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};

fn settings(inks: &[&str], strategy: StrategyKind) -> PrintSettings {
    let all = MaterialTable::cmykw();
    let chosen = inks.iter().map(|name| all.get(all.label_of(name).unwrap()).unwrap().clone()).collect();
    let mut settings = PrintSettings {
        printer: PrintTarget::by_name("j750-high-speed-vivid").unwrap(),
        materials: MaterialTable::new(all.channel_names().to_vec(), chosen).unwrap(),
        strategy,
        spp: Some(4),
        judge: Effort { points: 100, point_passes: 2, surface_passes: 2 },
        judge_spp: 2,
        judge_point_spp: 16,
        proof_edge: 32,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(2);
    settings.descent.opening_steps = 1;
    settings
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
        let job = PrintJob::new(settings(inks, strategy)).unwrap();
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
fn more_than_the_printer_takes_are_refused_before_any_work() {
    let printer = PrintTarget::by_name("j750-high-speed-opaque").unwrap();
    let refused = PrintJob::new(PrintSettings { printer, ..PrintSettings::default() }).err().unwrap();
    assert!(matches!(refused, PrintError::Slice(_)));
    let text = refused.to_string();
    assert!(text.contains("5 are needed") && text.contains("takes 3"), "{text}");
}
