//! What a printer accepts: pitch, build space, limits and the colour that stands for each material.

use std::collections::BTreeMap;

use pellucid_core::Fault;
use pellucid_voxel::{Frame, Pitch, VoxelError};
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

/// Voxel edges as a profile states them, so that it is written as it was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Resolution {
    /// Dots per inch along x, y and z.
    Dpi([f64; 3]),
    /// Dots per inch along x and y, and the layers' height in micrometres.
    DpiAndLayer([f64; 2], f64),
    /// Millimetres.
    Pitch(Pitch),
}

impl Resolution {
    fn pitch(self) -> Result<Pitch, VoxelError> {
        match self {
            Self::Dpi(dpi) => Pitch::from_dpi(dpi),
            Self::DpiAndLayer([x, y], um) => Pitch::new([25.4 / x, 25.4 / y, um / 1000.0]),
            Self::Pitch(pitch) => Ok(pitch),
        }
    }

    /// The field of a profile's file that says it.
    fn field(self) -> &'static str {
        match self {
            Self::Dpi(_) => "dpi",
            Self::DpiAndLayer(..) => "dpi, layer_um",
            Self::Pitch(_) => "pitch_mm",
        }
    }
}

/// A printer profile: everything slice export needs to know of a machine.
///
/// ```
/// use pellucid_slice::{PrintTarget, RowOrder};
/// let target = PrintTarget::j750();
/// assert_eq!(target.pitch().mm(), [25.4 / 600.0, 25.4 / 300.0, 0.027]);
/// assert_eq!(target.color_of("white"), Some([255, 255, 255, 255]));
/// let json = serde_json::to_string(&target)?;
/// assert_eq!(PrintTarget::from_json(&json)?, target);
///
/// let three = target
///     .with_name("J750 High Speed")?
///     .with_max_materials(3)?
///     .with_row_order(RowOrder::LowestYFirst)
///     .with_palette([("cyan", [0, 174, 239, 255]), ("white", [255; 4])])?;
/// assert_eq!(three.palette().len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PrintTarget {
    pub(crate) name: String,
    pub(crate) resolution: Resolution,
    pub(crate) build_space_mm: [f64; 3],
    pub(crate) max_materials: u32,
    pub(crate) min_layers: u32,
    pub(crate) row_order: RowOrder,
    pub(crate) background: [u8; 4],
    pub(crate) palette: BTreeMap<String, [u8; 4]>,
    pub(crate) resins: BTreeMap<String, String>,
}

impl PrintTarget {
    /// A profile of a printer with a voxel pitch, a printable box along `[x, y, z]` in millimetres and the RGBA colour
    /// that stands for each material, by name.
    ///
    /// It takes all materials of the palette at once and prints of one layer and more, its images are as seen from
    /// above, and empty space is transparent black; the `with_` methods change that.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] naming the field: an empty name, a build space that is not positive and finite, no
    /// materials, a name twice, a translucent material, or two colours (background included) that differ in alpha
    /// only, which tools without alpha would confuse.
    pub fn new<N: Into<String>>(
        name: &str,
        pitch: Pitch,
        build_space_mm: [f64; 3],
        palette: impl IntoIterator<Item = (N, [u8; 4])>,
    ) -> Result<Self, SliceError> {
        let palette = unique(name, "palette", palette)?;
        Self {
            name: name.to_owned(),
            resolution: Resolution::Pitch(pitch),
            build_space_mm,
            max_materials: (palette.len() as u32).max(1),
            min_layers: 1,
            row_order: RowOrder::HighestYFirst,
            background: [0; 4],
            palette,
            resins: BTreeMap::new(),
        }
        .checked()
    }

    /// The same under another name.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when it is empty.
    pub fn with_name(mut self, name: &str) -> Result<Self, SliceError> {
        name.clone_into(&mut self.name);
        self.checked()
    }

    /// The same with other voxel edges.
    pub fn with_pitch(mut self, pitch: Pitch) -> Self {
        self.resolution = Resolution::Pitch(pitch);
        self
    }

    /// The same with another printable box along `[x, y, z]` in millimetres.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when an edge is not positive and finite.
    pub fn with_build_space_mm(mut self, build_space_mm: [f64; 3]) -> Result<Self, SliceError> {
        self.build_space_mm = build_space_mm;
        self.checked()
    }

