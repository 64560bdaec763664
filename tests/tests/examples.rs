//! The facade's examples do what they say, at toy size.

#![allow(dead_code, reason = "each example has a main of its own")]

#[path = "../../crates/pellucid/examples/before_printing.rs"]
mod before_printing;
#[path = "../../crates/pellucid/examples/look_of_slices.rs"]
mod look_of_slices;
mod own;
#[path = "../../crates/pellucid/examples/own_predictor.rs"]
mod own_predictor;
#[path = "../../crates/pellucid/examples/own_voxels.rs"]
mod own_voxels;
#[path = "../../crates/pellucid/examples/prepare.rs"]
mod prepare;
#[path = "../../crates/pellucid/examples/queue.rs"]
mod queue;

use std::path::{Path, PathBuf};
use std::time::Duration;

use pellucid::mesh::Scale;
use pellucid::refine::Effort;
use pellucid::{PrintSettings, StrategyKind};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn toy() -> PrintSettings {
    let judge = Effort { points: 100, ..Effort::default() };
    let mut settings = PrintSettings {
        scale: Scale::HeightMm(1.5),
        spp: Some(4),
        judge,
        judge_point_spp: 64,
        proof_edge: 16,
        strategy: StrategyKind::SurfaceFirst,
        ..PrintSettings::default()
    };
    settings.refine.iterations = Some(2);
    settings
}

fn model(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/models").join(name)
}

#[test]
fn a_job_leaves_a_print_and_no_checkpoints() -> Outcome {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("print");
    let report = prepare::prepare(&model("octostar.glb"), 1.5, toy(), &out)?;
    assert!(report.layers > 50 && out.join("manifest.json").exists());
    assert_eq!(std::fs::read_dir(folder.path())?.count(), 1);
    Ok(())
}

#[test]
fn a_thin_sheet_is_told_before_it_is_printed() -> Outcome {
    let [thin, thick] = [("plane.glb", 3.0), ("octostar.glb", 6.0)]
        .map(|(name, mm)| before_printing::look(&model(name), mm).map(|outlook| outlook.too_thin));
    let (thin, thick) = (thin?, thick?);
    assert!(thin > 1.5 * thick && thin <= 1.0, "{thin} {thick}");
    Ok(())
}

#[test]
fn own_voxels_are_printed() -> Outcome {
    let folder = tempfile::tempdir()?;
    let report = own_voxels::ball(1.0, toy(), &folder.path().join("print"))?;
    assert_eq!(report.layers, 38);
    assert!(report.surface_voxels > 500);
    Ok(())
}

#[test]
fn a_crude_predictor_still_helps() -> Outcome {
    let [before, after] = own_predictor::refine(&model("octostar.glb"), 1.5, toy())?;
    assert!(after < before, "{before} {after}");
    Ok(())
}

#[test]
fn foreign_slices_make_a_picture() -> Outcome {
    let folder = own::foreign_stack(Path::new("layer"))?;
    let picture = folder.path().join("look.png");
    look_of_slices::draw(folder.path(), "layer*.png", 16, &picture)?;
    let mut reader =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&picture)?)).read_info()?;
    let mut pixels = vec![0; reader.output_buffer_size().ok_or("a picture")?];
    let info = reader.next_frame(&mut pixels)?;
    assert_eq!(info.width.max(info.height), 480);
    // Rows are written from the back to the front, so it is white that faces the viewer, and cyan the left.
    let pixels = pixels.chunks_exact(4).filter(|pixel| pixel[3] > 250);
    let (cyan, others): (Vec<_>, Vec<_>) = pixels.partition(|p| p[1].min(p[2]).saturating_sub(p[0]) > 40);
    let white = others.iter().filter(|p| p[0].abs_diff(p[1]).max(p[1].abs_diff(p[2])) < 20).count();
    assert!(cyan.len() > 500 && white > 5000, "{} cyan, {white} white", cyan.len());
    Ok(())
}

#[test]
fn a_queue_outlives_a_broken_model_and_a_limit() -> Outcome {
    let folder = tempfile::tempdir()?;
    let broken = folder.path().join("broken.glb");
    std::fs::write(&broken, "not a model")?;
    let models = [broken, model("octostar.glb")];
    let hour = Duration::from_secs(3600);
    let outcomes = queue::run(&models, &toy(), hour, folder.path());
    assert!(matches!(&outcomes[..], [queue::Outcome::Failed(_), queue::Outcome::Printed(_)]), "{outcomes:?}");
    let outcomes = queue::run(&models[1..], &toy(), Duration::ZERO, folder.path());
    assert!(matches!(&outcomes[..], [queue::Outcome::Interrupted]), "{outcomes:?}");
    Ok(())
}
