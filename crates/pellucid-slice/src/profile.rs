//! Printer profiles by name and as JSON.
//!
//! ```json
//! {
//!   "name": "j750", "dpi": [600, 300], "layer_um": 27, "build_space_mm": [490, 390, 200], "max_materials": 6,
//!   "min_layers": 30, "row_order": "highest_y_first", "background": [0, 0, 0, 0],
//!   "palette": {"cyan": [0, 174, 239, 255], "white": [255, 255, 255, 255]},
//!   "resins": {"cyan": "VeroCyan", "white": "VeroPureWht"}
//! }
//! ```
//! `resins` are the printer's own names of materials, and may be left out.
//!
//! | built in | layers | materials at once | resins |
//! | --- | --- | --- | --- |
//! | `j750` | 27 µm | 6 | unnamed, with screen colours |
//! | `j750-high-mix-opaque`, `-vivid` | 27 µm | 6 | VeroOpaque, VeroVivid with Ultra white and black |
//! | `j750-high-quality-opaque`, `-vivid` | 14 µm | 6 | the same |
//! | `j750-high-speed-opaque`, `-vivid` | 27 µm | 3 | the same |
//!
//! They stand for the J735, J750, J835 and J850 alike. The palettes of those with resins are the colours by which public
//! tools identify them in slices.
//!
//! The voxel edges stand as `"dpi": [x, y]` and `"layer_um"`, as `"dpi": [x, y, z]`, or as `"pitch_mm": [x, y, z]`.

use std::collections::BTreeMap;
use std::path::Path;

use pellucid_core::{Fault, files};
use pellucid_voxel::Pitch;
use serde::{Deserialize, Serialize};

use crate::target::Resolution;
use crate::{PrintTarget, RowOrder, SliceError, json};

/// Largest printer profile that is read, in bytes.
const MAX_PROFILE_BYTES: u64 = 1 << 20;

impl PrintTarget {
    /// Names of the built-in profiles.
    pub const NAMES: &'static [&'static str] = &[
        "j750",
        "j750-high-mix-opaque",
        "j750-high-mix-vivid",
        "j750-high-quality-opaque",
        "j750-high-quality-vivid",
        "j750-high-speed-opaque",
        "j750-high-speed-vivid",
    ];

    /// The built-in profile of a Stratasys J750 class printer driven through PNG stacks: 600 x 300 DPI, layers of
    /// 27.000 µm, 490 x 390 x 200 mm, 6 materials and the background, at least 30 slices.
    pub fn j750() -> Self {
        let palette = [
            ("cyan", [0, 174, 239]),
            ("magenta", [236, 0, 140]),
            ("yellow", [255, 221, 0]),
            ("black", [35, 31, 32]),
            ("white", [255, 255, 255]),
            ("clear", [190, 205, 215]),
        ];
        Self {
            name: "j750".into(),
            resolution: Resolution::DpiAndLayer([600.0, 300.0], 27.0),
            build_space_mm: [490.0, 390.0, 200.0],
            max_materials: 6,
            min_layers: 30,
            row_order: RowOrder::HighestYFirst,
            background: [0; 4],
            palette: palette.map(|(name, [r, g, b])| (name.to_owned(), [r, g, b, 255])).into(),
            resins: BTreeMap::new(),
        }
    }

    /// A built-in profile by name, capitals or not.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] for another name, telling [`PrintTarget::NAMES`].
    pub fn by_name(name: &str) -> Result<Self, SliceError> {
        if name.eq_ignore_ascii_case("j750") {
            return Ok(Self::j750());
        }
        if let Some((_, text)) = FILES.iter().find(|(known, _)| name.eq_ignore_ascii_case(known)) {
            return Self::from_json(text);
        }
        let fault = Fault::new("printer", format!("{name:?} is not a built-in profile"))
            .remedy(format!("built in: {}; others are read from a JSON file", Self::NAMES.join(", ")));
        Err(SliceError::Invalid(fault))
    }

    /// A built-in profile by name, or one from a JSON file by path.
    ///
    /// # Errors
    /// As [`PrintTarget::by_name`] when there is neither, else as [`PrintTarget::load`].
    pub fn by_name_or_file(name_or_path: &str) -> Result<Self, SliceError> {
        Self::by_name(name_or_path).or_else(|unknown| {
            let path = Path::new(name_or_path);
            let is_path = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) || path.is_file();
            if is_path { Self::load(path) } else { Err(unknown) }
        })
    }

    /// Reads a profile from JSON text.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] naming the field and what it must be, as [`PrintTarget::new`]; unknown fields too.
    pub fn from_json(text: &str) -> Result<Self, SliceError> {
        json::parse::<Raw>("printer profile", text)?.checked()
    }

    /// Reads a profile from a JSON file of at most 1 MiB.
    ///
    /// # Errors
    /// [`SliceError::Io`] when the file cannot be read; otherwise as [`PrintTarget::from_json`],
    /// naming the file.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, SliceError> {
        let path = path.as_ref();
        let text = files::read_text_bounded(path, MAX_PROFILE_BYTES)?;
        Self::from_json(&text).map_err(|error| error.in_file(path))
    }
}

