//! Material tables as JSON: readable files, and errors that say where and what in plain words.

use std::fmt;

use serde::de::{self, Deserialize, DeserializeSeed, Deserializer, SeqAccess, Visitor};

use crate::{Anisotropy, Channels, Material, MaterialTable, MeasuredSpectra, VoxelError, WIDEST_GAP_NM};

impl MaterialTable {
    /// From JSON text:
    /// `{"channel_names": ["R", "G", "B"], "materials": [{"name": …, "sigma_s": […], "sigma_a": […], "g": …}, …]}`.
    /// Instead of names, `"channels": {"bands": {"start_nm": 400, "step_nm": 10, "count": 31}}` is possible, and
    /// `"wavelengths_nm": […]`, for all materials or in each: measured spectra, which become [`MeasuredSpectra::BANDS`]
    /// where no gap is wider than [`WIDEST_GAP_NM`]. `g` is a number, or a list like the others.
    ///
    /// ```
    /// let error = pellucid_voxel::MaterialTable::from_json(
    ///     r#"{"channel_names": ["grey"], "materials": [{"name": "ink", "sigma_s": [4], "sigma_a": ["-"], "g": 0}]}"#,
    /// );
    /// assert_eq!(
    ///     error.unwrap_err().to_string(),
    ///     "invalid material table: material 1: sigma_a: found text \"-\" where a number is expected (line 1, column 89)"
    /// );
    /// ```
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] naming line and column of what is no such table, and as [`MaterialTable::new`].
    pub fn from_json(text: &str) -> Result<Self, VoxelError> {
        parse(text)
    }

    /// From a JSON file of at most [`MaterialTable::MAX_FILE_BYTES`]; see [`MaterialTable::from_json`].
    ///
    /// # Errors
    /// [`VoxelError::Io`] where the file cannot be read or is larger; else as [`MaterialTable::from_json`], with the
    /// file's name before the rest.
    pub fn load(path: impl AsRef<std::path::Path>) -> Result<Self, VoxelError> {
        let path = path.as_ref();
        let text = pellucid_core::files::read_text_bounded(path, Self::MAX_FILE_BYTES)?;
        Self::from_json(&text).map_err(|error| error.in_file(path))
    }
}

impl MeasuredSpectra {
    /// From JSON text: a material table with `"wavelengths_nm"`, for all materials or in each, in place of channels.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] naming line and column of what is no such table, and as [`MeasuredSpectra::new`].
    pub fn from_json(text: &str) -> Result<Self, VoxelError> {
        raw(text)?.measured()
    }
}

/// A finite or infinite number, said so where it is something else.
struct Number(f64);

impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Plain;
        impl Visitor<'_> for Plain {
            type Value = f64;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number")
            }
            fn visit_f64<E: de::Error>(self, v: f64) -> Result<f64, E> {
                Ok(v)
            }
            fn visit_u64<E: de::Error>(self, v: u64) -> Result<f64, E> {
                Ok(v as f64)
            }
            fn visit_i64<E: de::Error>(self, v: i64) -> Result<f64, E> {
                Ok(v as f64)
            }
        }
        deserializer.deserialize_f64(Plain).map(Number)
    }
}

/// Names the field in an error and keeps its place: `serde_json` reads that from the end of the text.
fn within<E: de::Error>(field: impl fmt::Display, error: impl fmt::Display) -> E {
    E::custom(format_args!("{field}: {error}"))
}

