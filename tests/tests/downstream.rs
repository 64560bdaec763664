//! What another Rust tool does with the libraries, in at most 25 lines each: the whole job, a predictor and an ink model
//! of its own, a volume from an array, 31 channels, and the slices of a foreign tool.

mod own;
#[path = "../../crates/pellucid/examples/own_predictor.rs"]
#[allow(dead_code, reason = "an example has a main of its own")]
mod own_predictor;

use std::path::Path;
use std::sync::Arc;

use ndarray::Array3;
use own_predictor::MeanAlbedo;
use pellucid::color::{MixtureModel, spectrum::Illuminant};
use pellucid::core::Control;
use pellucid::mesh::Scale;
use pellucid::predict::{Changed, Draw, MonteCarlo, Object, Pass, Predictor};
use pellucid::refine::Effort;
use pellucid::slice::{ImageStack, PrintTarget, list_images, read_images};
use pellucid::voxel::{Frame, LabelGrid, MaterialTable, Pitch, Surface, SurfaceOptions};
use pellucid::{Monitor, PrintJob, PrintSettings, Workspace};
use pellucid_tests::{patched_ball, spectral_cmykw};

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn small() -> PrintSettings {
    let judge = Effort { points: 300, ..Effort::default() };
    let mut settings =
        PrintSettings { scale: Scale::HeightMm(1.5), spp: Some(4), judge, ..PrintSettings::default() };
    settings.refine.iterations = Some(2);
    settings
}

#[test]
fn the_whole_job() -> Outcome {
    let out = tempfile::tempdir()?;
    let job = PrintJob::new(PrintSettings { seed: 3, ..small() })?;
    let monitor = Monitor::silent();
    let prepared = job.prepare(&patched_ball(), &Workspace::none(), &monitor)?;
    let report = prepared.write(&out.path().join("print"), false, &monitor)?;
    assert!(
        report.evaluation.refined.voxel.printable.mean < report.evaluation.unrefined.voxel.printable.mean
    );
    Ok(())
}

#[test]
fn a_predictor_of_ones_own() -> Outcome {
    let job = PrintJob::new(small())?;
    let (workspace, monitor) = (Workspace::none(), Monitor::silent());
    let prepared = job.prepare_with(&MeanAlbedo { reach: 1 }, &patched_ball(), &workspace, &monitor)?;
    assert_eq!(prepared.record.predictor.name, "mean albedo");
    let iterations = &prepared.refined.report.iterations;
    assert!(iterations[2].smoothed.mean < iterations[0].smoothed.mean);
    Ok(())
}

#[test]
fn an_ink_model_of_ones_own() -> Outcome {
    let job = PrintJob::new(small())?;
    let (workspace, monitor) = (Workspace::none(), Monitor::silent());
    let placed = job.place(&patched_ball(), &monitor)?;
    let mut aimed = job.aim(placed, &monitor)?;
    aimed.ink = Arc::new(own::BlackAndWhite { black: 4, white: 5 });
    let refined = job.refine(&aimed, &workspace, &monitor)?;
    let counts = refined.labels.histogram();
    assert!(counts[1..4] == [0; 3] && counts[4] > 0);
    Ok(())
}

#[test]
fn a_volume_from_an_array() -> Outcome {
    // A plate in the order [z][y][x], solid where the array is not 0.
    let solid = Array3::from_shape_fn((20, 10, 30), |(z, y, x)| u8::from(z < 18 && y < 9 && x < 28));
    let job = PrintJob::new(small())?;
    let frame = Frame::new([0.0; 3], job.settings().printer.pitch(), [30, 10, 20])?;
    let labels = LabelGrid::from_array(frame, solid.view())?;
    let color = |[x, _, _]: [u32; 3]| if x < 15 { [0.8, 0.1, 0.1] } else { [0.1, 0.2, 0.7] };
    let (workspace, monitor) = (Workspace::none(), Monitor::silent());
    let prepared = job.prepare_volume("plate", &labels, color, &workspace, &monitor)?;
    let back: Array3<u8> = prepared.refined.labels.to_array()?;
    assert!(back.iter().zip(&solid).all(|(label, solid)| (*label != 0) == (*solid != 0)));
    Ok(())
}

#[test]
fn thirty_one_channels() -> Outcome {
    let settings = PrintSettings { materials: spectral_cmykw(), illuminant: Illuminant::D50, ..small() };
    let monitor = Monitor::silent();
    let prepared = PrintJob::new(settings)?.prepare(&patched_ball(), &Workspace::none(), &monitor)?;
    assert_eq!(prepared.aimed.viewing.channels(), 31);
    let evaluation = &prepared.judged.evaluation;
    assert!(evaluation.refined.voxel.printable.mean < evaluation.unrefined.voxel.printable.mean);
    Ok(())
}

#[test]
fn slices_of_a_foreign_tool() -> Outcome {
    let folder = own::foreign_stack(Path::new("layer"))?;
    let (printer, control) = (PrintTarget::j750(), Control::none());
    let stack = ImageStack::for_target(&printer, &MaterialTable::cmykw())?;
    let labels = read_images(&list_images(folder.path(), "layer*.png")?, &stack, &control)?;
    let surface = Surface::extract(&labels, &SurfaceOptions::default(), &control)?;
    let object = Arc::new(Object::new(surface, MaterialTable::cmykw(), 1.5)?);
    let mut bound = MonteCarlo::new(16)?.bind(object.clone())?;
    bound.update(&labels, Changed::Unknown, &control)?;
    let (points, mut radiance) = (object.points(), vec![0.0; object.surface().len() * 3]);
    bound.predict(&points, Draw::new(0, Pass::Proof), &mut radiance, &control)?;
    assert!(radiance.iter().all(|l| (0.0..=1.5).contains(l)) && radiance.iter().any(|l| *l > 0.1));
    Ok(())
}

#[test]
fn a_mixture_model_gives_its_viewing() -> Outcome {
    let model = MixtureModel::new(&MaterialTable::cmykw(), "white", 1.5)?;
    assert_eq!(model.viewing().channels(), 3);
    assert!(Pitch::j750().mm()[2] < 0.03);
    Ok(())
}
