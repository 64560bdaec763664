//! The main job over the public API: a model in, a complete output folder out.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use pellucid::mesh::voxelise::Scale;
use pellucid::stage::{Observer, Silent, Stage};
use pellucid::voxel::Control;
use pellucid::{PredictorKind, Prepared, PrintError, PrintJob, PrintSettings};
use pellucid_tests::patched_ball;

fn settings(height_mm: f64) -> PrintSettings {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(height_mm),
        spp: 16,
        seed: 3,
        evaluation_points: 3000,
        evaluation_spp: 256,
        proof_spp: 8,
        proof_edge: 64,
        ..PrintSettings::default()
    };
    settings.refine.iterations = 4;
    settings
}

fn prepare(settings: PrintSettings) -> Prepared {
    let job = PrintJob::new(settings).unwrap();
    job.prepare(&patched_ball(), &Silent, &AtomicBool::new(false)).unwrap()
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
    let grid = prepared.grid.clone();
    assert!(prepared.unrefined != grid, "refinement changes labels");
    let report = prepared.write(&out, false, &Silent, &AtomicBool::new(false)).unwrap();

    let (back, manifest) = pellucid::slice::read_stack(&out, &Control::none()).unwrap();
    assert!(back == grid);
    let counts = grid.histogram();
    assert_eq!(manifest.materials.iter().map(|m| m.voxels).sum::<u64>(), counts[1..].iter().sum::<u64>());
    for file in ["manifest.json", "report.json", "proof.png", "proof.exr"] {
        assert!(out.join(file).metadata().unwrap().len() > 0, "{file}");
    }
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(json["refinement"]["iterations"].as_array().unwrap().len(), 5);
    assert_eq!(json["surface_voxels"], report.surface_voxels);
    assert!(json["mesh"]["closed"].as_bool().unwrap());

    // Judged by fresh paths, patches of this size should lose a good part of their error.
    let e = report.evaluation;
    assert!(e.refined.mapped.mean < 0.85 * e.unrefined.mapped.mean, "{e:?}");

    let exists = prepare_error(&out);
    assert!(exists.to_string().contains("print"), "{exists}");
}

fn prepare_error(out: &Path) -> PrintError {
    PrintJob::new(settings(3.0)).unwrap().check_output(out, false).unwrap_err()
}

#[test]
fn slices_do_not_depend_on_the_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let out = folder.path().join(threads.to_string());
        pool.install(|| {
            let mut s = settings(3.0);
            s.evaluation_points = 50;
            prepare(s).write(&out, false, &Silent, &AtomicBool::new(false)).unwrap();
        });
        slices(&out)
    };
    let (one, three) = (run(1), run(3));
    assert!(one.len() > 100);
    assert!(one == three);
}

#[test]
fn the_network_refines_too_and_path_tracing_agrees_that_it_helped() {
    let mut s = settings(4.0);
    s.predictor = PredictorKind::Rpnn;
    s.refine.iterations = 3;
    let prepared = prepare(s.clone());
    let report = prepared.report();
    assert_eq!((report.predictor.as_str(), report.outside_training), ("rpnn", 0));
    let e = &report.evaluation;
    assert!(e.refined.mapped.mean < 0.9 * e.unrefined.mapped.mean, "{e:?}");

    // It was trained for one boundary; another is refused before any prediction.
    s.boundary = pellucid::trace::Boundary::Matched;
    let job = PrintJob::new(s).unwrap();
    let refused = job.prepare(&patched_ball(), &Silent, &AtomicBool::new(false)).err().unwrap();
    assert!(refused.to_string().contains("refractive index"), "{refused}");
}

/// Cancels when a stage begins.
struct CancelAt<'a> {
    stage: Stage,
    flag: &'a AtomicBool,
    begun: AtomicU32,
}

impl Observer for CancelAt<'_> {
    fn begin(&self, stage: Stage) {
        self.begun.fetch_add(1, Ordering::Relaxed);
        if stage == self.stage {
            self.flag.store(true, Ordering::Relaxed);
        }
    }
    fn progress(&self, _: Stage, _: u64, _: u64) {}
    fn end(&self, _: Stage) {}
    fn warn(&self, _: &str) {}
}

#[test]
fn cancelling_any_stage_ends_the_job_and_leaves_nothing() {
    let model = patched_ball();
    let folder = tempfile::tempdir().unwrap();
    for stage in
        [Stage::Voxelise, Stage::Surface, Stage::Nearest, Stage::Target, Stage::Refine, Stage::Evaluate]
    {
        let flag = AtomicBool::new(false);
        let observer = CancelAt { stage, flag: &flag, begun: AtomicU32::new(0) };
        let result = PrintJob::new(settings(2.0)).unwrap().prepare(&model, &observer, &flag);
        assert!(result.err().is_some_and(|e| e.is_cancelled()), "{stage:?}");
        assert!(observer.begun.load(Ordering::Relaxed) >= 1);
    }
    let flag = AtomicBool::new(false);
    let observer = CancelAt { stage: Stage::Slices, flag: &flag, begun: AtomicU32::new(0) };
    let mut s = settings(2.0);
    s.evaluation_points = 10;
    let result = prepare(s).write(&folder.path().join("print"), false, &observer, &flag);
    assert!(result.err().is_some_and(|e| e.is_cancelled()));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn bad_settings_are_named() {
    let mut s = settings(5.0);
    s.spp = 0;
    assert!(PrintJob::new(s).err().unwrap().to_string().contains("spp"));
    let mut s = settings(5.0);
    s.refine.coloured_depth_mm = -1.0;
    assert!(PrintJob::new(s).err().unwrap().to_string().contains("coloured_depth_mm"));
    let mut s = settings(5.0);
    s.target = s.target.with_max_materials(3).unwrap();
    assert!(PrintJob::new(s).err().unwrap().to_string().contains("takes 3"));
    let too_tall =
        PrintJob::new(settings(300.0)).unwrap().prepare(&patched_ball(), &Silent, &AtomicBool::new(false));
    assert!(too_tall.is_err());
}