/// The built-in profiles that are files, by name.
const FILES: [(&str, &str); 6] = [
    ("j750-high-mix-opaque", include_str!("../printers/j750-high-mix-opaque.json")),
    ("j750-high-mix-vivid", include_str!("../printers/j750-high-mix-vivid.json")),
    ("j750-high-quality-opaque", include_str!("../printers/j750-high-quality-opaque.json")),
    ("j750-high-quality-vivid", include_str!("../printers/j750-high-quality-vivid.json")),
    ("j750-high-speed-opaque", include_str!("../printers/j750-high-speed-opaque.json")),
    ("j750-high-speed-vivid", include_str!("../printers/j750-high-speed-vivid.json")),
];

/// A profile as it stands in a file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    dpi: Option<Vec<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layer_um: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pitch_mm: Option<[f64; 3]>,
    build_space_mm: [f64; 3],
    max_materials: u32,
    min_layers: u32,
    row_order: RowOrder,
    background: [u8; 4],
    palette: BTreeMap<String, [u8; 4]>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    resins: BTreeMap<String, String>,
}

impl Raw {
    fn checked(self) -> Result<PrintTarget, SliceError> {
        let resolution = self.resolution()?;
        PrintTarget {
            name: self.name,
            resolution,
            build_space_mm: self.build_space_mm,
            max_materials: self.max_materials,
            min_layers: self.min_layers,
            row_order: self.row_order,
            background: self.background,
            palette: self.palette,
            resins: self.resins,
        }
        .checked()
    }

    fn resolution(&self) -> Result<Resolution, SliceError> {
        let invalid = |field: &str, reason: String| {
            Err(SliceError::invalid(format!("printer profile {:?}, {field}", self.name), reason))
        };
        match (self.dpi.as_deref(), self.layer_um, self.pitch_mm) {
            (Some(dpi), ..) if !matches!(dpi.len(), 2 | 3) => {
                invalid("dpi", format!("has {} values, and must have [x, y] or [x, y, z]", dpi.len()))
            }
            (Some(&[x, y, z]), None, None) => Ok(Resolution::Dpi([x, y, z])),
            (Some(&[x, y]), Some(um), None) => Ok(Resolution::DpiAndLayer([x, y], um)),
            (None, None, Some(mm)) => match Pitch::new(mm) {
                Ok(pitch) => Ok(Resolution::Pitch(pitch)),
                Err(error) => invalid("pitch_mm", error.to_string()),
            },
            (Some(_), None, None) => invalid("layer_um", "is missing; dpi has no value for z".into()),
            (None, _, None) => {
                invalid("dpi", "is missing; give dpi [x, y] and layer_um, or pitch_mm [x, y, z]".into())
            }
            _ => invalid(
                "dpi",
                "voxel edges are told twice; give dpi [x, y] and layer_um, or dpi [x, y, z], or pitch_mm"
                    .into(),
            ),
        }
    }
}