/// A list whose errors name the field.
struct Numbers(&'static str);

impl<'de> DeserializeSeed<'de> for Numbers {
    type Value = Vec<f32>;
    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Vec<f32>, D::Error> {
        let field = self.0;
        deserializer.deserialize_seq(self).map_err(|e| within(field, e))
    }
}

impl<'de> Visitor<'de> for Numbers {
    type Value = Vec<f32>;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a list of numbers, one a channel")
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<f32>, A::Error> {
        let mut values = Vec::new();
        while let Some(Number(value)) = list.next_element()? {
            values.push(value as f32);
        }
        Ok(values)
    }
}

fn sigma_s<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f32>, D::Error> {
    Numbers("sigma_s").deserialize(deserializer)
}

fn sigma_a<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<f32>, D::Error> {
    Numbers("sigma_a").deserialize(deserializer)
}

/// A number, or a list of numbers.
struct Cosines;

impl<'de> Visitor<'de> for Cosines {
    type Value = Anisotropy;
    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, or a list of numbers, one a channel")
    }
    fn visit_f64<E: de::Error>(self, v: f64) -> Result<Anisotropy, E> {
        Ok(Anisotropy::Uniform(v as f32))
    }
    fn visit_u64<E: de::Error>(self, v: u64) -> Result<Anisotropy, E> {
        self.visit_f64(v as f64)
    }
    fn visit_i64<E: de::Error>(self, v: i64) -> Result<Anisotropy, E> {
        self.visit_f64(v as f64)
    }
    fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Anisotropy, A::Error> {
        Numbers("g").visit_seq(list).map(Anisotropy::PerChannel)
    }
}

fn g<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Anisotropy, D::Error> {
    deserializer.deserialize_any(Cosines).map_err(|e| within("g", e))
}

fn name<'de, D: Deserializer<'de>>(deserializer: D) -> Result<String, D::Error> {
    String::deserialize(deserializer).map_err(|e| within("name", e))
}

/// A material, and its own wavelengths where it has some.
struct RawMaterial {
    wavelengths_nm: Option<Vec<f64>>,
    material: Material,
}

fn wavelengths_nm<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<f64>>, D::Error> {
    let list = Vec::<Number>::deserialize(deserializer).map_err(|e| within("wavelengths_nm", e))?;
    Ok(Some(list.into_iter().map(|n| n.0).collect()))
}

impl<'de> Deserialize<'de> for Material {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let RawMaterial { wavelengths_nm, material } = RawMaterial::deserialize(deserializer)?;
        match wavelengths_nm {
            None => Ok(material),
            Some(_) => Err(within("wavelengths_nm", "only a table knows which bands they become")),
        }
    }
}

impl<'de> Deserialize<'de> for RawMaterial {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(expecting = "a material with name, sigma_s, sigma_a and g")]
        struct Raw {
            #[serde(deserialize_with = "name")]
            name: String,
            #[serde(deserialize_with = "sigma_s")]
            sigma_s: Vec<f32>,
            #[serde(deserialize_with = "sigma_a")]
            sigma_a: Vec<f32>,
            #[serde(deserialize_with = "g")]
            g: Anisotropy,
            #[serde(default, deserialize_with = "wavelengths_nm")]
            wavelengths_nm: Option<Vec<f64>>,
        }
        let Raw { name, sigma_s, sigma_a, g, wavelengths_nm } = Raw::deserialize(deserializer)?;
        Ok(Self { wavelengths_nm, material: Material { name, sigma_s, sigma_a, g } })
    }
}

/// The list of materials; an error names the material by its place, as its name may not be read yet.
fn materials<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<RawMaterial>, D::Error> {
    struct List;
    impl<'de> Visitor<'de> for List {
        type Value = Vec<RawMaterial>;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of materials")
        }
        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Vec<RawMaterial>, A::Error> {
            let mut found = Vec::new();
            loop {
                let place = found.len() + 1;
                match list.next_element().map_err(|e| within(format_args!("material {place}"), e))? {
                    Some(material) => found.push(material),
                    None => return Ok(found),
                }
            }
        }
    }
    deserializer.deserialize_seq(List)
}

