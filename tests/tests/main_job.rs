//! The main job over the public API: a model in, a complete output folder out.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use pellucid::core::Control;
use pellucid::mesh::Scale;
use pellucid::refine::Effort;
use pellucid::stage::{Observer, Silent, Stage};
use pellucid::{
    Monitor, PredictorKind, Prepared, PrintError, PrintJob, PrintSettings, Report, StrategyKind, Workspace,
};
use pellucid_tests::patched_ball;

fn settings(height_mm: f64) -> PrintSettings {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(height_mm),
        spp: Some(16),
        seed: 3,
        judge: Effort { points: 3000, point_passes: 2, surface_passes: 2 },
        judge_spp: 16,
        judge_point_spp: 128,
        proof_edge: 64,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(4);
    settings
}

fn quick(height_mm: f64) -> PrintSettings {
    let mut settings = settings(height_mm);
    settings.judge = Effort { points: 20, point_passes: 2, surface_passes: 2 };
    (settings.judge_spp, settings.judge_point_spp) = (1, 1);
    settings
}

fn prepare(settings: PrintSettings) -> Prepared {
    PrintJob::new(settings).unwrap().prepare(&patched_ball(), &Workspace::none(), &Monitor::silent()).unwrap()
}

fn slices(dir: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = std::fs::read_dir(dir.join("slices"))
        .unwrap()
        .map(|f| f.unwrap())
        .map(|f| (f.file_name().into_string().unwrap(), std::fs::read(f.path()).unwrap()))
        .collect();
    files.sort();
    files
}

#[test]
fn output_is_complete_and_slices_stack_back_into_the_grid() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("print");
    let prepared = prepare(settings(5.0));
    let labels = prepared.refined.labels.clone();
    assert!(prepared.refined.unrefined != labels, "refinement changes labels");
    let report = prepared.write(&out, false, &Monitor::silent()).unwrap();

    let (back, manifest) = pellucid::slice::read_stack(&out, &Control::none()).unwrap();
    assert!(back == labels);
    let counts = labels.histogram();
    assert_eq!(manifest.materials.iter().map(|m| m.voxels).sum::<u64>(), counts[1..].iter().sum::<u64>());
    let proof = std::fs::read(out.join("proof.png")).unwrap();
    assert!(proof.starts_with(b"\x89PNG") && proof.len() > 1000);
    assert!(std::fs::read(out.join("error.png")).unwrap().starts_with(b"\x89PNG"));
    assert!(std::fs::read(out.join("proof.exr")).unwrap().starts_with(&[0x76, 0x2f, 0x31, 0x01]));

    // The report reads back as it was, and the record in the manifest is the report's.
    let read: Report = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(read, report);
    assert_eq!(manifest.settings.read::<pellucid::Record>().unwrap(), report.record);
    assert_eq!(report.refinement.iterations.len(), 5);
    assert!(report.mesh.as_ref().is_some_and(|mesh| mesh.closed));

    // Judged by fresh paths, patches of this size should lose a good part of their error, as seen and voxel by voxel.
    let (before, after) = (&report.evaluation.unrefined, &report.evaluation.refined);
    assert!(after.voxel.printable.mean < 0.85 * before.voxel.printable.mean, "{before:?} {after:?}");
    assert!(after.at_0_1_mm.printable.mean < 0.8 * before.at_0_1_mm.printable.mean, "{before:?} {after:?}");

    let exists = PrintJob::new(settings(3.0)).unwrap().check_output(&out, false).unwrap_err();
    assert!(exists.to_string().contains("print"), "{exists}");
}

#[test]
fn slices_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let run = |threads: usize, predictor: PredictorKind| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let out = folder.path().join(format!("{threads}-{}", predictor.name()));
        pool.install(|| {
            let mut settings = quick(2.0);
            settings.predictor = predictor;
            settings.refine.iterations = Some(3);
            settings.descent.opening_steps = 1;
            prepare(settings).write(&out, false, &Monitor::silent()).unwrap();
        });
        slices(&out)
    };
    for predictor in [PredictorKind::MonteCarlo, PredictorKind::Rpnn] {
        let (one, three) = (run(1, predictor), run(3, predictor));
        assert!(one.len() > 50);
        assert!(one == three, "{predictor:?}");
    }
}

