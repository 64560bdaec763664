//! `proof.html` and `proof.glb` of a prepared print: the page's figures are the report's, it works in a browser, and the
//! model reads back.

mod browser;
mod figures;
mod lights;
mod model;
mod preview;
mod webdriver;

use std::path::PathBuf;
use std::sync::LazyLock;

use pellucid::job::ProofFiles;
use pellucid::mesh::Scale;
use pellucid::refine::Effort;
use pellucid::{Monitor, Prepared, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_tests::patched_ball;
use serde_json::Value;

/// A print with its page.
struct Print {
    prepared: Prepared,
    folder: tempfile::TempDir,
}

impl Print {
    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join("print").join(name)
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.file(name)).unwrap()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    /// A number by its place, such as `report.thin.least_mm`.
    fn figure(&self, from: &str) -> f64 {
        let (file, path) = from.split_once('.').unwrap();
        let pointer = format!("/{}", path.replace('.', "/"));
        let value = self.json(&format!("{file}.json")).pointer(&pointer).and_then(Value::as_f64);
        value.unwrap_or_else(|| panic!("{file}.json has no number {path}"))
    }
}

/// The ball at 2 mm: thin enough for warnings, and quickly made.
static PRINT: LazyLock<Print> = LazyLock::new(|| {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(2.0),
        strategy: StrategyKind::SurfaceFirst,
        spp: Some(4),
        judge: Effort { points: 20, point_passes: 2, surface_passes: 2 },
        judge_spp: 2,
        judge_point_spp: 8,
        proof_edge: 16,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(2);
    let job = PrintJob::new(settings).unwrap();
    let prepared = job.prepare(&patched_ball(), &Workspace::none(), &Monitor::silent()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (files, out) = (ProofFiles { html: true, glb: true }, folder.path().join("print"));
    prepared.write_with(files, &out, false, &Monitor::silent()).unwrap();
    Print { prepared, folder }
});

/// A figure as the page writes it: with `digits` decimals, thousands apart or not.
fn shown(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    if text.bytes().any(|b| (b'1'..=b'9').contains(&b)) { text } else { text.replace('-', "") }
}

/// A figure's text without what only eases reading.
fn plain(text: &str) -> String {
    text.replace('\u{202f}', "").replace('\u{2212}', "-")
}