impl<'de> Deserialize<'de> for Channels {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(expecting = "bands with start_nm, step_nm and count")]
        struct Bands {
            start_nm: Number,
            step_nm: Number,
            count: Number,
        }
        #[derive(serde::Deserialize)]
        #[serde(rename_all = "snake_case", expecting = "\"rgb\", {\"bands\": …} or {\"named\": …}")]
        enum Raw {
            Rgb,
            Bands(Bands),
            Named(Vec<String>),
        }
        let channels = match Raw::deserialize(deserializer).map_err(|e| within("channels", e))? {
            Raw::Rgb => Self::Rgb,
            Raw::Bands(Bands { start_nm, step_nm, count: Number(count) }) => {
                if count.fract() != 0.0 || !(0.0..=f64::from(u32::MAX)).contains(&count) {
                    return Err(within("channels, count", format_args!("{count} is no number of bands")));
                }
                Self::Bands { start_nm: start_nm.0, step_nm: step_nm.0, count: count as u32 }
            }
            Raw::Named(names) => Self::Named(names),
        };
        channels.checked().map_err(de::Error::custom)
    }
}

/// A table as it stands in a file.
#[derive(serde::Deserialize)]
#[serde(expecting = "a material table with channel_names (or channels, or wavelengths_nm) and materials")]
struct RawTable {
    channel_names: Option<Vec<String>>,
    channels: Option<Channels>,
    #[serde(default, deserialize_with = "wavelengths_nm")]
    wavelengths_nm: Option<Vec<f64>>,
    #[serde(deserialize_with = "materials")]
    materials: Vec<RawMaterial>,
}

impl RawTable {
    fn checked(self) -> Result<MaterialTable, VoxelError> {
        if self.wavelengths_nm.is_some() || self.materials.iter().any(|m| m.wavelengths_nm.is_some()) {
            return self.measured()?.to_bands(&MeasuredSpectra::BANDS, WIDEST_GAP_NM);
        }
        let materials = self.materials.into_iter().map(|m| m.material).collect();
        match (self.channel_names, self.channels) {
            (Some(names), None) => MaterialTable::new(names, materials),
            (None, Some(channels)) => MaterialTable::over(channels, materials),
            (None, None) => Err(VoxelError::invalid(
                "channel_names",
                "missing; give names such as [\"R\", \"G\", \"B\"], or \"channels\"",
            )),
            (Some(_), Some(_)) => {
                Err(VoxelError::invalid("channel_names", "given beside \"channels\"; give one of the two"))
            }
        }
    }
}

impl RawTable {
    fn measured(self) -> Result<MeasuredSpectra, VoxelError> {
        if self.channel_names.is_some() || self.channels.is_some() {
            let reason = "given beside channels; give one of the two";
            return Err(VoxelError::invalid("wavelengths_nm", reason));
        }
        let materials = self.materials.into_iter().map(|RawMaterial { wavelengths_nm, material }| {
            match (wavelengths_nm, &self.wavelengths_nm) {
                (Some(own), _) => Ok((own, material)),
                (None, Some(all)) => Ok((all.clone(), material)),
                (None, None) => Err(VoxelError::invalid(
                    format!("material {:?}, wavelengths_nm", material.name),
                    "missing; give a list here, or one for all materials",
                )),
            }
        });
        MeasuredSpectra::new(materials.collect::<Result<_, _>>()?)
    }
}

impl<'de> Deserialize<'de> for MaterialTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        RawTable::deserialize(deserializer)?.checked().map_err(de::Error::custom)
    }
}

impl serde::Serialize for MaterialTable {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut table = serializer.serialize_struct("MaterialTable", 2)?;
        // Names tell what the channels are, but for wavelengths that a name would round.
        if Channels::of_names(self.channel_names()) == *self.spectrum() {
            table.serialize_field("channel_names", self.channel_names())?;
        } else {
            table.serialize_field("channels", self.spectrum())?;
        }
        table.serialize_field("materials", self.materials())?;
        table.end()
    }
}

/// Parses a table.
pub(crate) fn parse(text: &str) -> Result<MaterialTable, VoxelError> {
    raw(text)?.checked()
}

