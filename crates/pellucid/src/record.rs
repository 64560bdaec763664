//! What it takes to make a print again: settings, model and predictor, as manifest, report and checkpoints hold them.

use std::path::Path;

use pellucid_core::Digest;
use pellucid_mesh::{Model, ReadAs};
use pellucid_predict::Identity;
use pellucid_voxel::{LabelGrid, Tile};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::{PrintError, PrintSettings};

/// The record of a job. It holds no path of the machine that it ran on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Record {
    /// Version of this library.
    pub version: String,
    /// The model.
    pub model: ModelRecord,
    /// The refinement's predictor.
    pub predictor: Identity,
    /// All settings.
    pub settings: PrintSettings,
}

/// Which model, or volume.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelRecord {
    /// Its name.
    pub name: String,
    /// Digest of its geometry and colours, in hexadecimal.
    pub digest: String,
    /// Digest of the spectral image that took the texture's place, in hexadecimal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spectral_image: Option<String>,
    /// What import left out or put right.
    #[serde(default)]
    pub notes: Vec<String>,
    /// How its file was read: format, length unit, up axis; absent for what was not imported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub read_as: Option<ReadAs>,
}

impl ModelRecord {
    /// Of an imported model.
    pub fn of(model: &Model) -> Self {
        // The name that import gives is the path that it was given, which is nobody's business.
        let name = Path::new(model.name()).file_name().unwrap_or_default();
        Self {
            name: name.to_string_lossy().into_owned(),
            digest: model.digest().hex(),
            spectral_image: None,
            notes: model.notes().iter().map(|n| format!("{}: {}", n.object, n.text)).collect(),
            read_as: model.read_as().copied(),
        }
    }

    /// Of a volume that the caller brought.
    pub fn of_volume(name: &str, solid: &LabelGrid, colors: &[[f32; 3]]) -> Self {
        let mut digest = Digest::new();
        for tile in solid.tiles() {
            match tile {
                Tile::Constant(label) => digest.add(&[*label]),
                Tile::Dense(labels) => digest.add(&labels[..]),
            }
        }
        colors.iter().flatten().for_each(|v| digest.add(&v.to_le_bytes()));
        Self { name: name.to_owned(), digest: digest.hex(), ..Self::default() }
    }
}

impl Record {
    /// Of a job.
    pub fn new(model: ModelRecord, predictor: Identity, settings: PrintSettings) -> Self {
        Self { version: env!("CARGO_PKG_VERSION").to_owned(), model, predictor, settings }
    }

    /// Reads settings from JSON text: of a settings file, or of a manifest or report, which hold them.
    ///
    /// # Errors
    /// [`PrintError::Invalid`] naming field and place.
    pub fn settings_from_json(text: &str) -> Result<(PrintSettings, Option<Self>), PrintError> {
        let bad = |e: serde_json::Error| PrintError::invalid("settings", pellucid_core::json::plain(&e));
        let value: Value = serde_json::from_str(text).map_err(bad)?;
        // A manifest keeps the record under `settings`, a report under `record`.
        for holder in ["settings", "record"] {
            if let Some(record) =
                value.get(holder).filter(|r| r.get("predictor").is_some_and(Value::is_object))
            {
                let record: Self = serde_json::from_value(record.clone()).map_err(bad)?;
                return Ok((record.settings.clone(), Some(record)));
            }
        }
        Ok((serde_json::from_str(text).map_err(bad)?, None))
    }

    /// As a checkpoint of this job holds it.
    pub(crate) fn comparable(&self) -> Value {
        let mut value = serde_json::to_value(self).unwrap_or_default();
        // What the labels are written and shown as does not change them.
        if let Some(settings) = value["settings"].as_object_mut() {
            settings.remove("format");
            settings.remove("proof_intent");
        }
        // Where the instructions do not matter, another processor may go on.
        if self.predictor.exact
            && let Some(predictor) = value["predictor"].as_object_mut()
        {
            predictor.remove("instruction_set");
        }
        value
    }
}
