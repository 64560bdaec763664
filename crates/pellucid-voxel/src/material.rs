//! Print materials: scattering and absorption per channel.

use crate::{Anisotropy, Channels, VoxelError};

/// One print material. Labels in a grid are 1-based positions in a [`MaterialTable`].
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Material {
    /// Display name, unique in its table.
    pub name: String,
    /// Scattering coefficient per channel, 1/mm, finite and at least 0.
    pub sigma_s: Vec<f32>,
    /// Absorption coefficient per channel, 1/mm, finite and at least 0.
    pub sigma_a: Vec<f32>,
    /// Henyey-Greenstein mean cosine, within -0.99..=0.99.
    pub g: Anisotropy,
}

impl Material {
    /// From single-scattering albedo and extinction per channel, as measurements are tabulated.
    pub fn from_albedo(name: &str, albedo: &[f64], sigma_t: &[f64], g: impl Into<Anisotropy>) -> Self {
        let pairs = || albedo.iter().zip(sigma_t);
        Self {
            name: name.to_owned(),
            sigma_s: pairs().map(|(a, t)| (a * t) as f32).collect(),
            sigma_a: pairs().map(|(a, t)| ((1.0 - a) * t) as f32).collect(),
            g: g.into(),
        }
    }
}

/// The materials of a print, in label order, over one set of channels.
///
/// How many materials are possible:
///
/// | where | most | why |
/// | --- | --- | --- |
/// | a table | 255 | labels are bytes and 0 is air |
/// | the path tracer | 15 in use | labels are packed into four bits |
/// | a refinement | 16 inks | thresholds of a voxel are kept in a fixed block |
/// | a mixture model | 8 | the starts of its inverse grow with a power of the number |
/// | a printer | its profile says | a J750 takes 6 |
///
/// Channels may be 1 to 256 everywhere.
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
pub struct MaterialTable {
    channels: Channels,
    channel_names: Vec<String>,
    materials: Vec<Material>,
}

impl MaterialTable {
    /// Most materials in a table: labels are bytes and 0 is air.
    pub const MAX_MATERIALS: usize = 255;
    /// Most channels in a table.
    pub const MAX_CHANNELS: usize = Channels::MAX;
    /// Most bytes of a file that [`MaterialTable::load`] reads.
    pub const MAX_FILE_BYTES: u64 = 16 << 20;

    /// Checks and builds a table over channels whose names say what they are: see [`Channels::of_names`].
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] naming the material when a coefficient is negative or not finite,
    /// a `g` lies outside -0.99..=0.99, a channel is missing or a name repeats;
    /// [`VoxelError::Unsupported`] past the limits above.
    pub fn new(channel_names: Vec<String>, materials: Vec<Material>) -> Result<Self, VoxelError> {
        let channels = Channels::of_names(&channel_names).checked()?;
        check(channels.count(), &materials)?;
        Ok(Self { channels, channel_names, materials })
    }

    /// Checks and builds a table over given channels.
    ///
    /// ```
    /// use pellucid_voxel::{Channels, Material, MaterialTable};
    /// let five = Channels::Bands { start_nm: 420.0, step_nm: 65.0, count: 5 };
    /// let grey = Material { name: "grey".into(), sigma_s: vec![4.0; 5], sigma_a: vec![0.5; 5], g: 0.4.into() };
    /// let table = MaterialTable::over(five.clone(), vec![grey])?;
    /// assert_eq!((table.channels(), table.spectrum()), (5, &five));
    /// assert_eq!(table.channel_names()[1], "485 nm");
    /// # Ok::<(), pellucid_voxel::VoxelError>(())
    /// ```
    ///
    /// # Errors
    /// As [`MaterialTable::new`], and for channels out of range ([`Channels::checked`]).
    pub fn over(channels: Channels, materials: Vec<Material>) -> Result<Self, VoxelError> {
        // Names that say more than `Named` count for what they say, whichever way they came.
        let channels = match channels {
            Channels::Named(names) => Channels::of_names(&names),
            other => other,
        };
        let channels = channels.checked()?;
        check(channels.count(), &materials)?;
        Ok(Self { channel_names: channels.names(), channels, materials })
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
            channels: Channels::Rgb,
            channel_names: Channels::Rgb.names(),
            materials: rows.iter().map(|(name, a, t)| Material::from_albedo(name, a, t, g)).collect(),
        }
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channel_names.len()
    }

    /// What the channels are.
    pub fn spectrum(&self) -> &Channels {
        &self.channels
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

/// Checks number, names and coefficients of materials over `channels` channels.
pub(crate) fn check(channels: usize, materials: &[Material]) -> Result<(), VoxelError> {
    if materials.is_empty() {
        return Err(VoxelError::invalid("materials", "there are none; give at least one"));
    }
    if materials.len() > MaterialTable::MAX_MATERIALS {
        let text = format!("{}; at most {}", materials.len(), MaterialTable::MAX_MATERIALS);
        return Err(VoxelError::unsupported("materials", text));
    }
    for (i, m) in materials.iter().enumerate() {
        if materials[..i].iter().any(|other| other.name == m.name) {
            return Err(VoxelError::invalid(format!("material {:?}", m.name), "the name is used twice"));
        }
        if let Some(bad) = m.g.values().iter().find(|g| !(-0.99..=0.99).contains(*g)) {
            return Err(VoxelError::invalid(
                format!("material {:?}, g", m.name),
                format!("{bad} must lie within -0.99 to 0.99"),
            ));
        }
        if let Anisotropy::PerChannel(list) = &m.g
            && list.len() != channels
        {
            return Err(VoxelError::invalid(
                format!("material {:?}, g", m.name),
                format!("has {} values for {channels} channels; give as many, or one number", list.len()),
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
    Ok(())
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
        assert!(with(|m| m.g = 1.0.into()).is_err());
        assert!(with(|m| m.g = Anisotropy::PerChannel(vec![0.1, -1.0, 0.2])).is_err());
        assert!(with(|m| m.g = Anisotropy::PerChannel(vec![0.1, 0.2])).is_err());
        assert!(with(|m| m.g = Anisotropy::PerChannel(vec![0.1, 0.2, 0.3])).is_ok());
        assert!(with(|m| m.name = "cyan".into()).is_err());
        assert!(with(|m| m.sigma_s.truncate(2)).is_err());
    }
}
