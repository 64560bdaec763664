//! What a printer accepts: pitch, build space, limits and the colour that stands for each material.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use pellucid_voxel::Pitch;
use serde::{Deserialize, Serialize};

use crate::SliceError;

/// Which end of the y axis the first (top) row of a slice image holds.
///
/// x grows along a row, and the layers grow upwards in z; the frame is right-handed. So with
/// [`RowOrder::HighestYFirst`] a slice seen in an image viewer is the object seen from above, not
/// mirrored, with y pointing up the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RowOrder {
    /// Row 0 holds the highest y: an image viewer shows the layer as seen from above.
    HighestYFirst,
    /// Row 0 holds y = 0: an image viewer shows the layer mirrored, as seen from below.
    LowestYFirst,
}

impl RowOrder {
    /// The y index of an image row, for `height` rows. Its own inverse.
    pub fn y_of_row(self, row: u32, height: u32) -> u32 {
        match self {
            Self::HighestYFirst => height - 1 - row,
            Self::LowestYFirst => row,
        }
    }
}

/// A printer profile: everything slice export needs to know of a machine.
///
/// ```
/// use pellucid_slice::PrintTarget;
/// let target = PrintTarget::j750();
/// assert_eq!(target.dpi(), [600.0, 300.0, 940.0]);
/// assert_eq!(target.color_of("white"), Some([255, 255, 255, 255]));
/// let json = serde_json::to_string(&target).unwrap();
/// assert_eq!(PrintTarget::from_json(&json).unwrap(), target);
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PrintTarget {
    name: String,
    dpi: [f64; 3],
    build_space_mm: [f64; 3],
    max_materials: u32,
    min_layers: u32,
    row_order: RowOrder,
    background: [u8; 4],
    palette: BTreeMap<String, [u8; 4]>,
}

/// Largest printer profile that is read, in bytes.
const MAX_PROFILE_BYTES: u64 = 1 << 20;

impl PrintTarget {
    /// Checks and builds a profile.
    ///
    /// `dpi` are dots per inch along `[x, y, z]`, `build_space_mm` the printable box, `min_layers`
    /// the fewest slices the printer's tool takes (shorter objects are padded with air above), and
    /// `palette` the RGBA colour of each material by name.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] naming the field: a DPI outside what [`Pitch`] takes, a build space
    /// that is not positive and finite, no materials, a translucent material, or two colours
    /// (background included) that differ in alpha only, which tools without alpha would confuse.
    pub fn new(
        name: &str,
        dpi: [f64; 3],
        build_space_mm: [f64; 3],
        max_materials: u32,
        min_layers: u32,
        row_order: RowOrder,
        background: [u8; 4],
        palette: BTreeMap<String, [u8; 4]>,
    ) -> Result<Self, SliceError> {
        let field = |what: &str| format!("printer profile {name:?}, {what}");
        if name.trim().is_empty() {
            return Err(SliceError::invalid("printer profile", "the name is empty"));
        }
        Pitch::from_dpi(dpi).map_err(|e| SliceError::invalid(field("dpi"), e.to_string()))?;
        if let Some(bad) = build_space_mm.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
            return Err(SliceError::invalid(
                field("build_space_mm"),
                format!("{bad} mm must be positive and finite"),
            ));
        }
        if max_materials == 0 || palette.is_empty() {
            return Err(SliceError::invalid(field("palette"), "needs at least one material"));
        }
        let mut seen = vec![("background", background)];
        for (material, color) in &palette {
            if color[3] != 255 {
                return Err(SliceError::invalid(
                    field("palette"),
                    format!("{material:?} has alpha {}; a material's colour must be opaque (255)", color[3]),
                ));
            }
            if let Some((other, _)) = seen.iter().find(|(_, c)| c[..3] == color[..3]) {
                return Err(SliceError::invalid(
                    field("palette"),
                    format!(
                        "{material:?} and {other:?} share the RGB value {:?}; give each its own",
                        &color[..3]
                    ),
                ));
            }
            seen.push((material, *color));
        }
        Ok(Self {
            name: name.to_owned(),
            dpi,
            build_space_mm,
            max_materials,
            min_layers,
            row_order,
            background,
            palette,
        })
    }

    /// The built-in profile of a Stratasys J750 class printer driven through PNG stacks:
    /// 600 x 300 x 940 DPI (27 µm layers), 490 x 390 x 200 mm, 6 materials and the background, at
    /// least 30 slices.
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
            dpi: [600.0, 300.0, 940.0],
            build_space_mm: [490.0, 390.0, 200.0],
            max_materials: 6,
            min_layers: 30,
            row_order: RowOrder::HighestYFirst,
            background: [0; 4],
            palette: palette.map(|(name, [r, g, b])| (name.to_owned(), [r, g, b, 255])).into(),
        }
    }

    /// A built-in profile by name, or `None`.
    pub fn builtin(name: &str) -> Option<Self> {
        Some(Self::j750()).filter(|target| target.name == name)
    }

    /// Reads a profile from JSON text.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] naming the field, as [`PrintTarget::new`]; unknown fields too.
    pub fn from_json(json: &str) -> Result<Self, SliceError> {
        serde_json::from_str(json).map_err(|e| SliceError::invalid("printer profile", e.to_string()))
    }

    /// Reads a profile from a JSON file of at most 1 MiB.
    ///
    /// # Errors
    /// [`SliceError::Io`] when the file cannot be read; otherwise as [`PrintTarget::from_json`],
    /// naming the file.
    pub fn load(path: &Path) -> Result<Self, SliceError> {
        let io = |e| SliceError::io("read", path)(e);
        let mut bytes = Vec::new();
        let file = std::fs::File::open(path).map_err(io)?;
        file.take(MAX_PROFILE_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
        if bytes.len() as u64 > MAX_PROFILE_BYTES {
            return Err(SliceError::file(path, format!("is longer than {MAX_PROFILE_BYTES} bytes")));
        }
        serde_json::from_slice(&bytes).map_err(|e| SliceError::file(path, e.to_string()))
    }

    /// Short name, as given to `--printer`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Dots per inch along `[x, y, z]`.
    pub fn dpi(&self) -> [f64; 3] {
        self.dpi
    }

    /// Voxel edges.
    pub fn pitch(&self) -> Pitch {
        Pitch::from_dpi(self.dpi).unwrap_or_else(|_| unreachable!("checked by the constructor"))
    }

    /// Printable box along `[x, y, z]` in millimetres.
    pub fn build_space_mm(&self) -> [f64; 3] {
        self.build_space_mm
    }

    /// Most materials in one print, background not counted.
    pub fn max_materials(&self) -> u32 {
        self.max_materials
    }

    /// Fewest slices the printer's tool takes.
    pub fn min_layers(&self) -> u32 {
        self.min_layers
    }

    /// Which end of the y axis comes first in an image.
    pub fn row_order(&self) -> RowOrder {
        self.row_order
    }

    /// RGBA of empty space.
    pub fn background(&self) -> [u8; 4] {
        self.background
    }

    /// RGBA of a material by name.
    pub fn color_of(&self, material: &str) -> Option<[u8; 4]> {
        self.palette.get(material).copied()
    }

    /// RGBA of every material the profile knows, by name.
    pub fn palette(&self) -> &BTreeMap<String, [u8; 4]> {
        &self.palette
    }
}

