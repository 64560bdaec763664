//! The labels of one small job, pinned: a change that is meant to keep them shows at once when it does not.
//!
//! Those of surface-first were blessed anew twice: when layers without voxels ceased to take a share of the demand, which
//! concerns one layer in a thousand at this pitch, and when the surface's smoothing became as wide along y, the coarse
//! axis, as along the others. Those of descent last when its fine steps came to take twice the paths of its coarse ones.

use pellucid::mesh::Scale;
use pellucid::refine::Effort;
use pellucid::slice::PrintTarget;
use pellucid::{Monitor, PredictorKind, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_tests::{label_digest, patched_ball};

/// The printer's profile as it is written here, so that a better one of the library's changes nothing.
const PRINTER: &str = r#"{
  "name": "golden", "dpi": [600.0, 300.0, 940.0], "build_space_mm": [490.0, 390.0, 200.0],
  "max_materials": 6, "min_layers": 30, "row_order": "highest_y_first", "background": [0, 0, 0, 0],
  "palette": {
    "cyan": [0, 174, 239, 255], "magenta": [236, 0, 140, 255], "yellow": [255, 221, 0, 255],
    "black": [35, 31, 32, 255], "white": [255, 255, 255, 255]
  }
}"#;

fn digests(change: impl Fn(&mut PrintSettings)) -> [u64; 2] {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(3.0),
        printer: PrintTarget::from_json(PRINTER).unwrap(),
        predictor: PredictorKind::MonteCarlo,
        spp: Some(8),
        seed: 5,
        judge: Effort { points: 20, point_passes: 2, surface_passes: 2 },
        judge_spp: 1,
        judge_point_spp: 1,
        proof_edge: 16,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(3);
    change(&mut settings);
    let job = PrintJob::new(settings).unwrap();
    let prepared = job.prepare(&patched_ball(), &Workspace::none(), &Monitor::silent()).unwrap();
    [&prepared.refined.unrefined, &prepared.refined.labels].map(label_digest)
}

#[test]
fn labels_of_a_small_job_by_surface_first_stay_as_they_are() {
    let digests = digests(|settings| settings.strategy = StrategyKind::SurfaceFirst);
    assert_eq!(
        digests,
        [10_201_966_626_067_112_231, 8_767_213_569_798_915_775],
        "unrefined and refined labels"
    );
}

#[test]
fn labels_of_a_small_job_by_descent_stay_as_they_are() {
    let digests = digests(|settings| {
        settings.descent.opening_steps = 1;
        settings.refine.iterations = Some(4);
    });
    assert_eq!(
        digests,
        [10_201_966_626_067_112_231, 9_666_508_466_921_172_306],
        "unrefined and refined labels"
    );
}
