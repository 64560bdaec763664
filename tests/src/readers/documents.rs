//! Documents that people write.

use std::fs;

use pellucid::color::calibration::{Measurements, Patch, ReadOptions};
use pellucid::dataset::Recipe;
use pellucid::slice::PrintTarget;
use pellucid::trace::cases::parse_cases;
use pellucid::voxel::{MaterialTable, MeasuredSpectra};
use pellucid::{PrintSettings, Record};

use super::{Outcome, folder, text};

/// Settings; a manifest or report that holds them.
pub fn settings(bytes: &[u8]) -> Outcome {
    let (settings, _) = Record::settings_from_json(text(bytes)?)?;
    let written = serde_json::to_string(&settings)?;
    let again: PrintSettings = serde_json::from_str(&written).expect("what was written is read");
    assert_eq!(serde_json::to_string(&again)?, written);
    Ok(())
}

/// A table of materials, in channels or measured at wavelengths.
pub fn materials(bytes: &[u8]) -> Outcome {
    let text = text(bytes)?;
    let spectra = MeasuredSpectra::from_json(text);
    let table = MaterialTable::from_json(text)?;
    let written = serde_json::to_string(&table)?;
    assert!(MaterialTable::from_json(&written).expect("what was written is read") == table);
    drop(spectra);
    Ok(())
}

/// A printer's profile.
pub fn printer(bytes: &[u8]) -> Outcome {
    let target = PrintTarget::from_json(text(bytes)?)?;
    let written = serde_json::to_string(&target)?;
    assert!(PrintTarget::from_json(&written).expect("what was written is read") == target);
    Ok(())
}

/// A recipe of a data set.
pub fn recipe(bytes: &[u8]) -> Outcome {
    let folder = folder()?;
    let path = folder.path().join("recipe.json");
    fs::write(&path, bytes)?;
    Recipe::read(&path)?;
    Ok(())
}

/// A table of measurements, and of a chart.
pub fn measurements(bytes: &[u8]) -> Outcome {
    let text = text(bytes)?;
    let chart = Patch::parse_chart(text);
    Measurements::parse(text, &ReadOptions::default())?;
    chart?;
    Ok(())
}

/// Reference radiances.
pub fn cases(bytes: &[u8]) -> Outcome {
    parse_cases(text(bytes)?)?;
    Ok(())
}