    /// The same for prints of at most `max_materials`, background not counted.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] for 0.
    pub fn with_max_materials(mut self, max_materials: u32) -> Result<Self, SliceError> {
        self.max_materials = max_materials;
        self.checked()
    }

    /// The same whose tool takes no fewer than `min_layers` slices: shorter objects are padded with air above.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] past [`Frame::MAX_EDGE`].
    pub fn with_min_layers(mut self, min_layers: u32) -> Result<Self, SliceError> {
        self.min_layers = min_layers;
        self.checked()
    }

    /// The same with the other end of the y axis in an image's first row.
    pub fn with_row_order(mut self, row_order: RowOrder) -> Self {
        self.row_order = row_order;
        self
    }

    /// The same with another RGBA colour of empty space.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] when a material has that colour.
    pub fn with_background(mut self, background: [u8; 4]) -> Result<Self, SliceError> {
        self.background = background;
        self.checked()
    }

    /// The same with other materials: the RGBA colour of each by name. Resins of materials that are gone go too.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] as [`PrintTarget::new`].
    pub fn with_palette<N: Into<String>>(
        mut self,
        palette: impl IntoIterator<Item = (N, [u8; 4])>,
    ) -> Result<Self, SliceError> {
        self.palette = unique(&self.name, "palette", palette)?;
        self.resins.retain(|material, _| self.palette.contains_key(material));
        self.checked()
    }

    /// The same with the printer's own names of its materials: the resin by material. Those without keep their own.
    ///
    /// # Errors
    /// [`SliceError::Invalid`] for a material that the palette has not or that is named twice, and a name that is empty
    /// or stands for two materials.
    pub fn with_resins<N: Into<String>>(
        mut self,
        resins: impl IntoIterator<Item = (N, String)>,
    ) -> Result<Self, SliceError> {
        self.resins = unique(&self.name, "resins", resins)?;
        self.checked()
    }

    /// Checks every field.
    pub(crate) fn checked(self) -> Result<Self, SliceError> {
        if self.name.trim().is_empty() {
            return Err(invalid("", "name", "is empty"));
        }
        let invalid = |field: &str, reason: String| Err(invalid(&self.name, field, reason));
        match self.resolution.pitch() {
            Ok(_) => {}
            Err(VoxelError::Invalid(fault)) => {
                return invalid(self.resolution.field(), format!("{}: {}", fault.subject, fault.reason));
            }
            Err(other) => return Err(other.into()),
        }
        if let Some(bad) = self.build_space_mm.iter().find(|v| !(v.is_finite() && **v > 0.0)) {
            return invalid("build_space_mm", format!("{bad} mm must be positive and finite"));
        }
        if self.max_materials == 0 {
            return invalid("max_materials", "must be at least 1".into());
        }
        if self.min_layers > Frame::MAX_EDGE {
            return invalid("min_layers", format!("{} must be at most {}", self.min_layers, Frame::MAX_EDGE));
        }
        self.check_palette()?;
        self.check_resins()?;
        Ok(self)
    }

    fn check_palette(&self) -> Result<(), SliceError> {
        let invalid = |reason: String| Err(invalid(&self.name, "palette", reason));
        if self.palette.is_empty() {
            return invalid("needs at least one material".into());
        }
        let mut seen = vec![("background", self.background)];
        for (material, color) in &self.palette {
            if color[3] != 255 {
                return invalid(format!(
                    "{material:?} has alpha {}; a material's colour must be opaque (255)",
                    color[3]
                ));
            }
            if let Some((other, _)) = seen.iter().find(|(_, c)| c[..3] == color[..3]) {
                return invalid(format!(
                    "{material:?} and {other:?} share the RGB value {:?}; give each its own",
                    &color[..3]
                ));
            }
            seen.push((material, *color));
        }
        Ok(())
    }

