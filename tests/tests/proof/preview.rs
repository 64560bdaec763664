//! Previews: the halftone that a job starts from, coarse first, with figures that are the report's.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use pellucid::job::{Preview, PreviewDetail, ProofFiles};
use pellucid::mesh::{Model, Scale};
use pellucid::stage::{Observer, Stage};
use pellucid::{Monitor, PrintError, PrintJob, PrintSettings};
use pellucid_tests::{label_digest, patched_ball};
use serde_json::Value;

use crate::PRINT;
use crate::figures::check_figures;

fn job(height_mm: f64) -> PrintJob {
    PrintJob::new(PrintSettings {
        scale: Scale::HeightMm(height_mm),
        proof_edge: 16,
        ..PrintSettings::default()
    })
    .unwrap()
}

/// Writes a preview with its page and returns page and report.
pub fn written(preview: &Preview, folder: &Path) -> (String, Value) {
    let files = ProofFiles { html: true, glb: false };
    preview.write(files, folder, true, &Monitor::silent()).unwrap();
    let text = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    (text("preview.html"), serde_json::from_str(&text("preview.json")).unwrap())
}

pub fn of_a_ball(height_mm: f64) -> Preview {
    job(height_mm).preview(&patched_ball(), |_, _| Ok(()), &Monitor::silent()).unwrap()
}

#[test]
fn a_preview_is_of_the_halftone_that_a_job_starts_from() {
    let preview = of_a_ball(2.0);
    let unrefined = &PRINT.prepared.refined.unrefined;
    assert_eq!(label_digest(&preview.unrefined), label_digest(unrefined));
    // The network beside paths: a few hundredths of light, as its report says itself.
    let judged = &PRINT.prepared.judged.appearance[0];
    let squares = preview
        .appearance
        .iter()
        .zip(judged)
        .map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f32>());
    let rmse = (squares.sum::<f32>() / (3 * judged.len()) as f32).sqrt();
    assert!(rmse < 0.08 && preview.picture.rmse < 0.06, "{rmse} {:?}", preview.picture);
    let folder = tempfile::tempdir().unwrap();
    let (mut html, report) = written(&preview, &folder.path().join("preview"));
    assert_eq!(report["thin"], PRINT.json("report.json")["thin"]);
    assert_eq!(report["out_of_gamut"], PRINT.json("report.json")["refinement"]["out_of_gamut"]);
    assert!(html.contains("Preview before refinement") && !html.contains("the finer one follows"));
    let figures = check_figures(&mut html, |from| {
        let pointer = from.trim_start_matches("report").replace('.', "/");
        report.pointer(&pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("no number {from}"))
    });
    assert!(figures > 15, "{figures}");
    assert!(html.contains("Light mixes under the surface"), "what refinement is for");
}

/// Counts warnings.
#[derive(Default)]
struct Warned(std::sync::Mutex<Vec<String>>);

impl Observer for Warned {
    fn warn(&self, message: &str) {
        self.0.lock().unwrap().push(message.to_owned());
    }
}

#[test]
fn a_coarse_one_comes_first_and_says_about_the_same() {
    let (warned, never) = (Warned::default(), AtomicBool::new(false));
    let monitor = Monitor::new(&warned, &never);
    let mut coarse = None;
    let full = job(8.0)
        .preview(
            &patched_ball(),
            |preview, monitor| {
                assert!(monitor.times().iter().any(|t| t.stage == Stage::Predict.name()));
                coarse = Some((preview.detail, preview.report(monitor), preview.appearance.len()));
                Ok(())
            },
            &monitor,
        )
        .unwrap();
    let (detail, report, points) = coarse.unwrap();
    assert_eq!((detail, full.detail), (PreviewDetail::Coarse, PreviewDetail::Full));
    assert!(points * 8 < full.appearance.len(), "{points} of {}", full.appearance.len());
    let (a, b) = (report, full.report(&monitor));
    assert!((a.error.mean / b.error.mean - 1.0).abs() < 0.4, "{:?} {:?}", a.error, b.error);
    assert!((a.out_of_gamut - b.out_of_gamut).abs() < 0.05, "{} {}", a.out_of_gamut, b.out_of_gamut);
    assert!((0..3).all(|i| (a.extent_mm[i] - b.extent_mm[i]).abs() < 1e-9));
    let warnings = warned.0.lock().unwrap();
    assert!(warnings.iter().enumerate().all(|(i, w)| !warnings[..i].contains(w)), "{warnings:?}");
}

#[test]
fn a_small_print_has_no_coarse_one_and_the_callers_error_ends_the_job() {
    let called = |_: &Preview, _: &Monitor<'_>| Err(PrintError::Cancelled);
    assert!(job(1.0).preview(&patched_ball(), called, &Monitor::silent()).is_ok());
    assert!(job(8.0).preview(&patched_ball(), called, &Monitor::silent()).is_err_and(|e| e.is_cancelled()));
}

#[test]
fn an_open_mesh_is_shown_where_it_was_closed() {
    let ball = patched_ball();
    let kept = ball.triangles()[6..].to_vec();
    let materials = ball.materials().to_vec();
    let open = Model::new("open", ball.vertices().to_vec(), kept, materials, Vec::new()).unwrap();
    let preview = job(2.0).preview(&open, |_, _| Ok(()), &Monitor::silent()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (html, report) = written(&preview, &folder.path().join("preview"));
    assert!(html.contains("data-show=\"places:holes\""));
    // Six of the triangles around the upper pole.
    let hole = report["mesh"]["places"]["holes"][0].as_array().unwrap();
    let z = hole[2].as_f64().unwrap();
    assert!((1.9..=2.0).contains(&z), "{hole:?}");
}
