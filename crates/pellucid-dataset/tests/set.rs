//! Files of labelled points: sharded, resumed, verified, damaged.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use pellucid_dataset::{
    DatasetError, LabelledSet, Recipe, STENCIL_VALUES, SetHeader, ShapeClass, Shard, Split, generate, info,
    verify,
};
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
        assert!(matches!(generate(other.path(), &changed, &none()), Err(DatasetError::Unsupported { .. })));
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
        let refused = matches!(info(&path), Err(DatasetError::Unsupported { .. }));
        prop_assert!(refused);
        prop_assert!(LabelledSet::load(&[&path], &none()).is_err());
    }
}
