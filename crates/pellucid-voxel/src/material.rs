//! Print materials: scattering and absorption per colour channel.

use crate::VoxelError;

/// One print material. Labels in a grid are 1-based positions in a [`MaterialTable`].
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Material {
    /// Display name, unique in its table.
    pub name: String,
    /// Scattering coefficient per channel, 1/mm, finite and at least 0.
    pub sigma_s: Vec<f32>,
    /// Absorption coefficient per channel, 1/mm, finite and at least 0.
    pub sigma_a: Vec<f32>,
    /// Henyey-Greenstein mean cosine, within -0.99..=0.99.
    pub g: f32,
}

impl Material {
    /// From single-scattering albedo and extinction per channel, as measurements are tabulated.
    pub fn from_albedo(name: &str, albedo: &[f64], sigma_t: &[f64], g: f32) -> Self {
        let pairs = || albedo.iter().zip(sigma_t);
        Self {
            name: name.to_owned(),
            sigma_s: pairs().map(|(a, t)| (a * t) as f32).collect(),
            sigma_a: pairs().map(|(a, t)| ((1.0 - a) * t) as f32).collect(),
            g,
        }
    }
}

/// The materials of a print, in label order, over one set of channels.
///
/// ```
/// use pellucid_voxel::MaterialTable;
/// let table = MaterialTable::cmykw();
/// assert_eq!(table.channels(), 3);
/// let white = table.label_of("white").unwrap();
/// assert_eq!(white, 5);
/// assert!(table.albedo(white, 0) > 0.999);
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct MaterialTable {
    channel_names: Vec<String>,
    materials: Vec<Material>,
}

impl MaterialTable {
    /// Most materials in a table: labels are bytes and 0 is air.
    pub const MAX_MATERIALS: usize = 255;
    /// Most channels in a table.
    pub const MAX_CHANNELS: usize = 256;

    /// Checks and builds a table.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] naming the material when a coefficient is negative or not finite,
    /// `g` lies outside -0.99..=0.99, a channel is missing or a name repeats;
    /// [`VoxelError::Unsupported`] past the limits above.
    pub fn new(channel_names: Vec<String>, materials: Vec<Material>) -> Result<Self, VoxelError> {
        let channels = channel_names.len();
        if channels == 0 || materials.is_empty() {
            return Err(VoxelError::invalid("material table", "needs at least one channel and one material"));
        }
        if channels > Self::MAX_CHANNELS || materials.len() > Self::MAX_MATERIALS {
            return Err(VoxelError::unsupported(
                "material table",
                format!(
                    "{} materials over {channels} channels; at most {} over {}",
                    materials.len(),
                    Self::MAX_MATERIALS,
                    Self::MAX_CHANNELS
                ),
            ));
        }
        for (i, m) in materials.iter().enumerate() {
            if materials[..i].iter().any(|other| other.name == m.name) {
                return Err(VoxelError::invalid(format!("material {:?}", m.name), "the name is used twice"));
            }
            if !(-0.99..=0.99).contains(&m.g) {
                return Err(VoxelError::invalid(
                    format!("material {:?}, g", m.name),
                    format!("{} must lie within -0.99 to 0.99", m.g),
                ));
            }
            for (what, values) in [("sigma_s", &m.sigma_s), ("sigma_a", &m.sigma_a)] {
                if values.len() != channels {
                    return Err(VoxelError::invalid(
                        format!("material {:?}, {what}", m.name),
                        format!("has {} values for {channels} channels", values.len()),
                    ));
                }
                if let Some(bad) = values.iter().find(|v| !(v.is_finite() && **v >= 0.0)) {
                    return Err(VoxelError::invalid(
                        format!("material {:?}, {what}", m.name),
                        format!("{bad} per mm must be finite and at least 0"),
                    ));
                }
            }
        }
        Ok(Self { channel_names, materials })
    }