impl<'de> Deserialize<'de> for PrintTarget {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Raw {
            name: String,
            dpi: [f64; 3],
            build_space_mm: [f64; 3],
            max_materials: u32,
            min_layers: u32,
            row_order: RowOrder,
            background: [u8; 4],
            palette: BTreeMap<String, [u8; 4]>,
        }
        let r = Raw::deserialize(deserializer)?;
        PrintTarget::new(
            &r.name,
            r.dpi,
            r.build_space_mm,
            r.max_materials,
            r.min_layers,
            r.row_order,
            r.background,
            r.palette,
        )
        .map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_committed_profile_equals_the_built_in_one() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../datasets/printers/j750.json");
        assert_eq!(PrintTarget::load(&path).unwrap(), PrintTarget::j750());
        assert_eq!(PrintTarget::builtin("j750"), Some(PrintTarget::j750()));
        assert_eq!(PrintTarget::builtin("J55"), None);
        assert_eq!(PrintTarget::j750().pitch(), Pitch::j750());
    }

    #[test]
    fn refuses_bad_profiles_by_field() {
        let good = serde_json::to_value(PrintTarget::j750()).unwrap();
        let cases = [
            ("/dpi/1", serde_json::json!(0.0), "dpi"),
            ("/build_space_mm/2", serde_json::json!(-1.0), "build_space_mm"),
            ("/max_materials", serde_json::json!(0), "palette"),
            ("/palette/cyan", serde_json::json!([1, 2, 3, 254]), "cyan"),
            ("/palette/cyan", serde_json::json!([255, 255, 255, 255]), "white"),
            ("/background", serde_json::json!([255, 255, 255, 0]), "white"),
            ("/name", serde_json::json!(" "), "name"),
            ("/row_order", serde_json::json!("upwards"), "upwards"),
        ];
        for (pointer, value, word) in cases {
            let mut bad = good.clone();
            *bad.pointer_mut(pointer).unwrap() = value;
            let error = PrintTarget::from_json(&bad.to_string()).unwrap_err().to_string();
            assert!(error.contains(word), "{pointer}: {error}");
        }
        let mut unknown = good;
        unknown["dpy"] = 3.into();
        assert!(PrintTarget::from_json(&unknown.to_string()).unwrap_err().to_string().contains("dpy"));
    }
}
