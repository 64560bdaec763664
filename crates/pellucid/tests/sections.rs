//! A print that is refined in sections: the halftone it starts from is the whole one's, it comes out as good, and an
//! interrupted one goes on where it was.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};

use pellucid::stage::{Observer, Stage};
use pellucid::voxel::{AIR, Frame, LabelGrid};
use pellucid::{Monitor, PredictorKind, PrintJob, PrintSettings, StrategyKind, Workspace};

use common::quick;

/// A leaning pillar with a gap, 6 mm high.
fn pillar(job: &PrintJob) -> LabelGrid {
    let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [36, 12, 220]).unwrap();
    LabelGrid::from_fn(frame, |[x, y, z]| {
        let from = z / 40;
        let gap = (100..115).contains(&z) && y > 5;
        if (from..from + 30).contains(&x) && !gap { 1 } else { AIR }
    })
}

/// The layers at which sections of 2 mm meet: whole tiles.
const PLANES: [u32; 2] = [64, 144];

/// Stripes of the scale of a millimetre across all sections.
fn color([x, _, z]: [u32; 3]) -> [f32; 3] {
    match (z / 30 + x / 16) % 3 {
        0 => [0.75, 0.25, 0.15],
        1 => [0.2, 0.6, 0.8],
        _ => [0.8, 0.75, 0.4],
    }
}

fn settings(strategy: StrategyKind, section_mm: Option<f64>) -> PrintSettings {
    let mut settings = PrintSettings { strategy, section_mm, ..quick() };
    settings.refine.coloured_depth_mm = 0.4;
    // Descent's first steps, Adam's, are as long everywhere: it takes some more to come to what is wanted.
    settings.refine.iterations = Some(if strategy == StrategyKind::Descent { 8 } else { 4 });
    settings.judge_spp = 4;
    settings
}

#[test]
fn sections_start_from_the_whole_halftone_and_end_as_good() {
    for strategy in [StrategyKind::SurfaceFirst, StrategyKind::Descent, StrategyKind::SurfaceColor] {
        let prepared = |section_mm| {
            let job = PrintJob::new(settings(strategy, section_mm)).unwrap();
            let volume = pillar(&job);
            job.prepare_volume("pillar", &volume, color, &Workspace::none(), &Monitor::silent()).unwrap()
        };
        let (whole, parts) = (prepared(None), prepared(Some(2.0)));
        assert!(parts.refined.unrefined == whole.refined.unrefined, "{}", strategy.name());
        assert!(parts.refined.labels != whole.refined.labels);
        let report = &parts.refined.report;
        assert_eq!(report.sections.len(), 3);
        assert_eq!(report.surface_voxels, whole.refined.report.surface_voxels);
        assert_eq!(report.iterations.len(), whole.refined.report.iterations.len());
        // What is below was refined already.
        let apart = report.iterations[0].smoothed.mean / whole.refined.report.iterations[0].smoothed.mean;
        assert!((0.7..1.05).contains(&apart), "{apart}");
        let colors = |refined: &pellucid::job::Refined| refined.colors.as_ref().map(Vec::len);
        assert_eq!(colors(&parts.refined), colors(&whole.refined));
        // Beside the planes where sections meet it is as good as the whole there.
        let beside = |prepared: &pellucid::job::Prepared| {
            let voxels = prepared.aimed.object.surface().voxels();
            let errors = voxels.iter().zip(&prepared.judged.error_parts[1]);
            let near = errors.filter(|(v, _)| PLANES.iter().any(|&plane| v[2].abs_diff(plane) < 12));
            let errors: Vec<f32> = near.map(|(_, parts)| parts.iter().sum()).collect();
            errors.iter().sum::<f32>() / errors.len() as f32
        };
        // Sections end 8 % below to 5 % above the whole: they take other steps along other noise.
        assert!(beside(&parts) < 1.08 * beside(&whole), "{}", strategy.name());
        let error = |prepared: &pellucid::job::Prepared| {
            let evaluation = &prepared.judged.evaluation;
            evaluation.refined.at_0_1_mm.printable.mean / evaluation.unrefined.at_0_1_mm.printable.mean
        };
        let [whole, parts] = [error(&whole), error(&parts)];
        assert!(whole < 0.95 && parts < 1.08 * whole, "{}: {parts} against {whole}", strategy.name());
    }
}

#[test]
fn an_interrupted_section_goes_on() {
    struct CancelAt<'a>(&'a AtomicBool);
    impl Observer for CancelAt<'_> {
        fn progress(&self, stage: Stage, done: u64, total: u64) {
            if stage == Stage::Refine && 2 * done > total {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let settings =
        PrintSettings { predictor: PredictorKind::Auto, ..settings(StrategyKind::Descent, Some(2.0)) };
    let job = PrintJob::new(settings).unwrap();
    let volume = pillar(&job);
    let run = |job: &PrintJob, workspace: &Workspace, monitor: &Monitor<'_>| {
        job.prepare_volume("pillar", &volume, color, workspace, monitor)
    };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("print");
    let flag = AtomicBool::new(false);
    let workspace = Workspace::create(&out).unwrap();
    let cancelled = run(&job, &workspace, &Monitor::new(&CancelAt(&flag), &flag));
    assert!(cancelled.err().is_some_and(|e| e.is_cancelled()));
    drop(workspace);
    let kept = |section: usize| Workspace::folder_of(&out).join(format!("refinement-{section}.bin"));
    assert!(kept(0).exists() && kept(1).exists() && !kept(2).exists());
    let before = std::fs::metadata(kept(0)).unwrap().modified().unwrap();
    let workspace = Workspace::resume(&out);
    let resumed = run(&job, &workspace, &Monitor::silent()).unwrap();
    assert_eq!(std::fs::metadata(kept(0)).unwrap().modified().unwrap(), before, "done again");
    workspace.finish().unwrap();
    assert!(!Workspace::folder_of(&out).exists());
    // Another trial might choose another predictor: it goes by time.
    let predictor = resumed.choice.unwrap().chosen;
    let job = PrintJob::new(PrintSettings { predictor, ..job.settings().clone() }).unwrap();
    let at_once = run(&job, &Workspace::none(), &Monitor::silent()).unwrap();
    assert!(resumed.refined.labels == at_once.refined.labels);
    assert_eq!(resumed.judged.evaluation, at_once.judged.evaluation);
}