#[test]
fn the_network_refines_too_and_path_tracing_agrees_that_it_helped() {
    let mut s = settings(4.0);
    s.predictor = PredictorKind::Rpnn;
    s.refine.iterations = Some(3);
    for (strategy, name) in [(StrategyKind::SurfaceFirst, "rpnn+mc"), (StrategyKind::Descent, "rpnn~mc")] {
        s.strategy = strategy;
        let prepared = prepare(s.clone());
        assert_eq!(prepared.record.predictor.name, name);
        assert!(prepared.record.predictor.weights.is_some());
        let report = &prepared.refined.report;
        assert!(report.iterations.iter().all(|i| i.outside_training == 0 && i.paths > 0));
        let e = &prepared.judged.evaluation;
        assert!(e.refined.voxel.printable.mean < 0.9 * e.unrefined.voxel.printable.mean, "{name}: {e:?}");
        let alone = prepared.judged.prediction;
        assert!(alone.as_ref().is_some_and(|p| p.rmse < 0.1), "{name}: {alone:?}");
    }

    // It was trained for one boundary; another is refused before any work.
    s.refractive_index = 1.0;
    let refused = PrintJob::new(s).err().unwrap();
    assert!(refused.to_string().contains("refractive index"), "{refused}");
}

#[test]
fn a_predictor_is_chosen_by_trial_and_a_resumed_job_keeps_it() {
    struct CancelAtRefine<'a>(&'a AtomicBool);
    impl Observer for CancelAtRefine<'_> {
        fn progress(&self, stage: Stage, done: u64, total: u64) {
            if stage == Stage::Refine && 2 * done > total {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let mut settings = quick(2.0);
    (settings.predictor, settings.strategy) = (PredictorKind::Auto, StrategyKind::SurfaceFirst);
    let (job, model) = (PrintJob::new(settings.clone()).unwrap(), patched_ball());
    let out = folder.path().join("print");
    let flag = AtomicBool::new(false);
    let workspace = Workspace::create(&out).unwrap();
    let cancelled = job.prepare(&model, &workspace, &Monitor::new(&CancelAtRefine(&flag), &flag));
    assert!(cancelled.err().is_some_and(|e| e.is_cancelled()));
    let kept = std::fs::read(Workspace::folder_of(&out).join("choice.json")).unwrap();
    let kept: pellucid::Choice = serde_json::from_slice(&kept).unwrap();

    drop(workspace);
    let workspace = Workspace::resume(&out);
    let resumed = job.prepare(&model, &workspace, &Monitor::silent()).unwrap();
    workspace.finish().unwrap();
    assert!(!Workspace::folder_of(&out).exists());
    let choice = resumed.choice.as_ref().unwrap();
    assert_eq!((choice.chosen, choice.trials.len()), (kept.chosen, 2));
    assert!(choice.trials.iter().all(|t| t.seconds > 0.0 && t.error > 0.0 && t.error < 0.1), "{choice:?}");
    // The record names what was chosen, and that alone makes the same print.
    assert_eq!(resumed.record.settings.predictor, choice.chosen);
    settings.predictor = choice.chosen;
    let alone = prepare(settings);
    assert!(alone.refined.labels == resumed.refined.labels && alone.choice.is_none());
    assert_eq!(alone.record, resumed.record);
}

/// Sets a flag in a stage: when it begins, or at its first progress.
struct CancelIn<'a> {
    stage: Stage,
    at_progress: bool,
    flag: &'a AtomicBool,
    after: Mutex<Vec<Stage>>,
}

impl Observer for CancelIn<'_> {
    fn begin(&self, stage: Stage) {
        if self.flag.load(Ordering::Relaxed) {
            self.after.lock().unwrap().push(stage);
        } else if stage == self.stage && !self.at_progress {
            self.flag.store(true, Ordering::Relaxed);
        }
    }
    fn progress(&self, stage: Stage, _: u64, _: u64) {
        if stage == self.stage {
            self.flag.store(true, Ordering::Relaxed);
        }
    }
}