    fn check_resins(&self) -> Result<(), SliceError> {
        let invalid = |reason: String| Err(invalid(&self.name, "resins", reason));
        let mut seen = BTreeMap::new();
        for (material, resin) in &self.resins {
            if !self.palette.contains_key(material) {
                return invalid(format!("{material:?} is not in the palette"));
            }
            if resin.trim().is_empty() {
                return invalid(format!("that of {material:?} is empty"));
            }
            if let Some(other) = seen.insert(resin, material) {
                return invalid(format!("{material:?} and {other:?} are both {resin:?}"));
            }
        }
        Ok(())
    }

    /// Short name, as given to `--printer`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Dots per inch along `[x, y, z]`.
    pub fn dpi(&self) -> [f64; 3] {
        match self.resolution {
            Resolution::Dpi(dpi) => dpi,
            Resolution::DpiAndLayer([x, y], um) => [x, y, 25_400.0 / um],
            Resolution::Pitch(pitch) => pitch.mm().map(|edge| 25.4 / edge),
        }
    }

    /// Voxel edges.
    pub fn pitch(&self) -> Pitch {
        self.resolution.pitch().unwrap_or_else(|_| unreachable!("checked by the constructor"))
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

    /// The printer's own names of materials, by name, where it has any.
    pub fn resins(&self) -> &BTreeMap<String, String> {
        &self.resins
    }
}

fn invalid(name: &str, field: &str, reason: impl Into<String>) -> SliceError {
    SliceError::Invalid(Fault::new(format!("printer profile {name:?}, {field}"), reason))
}

fn unique<N: Into<String>, T>(
    name: &str,
    field: &str,
    of_materials: impl IntoIterator<Item = (N, T)>,
) -> Result<BTreeMap<String, T>, SliceError> {
    let mut unique = BTreeMap::new();
    for (material, value) in of_materials {
        let material = material.into();
        if unique.contains_key(&material) {
            return Err(invalid(name, field, format!("{material:?} is named twice")));
        }
        unique.insert(material, value);
    }
    Ok(unique)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn builder_methods_change_their_field_and_are_checked() {
        let pitch = Pitch::new([0.05, 0.06, 0.03]).unwrap();
        let white = [("white", [255; 4])];
        let target = PrintTarget::new("lab", pitch, [100.0, 90.0, 80.0], white).unwrap();
        assert_eq!((target.max_materials(), target.min_layers(), target.background()), (1, 1, [0; 4]));
        assert_eq!((target.pitch(), target.row_order()), (pitch, RowOrder::HighestYFirst));
        let dpi = target.dpi();
        assert!((dpi[0] - 508.0).abs() < 1e-9 && (dpi[2] - 25.4 / 0.03).abs() < 1e-9, "{dpi:?}");

        let other = PrintTarget::j750()
            .with_name("lab")
            .and_then(|t| t.with_pitch(pitch).with_build_space_mm([100.0, 90.0, 80.0]))
            .and_then(|t| t.with_max_materials(1)?.with_min_layers(1)?.with_palette(white));
        assert_eq!(other.unwrap(), target);
        let lowest =
            target.clone().with_row_order(RowOrder::LowestYFirst).with_background([0, 0, 0, 255]).unwrap();
        assert_eq!((lowest.row_order(), lowest.background()), (RowOrder::LowestYFirst, [0, 0, 0, 255]));

        let t = || target.clone();
        for (result, field) in [
            (t().with_name(" "), "name"),
            (t().with_build_space_mm([1.0, f64::NAN, 1.0]), "build_space_mm"),
            (t().with_max_materials(0), "max_materials"),
            (t().with_min_layers(u32::MAX), "min_layers"),
            (t().with_background([255, 255, 255, 0]), "white"),
            (t().with_palette([("a", [1, 1, 1, 255]), ("a", [2, 2, 2, 255])]), "twice"),
            (t().with_palette([("a", [1, 1, 1, 254])]), "opaque"),
            (t().with_palette::<&str>([]), "at least one"),
            (t().with_resins([("gold", "VeroGold".to_owned())]), "not in the palette"),
            (t().with_resins([("white", " ".to_owned())]), "empty"),
            (t().with_resins([("white", "a".to_owned()), ("white", "b".to_owned())]), "named twice"),
            (PrintTarget::new("x", pitch, [0.0, 1.0, 1.0], white), "build_space_mm"),
        ] {
            let error = result.unwrap_err().to_string();
            assert!(error.contains(field), "{field}: {error}");
        }
    }
}
