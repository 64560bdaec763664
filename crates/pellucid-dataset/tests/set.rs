//! Files of labelled points: sharded, resumed, verified, damaged.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_dataset::{
    DatasetError, Errors, Halftone, Judgement, LabelledSet, Recipe, STENCIL_VALUES, SetHeader, ShapeClass,
    Shard, Split, generate, info, join, judge, verify,
};
use pellucid_stencil::FirstFlight;
use pellucid_voxel::{Control, MaterialTable, Pitch};
use proptest::prelude::*;

fn header(shard: Shard) -> SetHeader {
    let split = |name: &str, std_error| Split {
        name: name.into(),
        volumes: 5,
        points: 3,
        spp: 64,
        std_error,
        shapes: vec![(ShapeClass::Slab, 1.0), (ShapeClass::Star, 1.0), (ShapeClass::Gyroid, 1.0)],
        density: 1.0,
        other_inks: None,
        neighbours: None,
        pale: None,
        halftone: Halftone::Ranked,
    };
    let recipe = Recipe {
        name: "test".into(),
        seed: 11,
        pitch: Pitch::j750(),
        size_mm: [1.0, 2.0],
        large_mm: 2.0,
        large_share: 0.0,
        refractive_index: 1.5,
        splits: vec![split("fixed", None), split("adaptive", Some(0.05))],
    };
    SetHeader { recipe, split: "adaptive".into(), materials: MaterialTable::cmykw(), shard }
}

fn none() -> Control<'static> {
    Control::none()
}

#[test]
fn shards_together_are_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let whole = generate(folder.path(), &header(Shard::WHOLE), &none()).unwrap();
    let mut parts: Vec<_> = (0..3)
        .map(|i| generate(folder.path(), &header(Shard::new(i, 3).unwrap()), &none()).unwrap())
        .collect();
    parts.reverse();
    let set = LabelledSet::load(&[&whole], &none()).unwrap();
    assert_eq!(set, LabelledSet::load(&parts, &none()).unwrap());
    assert_eq!((set.len(), set.channels(), set.channel(4), set.volume(44)), (45, 3, 1, 4));
    assert!(set.radiance().iter().all(|r| (0.0..=1.0).contains(r)));
    let mut stencils = vec![0.0; 2 * STENCIL_VALUES];
    set.stencils(43, &mut stencils);
    assert!(stencils[STENCIL_VALUES..].iter().any(|&v| v > 0.0));
    let found = info(&whole).unwrap();
    assert_eq!(found.samples, 45);
    assert!(found.rms_std_error < 0.06 && found.max_std_error > 0.0);
    assert!(found.header.recipe.splits[1].shapes.iter().any(|(c, _)| *c == set.class(0)));

    assert!(LabelledSet::load(&parts[1..], &none()).unwrap_err().to_string().contains("needed once"));
    assert!(LabelledSet::load(&[&whole, &parts[0]], &none()).is_err());
    assert!(LabelledSet::load::<&Path>(&[], &none()).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4, "no temporary file stays");
}

#[test]
fn joined_parts_have_the_bytes_of_the_whole() {
    let [folder, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let whole = std::fs::read(generate(other.path(), &header(Shard::WHOLE), &none()).unwrap()).unwrap();
    let part = |i| generate(folder.path(), &header(Shard::new(i, 3).unwrap()), &none()).unwrap();
    let last = [2, 0, 1].map(part)[0].clone();
    std::fs::rename(&last, last.with_extension("away")).unwrap();
    assert!(join(folder.path(), &header(Shard::WHOLE), 3).is_err(), "a part is missing");
    std::fs::rename(last.with_extension("away"), &last).unwrap();
    for _ in 0..2 {
        let joined = join(folder.path(), &header(Shard::WHOLE), 3).unwrap();
        assert!(std::fs::read(joined).unwrap() == whole);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "parts are removed");
    }
}

#[test]
fn a_set_labelled_in_memory_is_the_one_of_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = generate(folder.path(), &header(Shard::WHOLE), &none()).unwrap();
    let labelled = LabelledSet::label(&header(Shard::WHOLE), &none()).unwrap();
    assert_eq!(labelled, LabelledSet::load(&[path], &none()).unwrap());
    let part = LabelledSet::label(&header(Shard::new(1, 3).unwrap()), &none()).unwrap();
    assert_eq!((part.len(), part.volume(0), part.volume(17)), (18, 1, 4));
    let stop = AtomicBool::new(true);
    let error = LabelledSet::label(&header(Shard::WHOLE), &none().with_cancel(&stop)).unwrap_err();
    assert!(matches!(error, DatasetError::Cancelled));
    let mut many = header(Shard::WHOLE);
    many.recipe.splits[1].volumes = u32::MAX;
    let error = LabelledSet::label(&many, &none()).unwrap_err();
    assert!(error.to_string().contains("at most 1000000"), "{error}");
}

