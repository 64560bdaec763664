//! A thread that panics in the middle of a stage, as an observer's or a predictor's bug may make it: the caller gets the panic,
//! no half print is left, and the job goes on from what was kept, to the same bytes.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use pellucid::mesh::Scale;
use pellucid::refine::Effort;
use pellucid::stage::{Observer, Stage};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_tests::patched_ball;

/// Counts the calls of every stage, and panics at one of them.
#[derive(Default)]
struct Breaking {
    at: Option<(Stage, u32)>,
    calls: Mutex<HashMap<Stage, u32>>,
}

impl Observer for Breaking {
    fn progress(&self, stage: Stage, _: u64, _: u64) {
        let count = {
            let mut calls = self.calls.lock().unwrap();
            let count = calls.entry(stage).or_default();
            *count += 1;
            *count
        };
        assert!(self.at != Some((stage, count)), "a thread of {} breaks", stage.name());
    }
}

fn job() -> PrintJob {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(1.2),
        strategy: StrategyKind::SurfaceFirst,
        spp: Some(4),
        judge: Effort { points: 20, point_passes: 2, surface_passes: 2 },
        judge_spp: 1,
        judge_point_spp: 1,
        proof_edge: 32,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(3);
    PrintJob::new(settings).unwrap()
}

fn prepare(out: &Path, observer: &Breaking) -> Result<(), PrintError> {
    let never = AtomicBool::new(false);
    let monitor = Monitor::new(observer, &never);
    let workspace = Workspace::resume(out);
    let prepared = job().prepare(&patched_ball(), &workspace, &monitor)?;
    prepared.write(out, false, &monitor)?;
    workspace.finish()
}

/// Slices and manifest.
fn print(out: &Path) -> Vec<Vec<u8>> {
    let mut paths: Vec<_> =
        std::fs::read_dir(out.join("slices")).unwrap().map(|file| file.unwrap().path()).collect();
    paths.push(out.join("manifest.json"));
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn a_panic_in_any_stage_leaves_no_half_print_and_the_job_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let calm = Breaking::default();
    let whole = folder.path().join("calm");
    prepare(&whole, &calm).unwrap();
    let wanted = print(&whole);
    let calls = calm.calls.into_inner().unwrap();
    // Before anything is kept, while a refinement goes on, after it, and while the print is written.
    for stage in [Stage::Voxelise, Stage::Refine, Stage::Judge, Stage::Slices] {
        let count = *calls.get(&stage).expect("the stage tells of its progress");
        let name = stage.name();
        let out = folder.path().join(name);
        let breaking = Breaking { at: Some((stage, count.div_ceil(2))), ..Breaking::default() };
        let panic = catch_unwind(AssertUnwindSafe(|| prepare(&out, &breaking))).expect_err(name);
        let told = panic.downcast_ref::<String>().is_some_and(|text| text.contains("breaks"));
        assert!(told && !out.exists(), "{name}");
        let left: Vec<_> =
            std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(left.iter().all(|file| !file.to_string_lossy().starts_with('.')), "{name}: {left:?}");
        prepare(&out, &Breaking::default()).unwrap();
        assert!(print(&out) == wanted, "{name}");
        assert!(!Workspace::folder_of(&out).exists(), "{name}");
    }
}
