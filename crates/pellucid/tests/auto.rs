//! What `auto` says of its choice.

use pellucid::refine::Effort;
use pellucid::slice::PrintTarget;
use pellucid::voxel::{Frame, LabelGrid, MaterialTable};
use pellucid::{Choice, Monitor, PredictorKind, PrintJob, PrintSettings, StrategyKind, Workspace};

fn settings() -> PrintSettings {
    let mut settings = PrintSettings {
        predictor: PredictorKind::Auto,
        strategy: StrategyKind::SurfaceFirst,
        spp: Some(4),
        judge: Effort { points: 50, point_passes: 2, surface_passes: 2 },
        judge_spp: 2,
        judge_point_spp: 16,
        proof_edge: 32,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(1);
    settings
}

/// The choice that the report of a small print holds.
fn choice(settings: PrintSettings) -> Choice {
    let job = PrintJob::new(settings).unwrap();
    let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [16, 8, 24]).unwrap();
    let block = LabelGrid::from_fn(frame, |_| 1);
    let color = |[x, ..]: [u32; 3]| if x < 8 { [0.8, 0.2, 0.1] } else { [0.9, 0.9, 0.8] };
    let prepared =
        job.prepare_volume("block", &block, color, &Workspace::none(), &Monitor::silent()).unwrap();
    let report = prepared.report(&Monitor::silent());
    assert_eq!(report.record.settings.predictor, report.choice.as_ref().unwrap().chosen);
    report.choice.unwrap()
}

#[test]
fn trials_decide_where_the_network_fits() {
    let choice = choice(settings());
    assert_eq!(choice.trials.len(), 2);
    assert!(choice.reason.contains("mc takes") && choice.reason.contains("rpnn takes"), "{}", choice.reason);
}

#[test]
fn paths_are_taken_where_the_network_was_not_trained() {
    let says = |change: &dyn Fn(&mut PrintSettings), texts: &[&str]| {
        let mut settings = settings();
        change(&mut settings);
        let choice = choice(settings);
        assert_eq!((choice.chosen, choice.trials.len()), (PredictorKind::MonteCarlo, 0));
        assert!(choice.reason.starts_with("the network does not fit"), "{}", choice.reason);
        assert!(texts.iter().all(|text| choice.reason.contains(text)), "{}", choice.reason);
    };
    let fine = |s: &mut PrintSettings| s.printer = PrintTarget::by_name("j750-high-quality-vivid").unwrap();
    says(&fine, &["pitch", "0.014", "trained for"]);
    says(&|s| s.refractive_index = 1.3, &["refractive index", "1.3", "1.5"]);
    let strong = |s: &mut PrintSettings| {
        let table = MaterialTable::cmykw();
        let mut materials = table.materials().to_vec();
        materials[3].sigma_a[1] = 400.0;
        s.materials = MaterialTable::over(table.spectrum().clone(), materials).unwrap();
    };
    says(&strong, &["absorption of \"black\"", "400 per mm", "145.3"]);
}