#[test]
fn predictions_are_asked_for_in_order() {
    let set = LabelledSet::label(&header(Shard::WHOLE), &none()).unwrap();
    let mut seen = 0;
    let predicted = set
        .predictions(7, &none(), |stencils, flights, out| {
            assert_eq!(flights, &set.flights()[seen..seen + out.len()]);
            let mut own = vec![0.0; stencils.len()];
            set.stencils(seen, &mut own);
            assert_eq!((own, out.len()), (stencils.to_vec(), 7.min(45 - seen)));
            for value in out {
                *value = seen as f32;
                seen += 1;
            }
            Ok::<_, DatasetError>(())
        })
        .unwrap();
    assert_eq!(predicted, (0..45).map(|i| i as f32).collect::<Vec<_>>());
}

#[test]
fn judging_tells_classes_and_channels_apart_and_takes_noise_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = generate(folder.path(), &header(Shard::WHOLE), &none()).unwrap();
    let set = LabelledSet::load(&[path], &none()).unwrap();
    // Off by 0.01, 0.02 and 0.03 in the three channels, by 0.1 more on stars, and by the labels' noise either way.
    let off = |i: usize| {
        let star = if set.class(i) == ShapeClass::Star { 0.1 } else { 0.0 };
        let noise = if (i / 3).is_multiple_of(2) { set.std_error()[i] } else { -set.std_error()[i] };
        0.01 * (1 + i % 3) as f32 + star + noise
    };
    let predicted: Vec<f32> = (0..set.len()).map(|i| set.radiance()[i] + off(i)).collect();
    let judgement = Judgement::of(&set, &predicted).unwrap();
    let check = |errors: &Errors, wanted: &dyn Fn(usize) -> bool| {
        let samples: Vec<usize> = (0..set.len()).filter(|&i| wanted(i)).collect();
        let mean = |value: &dyn Fn(usize) -> f32| {
            samples.iter().map(|&i| f64::from(value(i))).sum::<f64>() / samples.len() as f64
        };
        assert_eq!(errors.score.count(), samples.len() as u64);
        assert!((errors.score.bias() - mean(&off)).abs() < 1e-6, "{errors:?}");
        assert!((errors.absolute.mean - mean(&|i| off(i).abs())).abs() < 1e-6, "{errors:?}");
        let left = (mean(&|i| off(i).powi(2)) - mean(&|i| set.std_error()[i].powi(2))).max(0.0).sqrt();
        assert!((errors.score.rmse() - left).abs() < 1e-5, "{errors:?} {left}");
    };
    check(&judgement.whole, &|_| true);
    assert_eq!(judgement.channels.len(), 3);
    for (channel, errors) in judgement.channels.iter().enumerate() {
        check(errors, &|i| i % 3 == channel);
    }
    let classes: Vec<ShapeClass> = judgement.classes.iter().map(|(class, _)| *class).collect();
    assert!(
        classes.len() >= 2 && classes.contains(&ShapeClass::Star) && classes[0] == set.class(0),
        "{classes:?}"
    );
    for (class, errors) in &judgement.classes {
        check(errors, &|i| set.class(i) == *class);
    }
    let exact = Judgement::of(&set, set.radiance()).unwrap().whole;
    assert_eq!((exact.score.rmse(), exact.score.bias(), exact.absolute.max), (0.0, 0.0, 0.0));
    assert!(
        judgement.whole.absolute.max > 0.02
            && judgement.whole.score.rmse() < judgement.whole.score.raw_rmse()
    );
    assert!(Judgement::of(&set, &predicted[1..]).is_err());
    assert!(Judgement::of(&set, &[f32::NAN; 45]).is_err());
}

