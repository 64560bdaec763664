//! Manifests whose values are changed: every one reads as the same stack or is refused by a typed error.

use std::fs;
use std::path::Path;

use pellucid_slice::{ExportSettings, PrintTarget, SliceError, export, read_stack};
use pellucid_voxel::{Control, Frame, LabelGrid, MaterialTable};
use proptest::prelude::*;
use serde_json::{Value, json};

/// A small stack of two materials and its manifest.
fn stack(out: &Path) -> (LabelGrid, Value) {
    let target = PrintTarget::j750().with_min_layers(4).unwrap();
    let mut grid = LabelGrid::new(Frame::new([1.0, 2.0, 3.0], target.pitch(), [9, 5, 3]).unwrap());
    for i in 0..9 {
        grid.set([i, i % 5, i % 3], if i % 2 == 0 { 1 } else { 5 });
    }
    export(&grid, &MaterialTable::cmykw(), &target, &ExportSettings::default(), out, &Control::none())
        .unwrap();
    let value = serde_json::from_slice(&fs::read(out.join("manifest.json")).unwrap()).unwrap();
    (grid, value)
}

/// Pointers to every value within a value.
fn places(value: &Value, at: &str, found: &mut Vec<String>) {
    if !at.is_empty() {
        found.push(at.to_owned());
    }
    match value {
        Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, v)| places(v, &format!("{at}/{i}"), found))
        }
        Value::Object(map) => map.iter().for_each(|(key, v)| places(v, &format!("{at}/{key}"), found)),
        _ => {}
    }
}

fn any_value() -> impl Strategy<Value = Value> {
    prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<u64>().prop_map(Value::from),
        (-3i64..300).prop_map(Value::from),
        any::<f64>().prop_map(Value::from),
        (-2.0..2.0f64).prop_map(Value::from),
        Just(json!(1e308)),
        Just(json!(5e-324)),
        ".{0,12}".prop_map(Value::from),
        Just(json!("lowest_y_first")),
        prop::collection::vec(any::<i32>().prop_map(Value::from), 0..5).prop_map(Value::from),
        Just(json!({})),
    ]
}

fn check(out: &Path, text: &str, grid: &LabelGrid) -> Result<(), TestCaseError> {
    fs::write(out.join("manifest.json"), text).unwrap();
    match read_stack(out, &Control::none()) {
        Ok((back, _)) => {
            // What the images hold does not change: only where it lies, and which label or row is which.
            prop_assert_eq!(back.size()[..2].to_vec(), grid.size()[..2].to_vec());
            let solid = |g: &LabelGrid| g.histogram()[1..].iter().sum::<u64>();
            prop_assert_eq!(solid(&back), solid(grid));
        }
        // A manifest that claims more layers or other files names what is not there.
        Err(SliceError::Invalid(fault) | SliceError::Unsupported(fault)) => {
            prop_assert!(!fault.subject.is_empty() && !fault.reason.is_empty());
            let text = fault.to_string();
            for rust in ["usize", "u32", "f64", "struct ", "invalid type"] {
                prop_assert!(!text.contains(rust), "{}", text);
            }
        }
        Err(SliceError::Io(error)) => prop_assert_eq!(error.source.kind(), std::io::ErrorKind::NotFound),
        Err(other) => prop_assert!(false, "{}", other),
    }
    Ok(())
}

#[test]
fn changed_values() {
    let dir = tempfile::tempdir().unwrap();
    let (grid, manifest) = stack(&dir.path().join("out"));
    let mut found = Vec::new();
    places(&manifest, "", &mut found);
    let place = any::<prop::sample::Index>();
    proptest!(ProptestConfig::with_cases(600), |(place in place, value in any_value(), nudge in any::<bool>())| {
        let mut manifest = manifest.clone();
        let slot = manifest.pointer_mut(place.get(&found).as_str()).unwrap();
        // Numbers that are nearly right get further than others.
        *slot = match slot.as_u64() {
            Some(n) if nudge => (n + 1).into(),
            _ => value,
        };
        check(&dir.path().join("out"), &manifest.to_string(), &grid)?;
    });
}

#[test]
fn missing_fields() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let (_, manifest) = stack(&out);
    let mut found = Vec::new();
    places(&manifest, "", &mut found);
    assert!(found.len() > 40);
    for place in found {
        let mut manifest = manifest.clone();
        let (parent, key) = place.rsplit_once('/').unwrap();
        let parent = if parent.is_empty() { Some(&mut manifest) } else { manifest.pointer_mut(parent) };
        match parent.unwrap() {
            Value::Object(map) => drop(map.remove(key)),
            Value::Array(list) => drop(list.remove(key.parse().unwrap())),
            _ => unreachable!("a value within another"),
        }
        fs::write(out.join("manifest.json"), manifest.to_string()).unwrap();
        let error = read_stack(&out, &Control::none()).unwrap_err();
        assert!(matches!(&error, SliceError::Invalid(_) | SliceError::Unsupported(_)), "{place}: {error}");
    }
}

#[test]
fn doubled_fields() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let (_, manifest) = stack(&out);
    let text = manifest.to_string();
    for (key, value) in manifest.as_object().unwrap() {
        fs::write(out.join("manifest.json"), format!("{{\"{key}\": {value}, {}", &text[1..])).unwrap();
        let error = read_stack(&out, &Control::none()).unwrap_err();
        assert!(matches!(&error, SliceError::Invalid(_)), "{key}: {error}");
        assert!(error.to_string().contains(&format!("duplicate field \"{key}\"")), "{error}");
    }
}
