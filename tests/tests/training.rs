//! Training and judging a network over the public API.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use pellucid::dataset::{Halftone, LabelledSet, Recipe, ShapeClass, Split};
use pellucid::rpnn::train::{TrainSettings, Trainer};
use pellucid::rpnn::{Precision, Variant};
use pellucid::training::{
    self, Outcome, RunSettings, STATE_FILE, TrainingError, TrainingSet, WEIGHTS_FILE, judge_network,
    provenance, validation_set,
};
use pellucid::voxel::{Control, MaterialTable, Pitch};

fn recipe() -> Recipe {
    let split = |name: &str, volumes, points, density| Split {
        name: name.into(),
        volumes,
        points,
        spp: 16,
        std_error: None,
        shapes: vec![(ShapeClass::Sphere, 1.0), (ShapeClass::Cube, 1.0)],
        density,
        other_inks: None,
        neighbours: None,
        pale: None,
        halftone: Halftone::Ranked,
    };
    Recipe {
        name: "small".into(),
        seed: 4,
        pitch: Pitch::new([0.08, 0.09, 0.06]).unwrap(),
        size_mm: [1.0, 1.5],
        large_mm: 2.0,
        large_share: 0.0,
        refractive_index: 1.5,
        splits: vec![split("train", 6, 8, 2.0), split("held-out", 3, 5, 2.0)],
    }
}

fn new_trainer() -> Trainer {
    let settings = TrainSettings {
        variant: Variant::SharedLevels,
        steps: 7,
        batch: 16,
        warm_up: 1,
        ..TrainSettings::default()
    };
    Trainer::new(settings).unwrap()
}

/// Runs to the end or until cancelled; returns the outcome and the validations' errors.
fn run(trainer: &mut Trainer, folder: &Path, control: &Control<'_>) -> (Outcome, Vec<f64>) {
    let set = TrainingSet::of_recipe(recipe(), "train", MaterialTable::cmykw()).unwrap();
    let mut options = set.options(trainer.settings().batch, trainer.settings().seed).unwrap();
    options.window = 2;
    let header = set.header().clone();
    let validation = validation_set("held-out", &header, &Control::none()).unwrap();
    let settings =
        RunSettings { folder: folder.to_owned(), checkpoint: Duration::from_secs(600), minutes: None };
    let mut errors = Vec::new();
    let outcome = training::run(
        trainer,
        set.into_stream(options.clone()).unwrap(),
        Some(&validation),
        &settings,
        &|trainer| Ok(provenance(trainer, &header, &options, "train")?),
        &mut |_, score, _| errors.push(score.rmse),
        control,
    );
    (outcome.unwrap(), errors)
}

#[test]
fn a_stopped_and_resumed_run_leaves_the_same_weights() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole");
    let (outcome, errors) = run(&mut new_trainer(), &whole, &Control::none());
    assert_eq!((outcome, errors.len()), (Outcome::Finished, 1));
    assert!(errors[0] > 0.0 && errors[0] < 1.0);

    let parts = folder.path().join("parts");
    let stop = AtomicBool::new(false);
    let third = |done: u64, _: u64| stop.store(done == 3, Ordering::Relaxed);
    let control = Control::none().with_cancel(&stop).with_progress(&third);
    let mut trainer = new_trainer();
    assert_eq!(run(&mut trainer, &parts, &control), (Outcome::Stopped, vec![]));
    let steps = trainer.steps_done();
    assert!((3..7).contains(&steps), "{steps}");
    let mut resumed = Trainer::resume(&parts.join(STATE_FILE)).unwrap();
    assert_eq!(resumed.steps_done(), steps);
    assert_eq!(run(&mut resumed, &parts, &Control::none()), (Outcome::Finished, errors));
    let bytes = |folder: &Path| std::fs::read(folder.join(WEIGHTS_FILE)).unwrap();
    assert_eq!(bytes(&whole), bytes(&parts));
}

#[test]
fn weights_say_what_they_were_trained_for_and_are_judged_on_it() {
    let folder = tempfile::tempdir().unwrap();
    let (_, errors) = run(&mut new_trainer(), folder.path(), &Control::none());
    let network = pellucid::rpnn::file::load(&folder.path().join(WEIGHTS_FILE)).unwrap();
    let provenance = &network.provenance;
    assert_eq!(provenance.pitch_mm, [0.08, 0.09, 0.06]);
    let table = MaterialTable::cmykw();
    let most = table.materials().iter().flat_map(|m| &m.sigma_s).copied().fold(0.0, f32::max);
    assert!((provenance.sigma_s_range[1] / f64::from(most) - 2.0).abs() < 1e-6, "twice as dense");
    assert!(provenance.history.contains("train") && provenance.history.contains("7 of 7 steps"));

    let header = TrainingSet::of_recipe(recipe(), "held-out", table).unwrap().header().clone();
    let set = LabelledSet::label(&header, &Control::none()).unwrap();
    let judge =
        |set: &LabelledSet, control: &Control<'_>| judge_network(&network, Precision::F32, set, control);
    let judgement = judge(&set, &Control::none()).unwrap();
    // The run's own validation saw the same weights and samples.
    let rmse = judgement.whole.score.rmse();
    assert!((rmse - errors[0]).abs() < 1e-6, "{rmse} {}", errors[0]);
    assert_eq!(judgement.classes.iter().map(|(_, errors)| errors.score.count()).sum::<u64>(), 3 * 5 * 3);

    let stop = AtomicBool::new(true);
    let error = judge(&set, &Control::none().with_cancel(&stop)).unwrap_err();
    assert!(matches!(error, TrainingError::Cancelled));
    let mut other = header;
    other.recipe.refractive_index = 1.3;
    let error = judge(&LabelledSet::label(&other, &Control::none()).unwrap(), &Control::none()).unwrap_err();
    assert!(error.to_string().contains("refractive index: 1.3; the network was trained for 1.5"), "{error}");
}