#[test]
fn a_predictor_gets_every_stencil_once_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let mut header = header(Shard::WHOLE);
    header.split = "fixed".into();
    header.recipe.splits[0].points = 80; // 1200 samples: more than are predicted at a time
    let path = generate(folder.path(), &header, &none()).unwrap();
    let set = LabelledSet::load(&[path], &none()).unwrap();
    let of_stencil = |stencil: &[f32]| stencil[67 * 2] * 0.01 + stencil[135 * 2] * 0.001;
    let mut all = vec![0.0; set.len() * STENCIL_VALUES];
    set.stencils(0, &mut all);
    let predicted: Vec<f32> = all.chunks_exact(STENCIL_VALUES).map(of_stencil).collect();
    let predict = |stencils: &[f32], _: &[FirstFlight], out: &mut [f32]| {
        stencils.chunks_exact(STENCIL_VALUES).zip(out).for_each(|(s, out)| *out = of_stencil(s));
        Ok(())
    };
    assert_eq!(judge(&set, predict, &none()).unwrap(), Judgement::of(&set, &predicted).unwrap());
    let fails = |_: &[f32], _: &[FirstFlight], _: &mut [f32]| Err("out of order".into());
    let error = judge(&set, fails, &none()).unwrap_err();
    assert!(pellucid_core::chain(&error).ends_with("failed: out of order"), "{error}");
    let stop = AtomicBool::new(false);
    let calls = std::cell::Cell::new(0);
    let stopping = |_: &[f32], _: &[FirstFlight], _: &mut [f32]| {
        calls.set(calls.get() + 1);
        stop.store(true, Ordering::Relaxed);
        Ok(())
    };
    let control = Control::none().with_cancel(&stop);
    assert!(matches!(judge(&set, stopping, &control), Err(DatasetError::Cancelled)));
    assert_eq!(calls.get(), 1);
}

#[test]
fn a_stopped_run_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let mut header = header(Shard::WHOLE);
    header.split = "fixed".into();
    let path = generate(&folder.path().join("."), &header, &none()).unwrap();
    let expected = std::fs::read(&path).unwrap();

    let other = tempfile::tempdir().unwrap();
    let stop = AtomicBool::new(false);
    let progress = |done: u64, _: u64| stop.store(done >= 2, Ordering::Relaxed);
    let control = Control::none().with_cancel(&stop).with_progress(&progress);
    assert!(matches!(generate(other.path(), &header, &control), Err(DatasetError::Cancelled)));
    let partial = other.path().join("fixed.set.partial");
    let length = std::fs::metadata(&partial).unwrap().len();
    assert!(!other.path().join("fixed.set").exists() && length < expected.len() as u64);
    // Killed in the middle of a record, and once in the middle of the header.
    for cut in [length - 5, 40] {
        let bytes = std::fs::read(&partial).unwrap_or_else(|_| expected.clone());
        std::fs::write(&partial, &bytes[..cut as usize]).unwrap();
        let path = generate(other.path(), &header, &none()).unwrap();
        assert!(std::fs::read(&path).unwrap() == expected);
        assert!(!partial.exists());
        // A finished file is left alone; one of another recipe is not taken for it.
        generate(other.path(), &header, &none()).unwrap();
        let mut changed = header.clone();
        changed.recipe.seed += 1;
        assert!(matches!(generate(other.path(), &changed, &none()), Err(DatasetError::Unsupported(_))));
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn verify_finds_a_changed_label() {
    let folder = tempfile::tempdir().unwrap();
    let path = generate(folder.path(), &header(Shard::WHOLE), &none()).unwrap();
    assert_eq!(verify(&path, 2, 1, &none()).unwrap(), 2);
    assert_eq!(verify(&path, 100, 1, &none()).unwrap(), 5);
    // Another seed's labels under this header: every checksum of the file fits.
    let other = tempfile::tempdir().unwrap();
    let mut changed = header(Shard::WHOLE);
    changed.recipe.seed += 1;
    let foreign = std::fs::read(generate(other.path(), &changed, &none()).unwrap()).unwrap();
    let own = std::fs::read(&path).unwrap();
    let start = |bytes: &[u8]| 20 + u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize;
    let mixed = [&own[..start(&own)], &foreign[start(&foreign)..]].concat();
    std::fs::write(&path, mixed).unwrap();
    info(&path).unwrap();
    assert!(verify(&path, 1, 1, &none()).unwrap_err().to_string().contains("generate the set again"));
    assert!(LabelledSet::load(&[&path], &none()).unwrap_err().to_string().contains("another one"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn damaged_files_are_refused(
        cut in 0.0f64..1.0,
        flips in prop::collection::vec((0.0f64..1.0, 1u8..=255), 1..4),
        truncate in any::<bool>(),
    ) {
        static FILE: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(|| {
            let folder = tempfile::tempdir().unwrap();
            let path = generate(folder.path(), &header(Shard::new(1, 3).unwrap()), &none()).unwrap();
            std::fs::read(path).unwrap()
        });
        let mut bytes = FILE.clone();
        if truncate {
            bytes.truncate((cut * bytes.len() as f64) as usize);
        } else {
            let length = bytes.len();
            for (at, flip) in flips {
                bytes[(at * length as f64) as usize] ^= flip;
            }
        }
        prop_assume!(bytes != *FILE);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("damaged.set");
        std::fs::write(&path, &bytes).unwrap();
        let refused = matches!(info(&path), Err(DatasetError::Invalid(_)));
        prop_assert!(refused);
        prop_assert!(LabelledSet::load(&[&path], &none()).is_err());
    }
}
