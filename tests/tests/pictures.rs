//! Golden pictures: small contact sheets that stay as they are. `PELLUCID_BLESS=1` writes them anew; look at them then.
//!
//! Paths are the same everywhere and the network is the same to its last digits, so that what differs is what was changed.

use std::path::{Path, PathBuf};

use pellucid::job::ProofFiles;
use pellucid::mesh::Scale;
use pellucid::refine::Effort;
use pellucid::{Monitor, PrintJob, PrintSettings, StrategyKind, Workspace};
use pellucid_tests::patched_ball;

/// Mean difference of 8-bit codes that rounding may make.
const MEAN: f64 = 0.25;
/// Share of codes that may differ by more than [`FAR`].
const SHARE: f64 = 0.002;
const FAR: u8 = 6;

fn job() -> PrintJob {
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(2.5),
        strategy: StrategyKind::SurfaceFirst,
        spp: Some(4),
        seed: 5,
        judge: Effort { points: 20, point_passes: 2, surface_passes: 2 },
        judge_spp: 3,
        judge_point_spp: 8,
        proof_edge: 48,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(2);
    PrintJob::new(settings).unwrap()
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(name)
}

fn pixels(file: &Path) -> (u32, Vec<u8>) {
    let file = std::fs::File::open(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, pixels)
}

/// Holds pictures of a folder to the golden ones, or blesses them.
fn check(folder: &Path, names: &[&str]) {
    for name in names {
        if std::env::var_os("PELLUCID_BLESS").is_some() {
            std::fs::create_dir_all(golden("")).unwrap();
            std::fs::copy(folder.join(name), golden(name)).unwrap();
        }
        let (found, wanted) = (pixels(&folder.join(name)), pixels(&golden(name)));
        assert_eq!((found.0, found.1.len()), (wanted.0, wanted.1.len()), "{name}: another size");
        let off: Vec<u8> = found.1.iter().zip(&wanted.1).map(|(a, b)| a.abs_diff(*b)).collect();
        let mean = off.iter().map(|&v| f64::from(v)).sum::<f64>() / off.len() as f64;
        let far = off.iter().filter(|&&v| v > FAR).count() as f64 / off.len() as f64;
        assert!(
            mean <= MEAN && far <= SHARE,
            "{name}: mean difference {mean:.3}, {far:.4} far off; PELLUCID_BLESS=1 blesses"
        );
    }
}

#[test]
fn a_prints_pictures_stay_as_they_are() {
    let prepared = job().prepare(&patched_ball(), &Workspace::none(), &Monitor::silent()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("print");
    prepared.write(&out, false, &Monitor::silent()).unwrap();
    check(&out, &["proof.png", "error.png"]);
}

#[test]
fn a_previews_picture_stays_as_it_is() {
    let preview = job().preview(&patched_ball(), |_, _| Ok(()), &Monitor::silent()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("preview");
    preview.write(ProofFiles::default(), &out, false, &Monitor::silent()).unwrap();
    check(&out, &["preview.png"]);
}