impl Serialize for PrintTarget {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (dpi, layer_um, pitch_mm) = match self.resolution {
            Resolution::Dpi(dpi) => (Some(dpi.to_vec()), None, None),
            Resolution::DpiAndLayer(dpi, um) => (Some(dpi.to_vec()), Some(um), None),
            Resolution::Pitch(pitch) => (None, None, Some(pitch.mm())),
        };
        Raw {
            name: self.name.clone(),
            dpi,
            layer_um,
            pitch_mm,
            build_space_mm: self.build_space_mm,
            max_materials: self.max_materials,
            min_layers: self.min_layers,
            row_order: self.row_order,
            background: self.background,
            palette: self.palette.clone(),
            resins: self.resins.clone(),
        }
        .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for PrintTarget {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        Raw::deserialize(deserializer)?.checked().map_err(|error| match error {
            // What is invalid is said by whoever reads the whole.
            SliceError::Invalid(fault) => D::Error::custom(fault),
            other => D::Error::custom(other),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn good() -> serde_json::Value {
        serde_json::to_value(PrintTarget::j750()).unwrap()
    }

    #[test]
    fn the_committed_profile_equals_the_built_in_one() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("printers/j750.json");
        assert_eq!(PrintTarget::load(&path).unwrap(), PrintTarget::j750());
        assert_eq!(PrintTarget::j750().checked().unwrap(), PrintTarget::j750());
        assert_eq!(PrintTarget::by_name_or_file(path.to_str().unwrap()).unwrap(), PrintTarget::j750());
    }

    #[test]
    fn profiles_of_each_mode_hold_its_layers_and_materials() {
        for (name, _) in FILES {
            let target = PrintTarget::by_name(name).unwrap();
            let (um, materials) = match name {
                _ if name.contains("high-quality") => (14.0, 6),
                _ if name.contains("high-speed") => (27.0, 3),
                _ => (27.0, 6),
            };
            assert_eq!(target.pitch().mm(), [25.4 / 600.0, 25.4 / 300.0, um / 1000.0], "{name}");
            assert_eq!(target.max_materials(), materials, "{name}");
            // All of the palette have a resin, and any of the printer's may be chosen.
            assert!(target.palette().keys().eq(target.resins().keys()), "{name}");
            assert_eq!(target.palette().len(), 6);
            let cyan = if name.contains("vivid") { "VeroCY-V" } else { "VeroCyan" };
            assert_eq!(target.resins()["cyan"], cyan);
            assert_eq!(target.color_of("cyan"), Some([0, 90, 158, 255]));
        }
    }

    #[test]
    fn layers_of_the_j750_are_27_micrometres() {
        let [x, y, z] = PrintTarget::j750().pitch().mm();
        assert_eq!([x, y], [25.4 / 600.0, 25.4 / 300.0]);
        // 0.16 mm went missing of 200 mm at 940 layers an inch.
        assert_eq!(z, 0.027);
        let layers = (200.0 / z).round();
        assert!((layers * z - 200.0).abs() < z);
    }

    #[test]
    fn names_are_found_and_unknown_ones_answered_with_those_known() {
        for name in PrintTarget::NAMES {
            assert_eq!(PrintTarget::by_name(name).unwrap().name(), *name);
        }
        assert_eq!(PrintTarget::by_name("J750").unwrap(), PrintTarget::j750());
        for find in [PrintTarget::by_name, PrintTarget::by_name_or_file] {
            let error = find("J55").unwrap_err().to_string();
            assert!(error.contains("\"J55\"") && error.contains("built in: j750"), "{error}");
        }
        assert!(matches!(PrintTarget::by_name_or_file("none.json"), Err(SliceError::Io(_))));
    }

    #[test]
    fn edges_may_be_told_in_three_ways_and_are_written_as_they_were_read() {
        let cases = [
            (json!({"dpi": [600.0, 300.0, 940.0]}), [25.4 / 600.0, 25.4 / 300.0, 25.4 / 940.0]),
            (json!({"dpi": [600.0, 300.0], "layer_um": 14.0}), [25.4 / 600.0, 25.4 / 300.0, 0.014]),
            (json!({"pitch_mm": [0.1, 0.2, 0.3]}), [0.1, 0.2, 0.3]),
        ];
        for (edges, mm) in cases {
            let mut json = good();
            let map = json.as_object_mut().unwrap();
            map.remove("dpi");
            map.remove("layer_um");
            map.extend(edges.as_object().unwrap().clone());
            let target = PrintTarget::from_json(&json.to_string()).unwrap();
            assert_eq!(target.pitch().mm(), mm);
            assert_eq!(serde_json::to_value(&target).unwrap(), json);
            let dpi = target.dpi();
            assert!((0..3).all(|a| (dpi[a] * mm[a] / 25.4 - 1.0).abs() < 1e-12), "{dpi:?}");
        }
    }

    #[test]
    fn refuses_bad_profiles_by_field_and_says_so_once() {
        let cases = [
            ("/dpi/1", json!(0.0), "dpi"),
            ("/dpi", json!([600.0]), "dpi: has 1 values, and must have [x, y] or [x, y, z]"),
            ("/dpi", json!([600.0, 300.0, 940.0]), "told twice"),
            ("/layer_um", json!(null), "layer_um: is missing"),
            ("/layer_um", json!(-27.0), "dpi, layer_um"),
            ("/build_space_mm/2", json!(-1.0), "build_space_mm"),
            (
                "/build_space_mm",
                json!([1.0, 2.0]),
                "build_space_mm: found 2 values where a list of 3 values is expected",
            ),
            ("/max_materials", json!(0), "max_materials"),
            (
                "/max_materials",
                json!(6.5),
                "max_materials: found the number 6.5 where a whole number, 0 or more, is expected (line 1",
            ),
            ("/min_layers", json!(u32::MAX), "min_layers"),
            ("/palette/cyan", json!([1, 2, 3, 254]), "cyan"),
            (
                "/palette/cyan",
                json!([1, 2, 300, 255]),
                "palette.cyan[2]: found the number 300 where a whole number from 0 to 255 is",
            ),
            ("/palette/cyan", json!([255, 255, 255, 255]), "white"),
            ("/background", json!([255, 255, 255, 0]), "white"),
            ("/resins", json!({"gold": "VeroGold"}), "resins: \"gold\" is not in the palette"),
            ("/resins", json!({"cyan": "a", "white": "a"}), "\"white\" and \"cyan\" are both \"a\""),
            ("/name", json!(" "), "name"),
            ("/name", json!(3), "name: found the number 3 where text is expected"),
            (
                "/row_order",
                json!("upwards"),
                "row_order: found \"upwards\" where \"highest_y_first\" or \"lowest_y_first\" is",
            ),
        ];
        for (pointer, value, word) in cases {
            let mut bad = good();
            bad["resins"] = json!({});
            *bad.pointer_mut(pointer).unwrap() = value;
            let error = PrintTarget::from_json(&bad.to_string()).unwrap_err();
            assert!(matches!(error, SliceError::Invalid(_)));
            let error = pellucid_core::chain(&error);
            assert!(error.contains(word), "{pointer}: {error}");
            assert_eq!(error.matches("invalid").count(), 1, "{error}");
            assert_eq!(error.matches("printer profile").count(), 1, "{error}");
            // As part of a larger text.
            let within = serde_json::from_value::<PrintTarget>(bad).unwrap_err().to_string();
            assert!(
                within.matches("printer profile").count() <= 1 && within.matches("invalid").count() <= 1,
                "{within}"
            );
        }
        let mut unknown = good();
        unknown["dpy"] = 3.into();
        assert!(PrintTarget::from_json(&unknown.to_string()).unwrap_err().to_string().contains("dpy"));
    }

    #[test]
    fn files_are_named_and_bounded() {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("mine.json");
        std::fs::write(&path, "{\n  \"name\": \"mine\",\n  \"dpi\": 600\n}").unwrap();
        let error = PrintTarget::load(&path).unwrap_err().to_string();
        assert!(
            error.contains("mine.json")
                && error.contains("dpi: found the number 600 where a list is expected (line 3"),
            "{error}"
        );
        std::fs::write(&path, vec![b' '; MAX_PROFILE_BYTES as usize + 1]).unwrap();
        assert!(matches!(PrintTarget::load(&path), Err(SliceError::Io(_))));
    }
}