#[test]
fn cancelling_any_stage_ends_the_job_and_leaves_nothing() {
    let model = patched_ball();
    let folder = tempfile::tempdir().unwrap();
    let stages = [
        Stage::Voxelise,
        Stage::Surface,
        Stage::Thickness,
        Stage::Nearest,
        Stage::Texture,
        Stage::Color,
        Stage::Refine,
        Stage::Judge,
        Stage::Proof,
    ];
    for (stage, at_progress) in stages.iter().flat_map(|&s| [(s, false), (s, true)]) {
        let flag = AtomicBool::new(false);
        let observer = CancelIn { stage, at_progress, flag: &flag, after: Mutex::default() };
        let job = PrintJob::new(quick(2.0)).unwrap();
        let result = job.prepare(&model, &Workspace::none(), &Monitor::new(&observer, &flag));
        // A stage that never reports is not cancelled in its midst; then the job runs through.
        if flag.load(Ordering::Relaxed) && !(at_progress && result.is_ok()) {
            assert!(result.err().is_some_and(|e| e.is_cancelled()), "{stage:?} {at_progress}");
            // The last report of a stage may be its end: the next one begins, and ends at once.
            assert!(observer.after.lock().unwrap().len() <= usize::from(at_progress), "{stage:?}");
        } else {
            assert!(at_progress && matches!(stage, Stage::Proof | Stage::Color), "{stage:?}");
        }
    }
    let flag = AtomicBool::new(false);
    let observer = CancelIn { stage: Stage::Slices, at_progress: true, flag: &flag, after: Mutex::default() };
    let result =
        prepare(quick(2.0)).write(&folder.path().join("print"), false, &Monitor::new(&observer, &flag));
    assert!(result.err().is_some_and(|e| e.is_cancelled()));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

/// Cancels in the refinement, after some iterations.
#[test]
fn a_cancelled_job_resumes_from_its_workspace_and_ends_alike() {
    struct CancelAt<'a>(&'a AtomicBool);
    impl Observer for CancelAt<'_> {
        fn progress(&self, stage: Stage, done: u64, total: u64) {
            if stage == Stage::Refine && 2 * done > total {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let folder = tempfile::tempdir().unwrap();
    for predictor in [PredictorKind::MonteCarlo, PredictorKind::Rpnn] {
        let mut settings = quick(2.0);
        settings.predictor = predictor;
        let (job, model) = (PrintJob::new(settings.clone()).unwrap(), patched_ball());
        let whole = job.prepare(&model, &Workspace::none(), &Monitor::silent()).unwrap();

        let out = folder.path().join(predictor.name());
        let flag = AtomicBool::new(false);
        let workspace = Workspace::create(&out).unwrap();
        let cancelled = job.prepare(&model, &workspace, &Monitor::new(&CancelAt(&flag), &flag));
        assert!(cancelled.err().is_some_and(|e| e.is_cancelled()));
        assert!(matches!(Workspace::create(&out), Err(PrintError::Checkpoint(_))), "the job's own claim");
        drop(workspace);
        assert!(matches!(Workspace::create(&out), Err(PrintError::Interrupted { .. })));

        let mut other = settings;
        other.refine.coloured_depth_mm = 1.5;
        let refused =
            PrintJob::new(other).unwrap().prepare(&model, &Workspace::resume(&out), &Monitor::silent());
        let refused = refused.err().unwrap().to_string();
        assert!(refused.contains("settings.refine.coloured_depth_mm was 2.0 and is 1.5"), "{refused}");

        let file = Workspace::folder_of(&out).join("refinement.bin");
        let kept = std::fs::read(&file).unwrap();
        std::fs::write(&file, &kept[..kept.len() - 9]).unwrap();
        let refused = job.prepare(&model, &Workspace::resume(&out), &Monitor::silent());
        let refused = refused.err().unwrap().to_string();
        assert!(refused.contains("refinement.bin: is damaged") && refused.contains("remove "), "{refused}");
        std::fs::write(&file, kept).unwrap();

        let workspace = Workspace::resume(&out);
        assert!(workspace.has_checkpoint());
        let resumed = job.prepare(&model, &workspace, &Monitor::silent()).unwrap();
        workspace.finish().unwrap();
        assert!(!Workspace::folder_of(&out).exists());
        assert!(resumed.refined.labels == whole.refined.labels, "{predictor:?}");
        assert!(resumed.refined.unrefined == whole.refined.unrefined);
        assert_eq!(resumed.judged.evaluation, whole.judged.evaluation);
        let errors = |p: &Prepared| -> Vec<_> {
            p.refined.report.iterations.iter().map(|i| (i.target, i.printable_target, i.smoothed)).collect()
        };
        assert_eq!(errors(&resumed), errors(&whole));
    }
}

#[test]
fn bad_settings_are_named() {
    let refusal = |change: &dyn Fn(&mut PrintSettings)| {
        let mut s = settings(5.0);
        change(&mut s);
        PrintJob::new(s).err().unwrap().to_string()
    };
    assert!(refusal(&|s| s.spp = Some(0)).contains("spp"));
    assert!(refusal(&|s| s.gradient_spp = 0.0).contains("paths of the derivative"));
    assert!(refusal(&|s| s.refine.coloured_depth_mm = -1.0).contains("coloured_depth_mm"));
    assert!(refusal(&|s| s.refine.residual_blur_mm = 5.0).contains("residual_blur_mm"));
    assert!(refusal(&|s| s.judge.point_passes = 3).contains("point_passes"));
    for mm in [0.5, f64::NAN, f64::INFINITY] {
        assert!(refusal(&|s| s.section_mm = Some(mm)).contains("section_mm"));
    }
    assert!(refusal(&|s| s.printer = s.printer.clone().with_max_materials(3).unwrap()).contains("takes 3"));
    let too_tall = PrintJob::new(settings(300.0)).unwrap();
    let refused = too_tall.prepare(
        &patched_ball(),
        &Workspace::none(),
        &Monitor::new(&Silent, &AtomicBool::new(false)),
    );
    assert!(refused.err().unwrap().to_string().contains("300 x 300 x 300 mm"));
}
