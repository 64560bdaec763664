//! What `auto` says of its choice, and where the network is left out.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};

use pellucid::mesh::{BaseColor, Model, Triangle, Vertex};
use pellucid::refine::RefineSettings;
use pellucid::slice::PrintTarget;
use pellucid::stage::{Observer, Stage};
use pellucid::voxel::{Frame, LabelGrid, MaterialTable};
use pellucid::{Choice, Monitor, PredictorKind, PrintJob, PrintSettings, StrategyKind, Workspace};

use common::quick;

fn settings() -> PrintSettings {
    PrintSettings { predictor: PredictorKind::Auto, strategy: StrategyKind::SurfaceFirst, ..quick() }
}

/// Materials whose black absorbs more than the network was trained with.
fn strong() -> MaterialTable {
    let table = MaterialTable::cmykw();
    let mut materials = table.materials().to_vec();
    materials[3].sigma_a[1] = 400.0;
    MaterialTable::over(table.spectrum().clone(), materials).unwrap()
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
    for section_mm in [None, Some(1.0)] {
        let choice = choice(PrintSettings { section_mm, ..settings() });
        assert_eq!(choice.trials.len(), 2);
        let reason = &choice.reason;
        assert!(reason.contains("mc takes") && reason.contains("rpnn takes"), "{reason}");
    }
}

#[test]
fn descent_takes_paths_without_a_trial() {
    let choice = choice(PrintSettings { strategy: StrategyKind::Descent, ..settings() });
    assert_eq!((choice.chosen, choice.trials.len()), (PredictorKind::MonteCarlo, 0));
    assert!(choice.reason.contains("descent"), "{}", choice.reason);
}

#[test]
fn descent_by_averaged_paths_comes_closer_and_is_resumed_to_the_same() {
    let settings = PrintSettings {
        predictor: PredictorKind::Rpnn,
        spp: None,
        refine: RefineSettings { iterations: Some(9), ..quick().refine },
        strategy: StrategyKind::Descent,
        ..quick()
    };
    let job = PrintJob::new(settings).unwrap();
    assert_eq!(job.settings().spp, Some(4));
    let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [24, 12, 40]).unwrap();
    let block = LabelGrid::from_fn(frame, |_| 1);
    let color = |[x, ..]: [u32; 3]| if x < 12 { [0.8, 0.2, 0.1] } else { [0.9, 0.9, 0.8] };
    let run = |workspace: &Workspace, monitor: &Monitor<'_>| {
        job.prepare_volume("block", &block, color, workspace, monitor)
    };
    let whole = run(&Workspace::none(), &Monitor::silent()).unwrap();
    assert_eq!(whole.record.predictor.name, "rpnn~mc");
    let evaluation = &whole.judged.evaluation;
    let [before, after] =
        [&evaluation.unrefined, &evaluation.refined].map(|errors| errors.at_0_1_mm.printable.mean);
    assert!(after < 0.9 * before, "{before} {after}");

    struct CancelAt<'a>(&'a AtomicBool);
    impl Observer for CancelAt<'_> {
        fn progress(&self, stage: Stage, done: u64, total: u64) {
            if stage == Stage::Refine && 4 * done > 3 * total {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("print");
    let flag = AtomicBool::new(false);
    let workspace = Workspace::create(&out).unwrap();
    let cancelled = run(&workspace, &Monitor::new(&CancelAt(&flag), &flag));
    assert!(cancelled.err().is_some_and(|e| e.is_cancelled()));
    drop(workspace);
    let resumed = run(&Workspace::resume(&out), &Monitor::silent()).unwrap();
    assert!(resumed.refined.labels == whole.refined.labels, "what was learned was lost");
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
    says(&|s| s.materials = strong(), &["absorption of \"black\"", "400 per mm", "145.3"]);
}

#[test]
fn a_preview_takes_the_network_only_where_it_was_trained() {
    let corner = |position_m: [f64; 3]| Vertex { position_m, uv: [0.0; 2], color: [1.0; 4] };
    let vertices = [[0.0; 3], [1e-3, 0.0, 0.0], [0.0, 0.0, 1e-3]].map(corner).to_vec();
    let triangle = Triangle { vertices: [0, 1, 2], material: 0 };
    let grey = BaseColor { name: String::new(), factor: [0.4; 4], texture: None, double_sided: true };
    let model = Model::new("sheet", vertices, vec![triangle], vec![grey], Vec::new()).unwrap();
    let predictor = |materials: MaterialTable| {
        let job = PrintJob::new(PrintSettings { materials, ..quick() }).unwrap();
        job.preview(&model, |_, _| Ok(()), &Monitor::silent()).unwrap().record.predictor.name
    };
    assert_eq!(predictor(MaterialTable::cmykw()), "rpnn");
    assert_eq!(predictor(strong()), "mc");
}