fn raw(text: &str) -> Result<RawTable, VoxelError> {
    serde_json::from_str(text)
        .map_err(|error| VoxelError::invalid("material table", pellucid_core::json::plain(&error)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHIPPED: &str = include_str!("../materials/cmykw.json");

    #[test]
    fn the_shipped_file_is_the_built_in_table() {
        assert_eq!(MaterialTable::from_json(SHIPPED).unwrap(), MaterialTable::cmykw());
    }

    fn material(channels: usize) -> Material {
        Material {
            name: "white".into(),
            sigma_s: vec![6.0; channels],
            sigma_a: vec![0.1; channels],
            g: 0.4.into(),
        }
    }

    #[test]
    fn tables_of_any_channels_round_trip() {
        let bands = |start_nm, step_nm, count| Channels::Bands { start_nm, step_nm, count };
        for channels in [
            Channels::Rgb,
            Channels::Named(vec!["grey".into()]),
            bands(400.0, 75.0, 5),
            bands(400.0, 10.0, 31),
            bands(400.0, 300.0 / 7.0, 8),
            bands(550.0, 10.0, 1),
            Channels::Named((0..256).map(|c| format!("c{c}")).collect()),
        ] {
            let table = MaterialTable::over(channels.clone(), vec![material(channels.count())]).unwrap();
            let text = serde_json::to_string(&table).unwrap();
            let back = MaterialTable::from_json(&text).unwrap();
            assert_eq!(back, table, "{text}");
            assert_eq!(back.spectrum(), &channels);
        }
        let text = serde_json::to_string(&MaterialTable::cmykw()).unwrap();
        assert!(text.starts_with(r#"{"channel_names":["R","G","B"],"materials":[{"name":"cyan","#), "{text}");
    }

    #[test]
    fn measured_spectra_become_bands() {
        let list = |step: usize, of: &dyn Fn(usize) -> f64| {
            let values = (390..=710).step_by(step).map(|nm| of(nm).to_string()).collect::<Vec<_>>();
            format!("[{}]", values.join(", "))
        };
        let own = list(20, &|nm| nm as f64);
        let text = format!(
            r#"{{"wavelengths_nm": {}, "materials": [
            {{"name": "a", "sigma_s": {}, "sigma_a": {}, "g": 0.4}},
            {{"name": "b", "wavelengths_nm": {own}, "sigma_s": {own}, "sigma_a": {own}, "g": {}}}]}}"#,
            list(10, &|nm| nm as f64),
            list(10, &|nm| nm as f64 * 0.01),
            list(10, &|_| 0.5),
            list(20, &|nm| nm as f64 * 0.001),
        );
        let table = MaterialTable::from_json(&text).unwrap();
        assert_eq!(table.spectrum(), &MeasuredSpectra::BANDS);
        assert_eq!((table.materials()[0].sigma_s[15], table.materials()[1].sigma_a[30]), (5.5, 700.0));
        assert!((table.materials()[1].g.at(10) - 0.5).abs() < 1e-6);
        let back = MaterialTable::from_json(&serde_json::to_string(&table).unwrap()).unwrap();
        assert_eq!(back, table);
        let refused = |from: &str, to: &str| {
            MaterialTable::from_json(&text.replacen(from, to, 1)).unwrap_err().to_string()
        };
        assert!(refused("{", "{\"channel_names\": [\"R\"], ").contains("one of the two"));
        assert!(refused("[390, 400, 410, 420, 430", "[390, 430").contains("\"a\", sigma_s"));
        assert!(refused("\"wavelengths_nm\"", "\"nm\"").contains("material \"a\", wavelengths_nm"));
    }

    #[test]
    fn bands_may_be_told_in_words_or_names() {
        let one = r#""materials": [{"name": "w", "sigma_s": [1, 2], "sigma_a": [0.1, 0.2], "g": 0}]"#;
        let told =
            format!(r#"{{"channels": {{"bands": {{"start_nm": 450, "step_nm": 100, "count": 2}}}}, {one}}}"#);
        let named = format!(r#"{{"channel_names": ["450 nm", "550 nm"], {one}}}"#);
        assert_eq!(MaterialTable::from_json(&told), MaterialTable::from_json(&named));
        let table = MaterialTable::from_json(&told).unwrap();
        assert_eq!(table.spectrum(), &Channels::Bands { start_nm: 450.0, step_nm: 100.0, count: 2 });
    }

    #[test]
    fn errors_name_place_material_and_field_in_plain_words() {
        let change = |from: &str, to: &str| {
            assert!(SHIPPED.contains(from), "{from}");
            MaterialTable::from_json(&SHIPPED.replacen(from, to, 1)).unwrap_err().to_string()
        };
        for (from, to, parts) in [
            ("8.55", "\"8.55\"", &["line 4, column", "material 1: sigma_a: found text", "a number"][..]),
            ("[2.45, 0.3, 9.0]", "2.45", &["line 5", "material 2", "sigma_s", "a list of numbers"]),
            ("\"g\": 0.4", "\"g\": null", &["line 4", "material 1", "g: ", "a number"]),
            ("\"sigma_s\"", "\"sigma\"", &["line 4", "material 1", "missing field \"sigma_s\""]),
            ("\"cyan\"", "7", &["line 4", "material 1", "name", "text is expected"]),
            ("\"channel_names\": [\"R\", \"G\", \"B\"],", "", &["channel_names", "missing"]),
            ("\"channel_names\"", "\"channels\": \"rgb\", \"channel_names\"", &["one of the two"]),
            ("[\"R\", \"G\", \"B\"]", "3", &["line 2", "a list"]),
            ("0.45, ", "", &["material \"cyan\", sigma_s", "2 values for 3 channels"]),
            ("0.45", "-0.45", &["material \"cyan\", sigma_s", "-0.45", "at least 0"]),
            ("\"magenta\"", "\"cyan\"", &["material \"cyan\"", "used twice"]),
            ("\"g\": 0.4", "\"g\": 1", &["material \"cyan\", g", "-0.99 to 0.99"]),
            ("\"materials\": [", "\"materials\": {", &["line 3", "materials"]),
        ] {
            let text = change(from, to);
            assert!(parts.iter().all(|part| text.contains(part)), "{from} -> {to}: {text}");
            for rust in ["f32", "f64", "u32", "usize", "struct", "sequence", "EOF", "variant"] {
                assert!(!text.contains(rust), "{text}");
            }
        }
        let cut = MaterialTable::from_json(&SHIPPED[..200]).unwrap_err().to_string();
        assert!(cut.contains("the text ends within") && cut.contains("line 5"), "{cut}");
        for bands in [
            r#"{"bands": {"start_nm": 400, "step_nm": 10, "count": 2.5}}"#,
            r#"{"bands": {"start_nm": 400, "step_nm": 10, "count": -1}}"#,
            r#"{"bands": {"start_nm": "a", "step_nm": 10, "count": 3}}"#,
            r#"{"bands": {"start_nm": 400, "count": 3}}"#,
            r#"{"spectrum": 3}"#,
            "7",
        ] {
            let text = format!(r#"{{"channels": {bands}, "materials": []}}"#);
            let error = MaterialTable::from_json(&text).unwrap_err().to_string();
            assert!(error.contains("line 1") && error.contains("channels"), "{error}");
            for rust in ["f64", "u32", "struct", "enum"] {
                assert!(!error.contains(rust), "{error}");
            }
        }
    }

    #[test]
    fn files_are_named_in_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("inks.json");
        let error = MaterialTable::load(&path).unwrap_err();
        assert!(matches!(&error, VoxelError::Io(e) if e.path == path), "{error}");
        std::fs::write(&path, SHIPPED.replacen("0.45", "-1", 1)).unwrap();
        let error = MaterialTable::load(&path).unwrap_err().to_string();
        assert!(error.contains("inks.json") && error.contains("cyan"), "{error}");
        std::fs::write(&path, SHIPPED).unwrap();
        assert_eq!(MaterialTable::load(&path).unwrap(), MaterialTable::cmykw());
        std::fs::write(&path, vec![b' '; MaterialTable::MAX_FILE_BYTES as usize + 1]).unwrap();
        assert!(matches!(MaterialTable::load(&path), Err(VoxelError::Io(_))));
    }
}