    /// The default cyan, magenta, yellow, black and white of a J750-class printer over linear
    /// R, G, B (after Elek et al. 2017; g = 0.4). Labels 1 to 5 in that order.
    pub fn cmykw() -> Self {
        let g = 0.4;
        let rows = [
            ("cyan", [0.05, 0.70, 0.98], [9.0, 4.5, 7.5]),
            ("magenta", [0.98, 0.10, 0.90], [2.5, 3.0, 10.0]),
            ("yellow", [0.997, 0.995, 0.15], [2.25, 3.75, 19.0]),
            ("black", [0.35, 0.35, 0.35], [5.0, 5.5, 6.5]),
            ("white", [0.9991, 0.9997, 0.999], [6.0, 9.0, 24.0]),
        ];
        Self {
            channel_names: ["R", "G", "B"].map(str::to_owned).to_vec(),
            materials: rows.iter().map(|(name, a, t)| Material::from_albedo(name, a, t, g)).collect(),
        }
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channel_names.len()
    }

    /// Channel names in order.
    pub fn channel_names(&self) -> &[String] {
        &self.channel_names
    }

    /// Number of materials; valid labels are `1..=len`.
    pub fn len(&self) -> usize {
        self.materials.len()
    }

    /// Always false: a table holds at least one material.
    pub fn is_empty(&self) -> bool {
        self.materials.is_empty()
    }

    /// Materials in label order, label 1 first.
    pub fn materials(&self) -> &[Material] {
        &self.materials
    }

    /// The material of a label; `None` for air and unknown labels.
    pub fn get(&self, label: u8) -> Option<&Material> {
        usize::from(label).checked_sub(1).and_then(|i| self.materials.get(i))
    }

    /// The label of a material by name.
    pub fn label_of(&self, name: &str) -> Option<u8> {
        self.materials.iter().position(|m| m.name == name).map(|i| i as u8 + 1)
    }

    /// Extinction sigma_s + sigma_a of a label and channel in 1/mm; 0 for air and unknown labels.
    pub fn sigma_t(&self, label: u8, channel: usize) -> f32 {
        self.get(label).map_or(0.0, |m| m.sigma_s[channel] + m.sigma_a[channel])
    }

    /// Single-scattering albedo of a label and channel; 0 where nothing interacts.
    pub fn albedo(&self, label: u8, channel: usize) -> f32 {
        self.get(label).map_or(0.0, |m| {
            let t = m.sigma_s[channel] + m.sigma_a[channel];
            if t > 0.0 { m.sigma_s[channel] / t } else { 0.0 }
        })
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for MaterialTable {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        struct Raw {
            channel_names: Vec<String>,
            materials: Vec<Material>,
        }
        let raw = Raw::deserialize(deserializer)?;
        MaterialTable::new(raw.channel_names, raw.materials).map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with(f: impl Fn(&mut Material)) -> Result<MaterialTable, VoxelError> {
        let table = MaterialTable::cmykw();
        let mut materials = table.materials().to_vec();
        f(&mut materials[1]);
        MaterialTable::new(table.channel_names().to_vec(), materials)
    }

    #[test]
    fn default_table_is_valid_and_ordered() {
        let table = with(|_| {}).unwrap();
        assert_eq!(table, MaterialTable::cmykw());
        assert!((table.sigma_t(5, 2) - 24.0).abs() < 1e-5);
        assert!((table.albedo(4, 1) - 0.35).abs() < 1e-6);
        assert_eq!(table.sigma_t(0, 0), 0.0);
        assert_eq!(table.get(6), None);
    }

    #[test]
    fn refuses_bad_coefficients_by_name() {
        for bad in [f32::NAN, f32::INFINITY, -1e-9] {
            let error = with(|m| m.sigma_a[2] = bad).unwrap_err();
            assert!(error.to_string().contains("magenta"), "{error}");
        }
        assert!(with(|m| m.g = 1.0).is_err());
        assert!(with(|m| m.name = "cyan".into()).is_err());
        assert!(with(|m| m.sigma_s.truncate(2)).is_err());
    }
}
