//! Measured patches: what each is made of, and the radiance it showed.

use std::path::Path;

use pellucid_voxel::Channels;

use super::quantity::{Columns, Quantity};
use super::table::{Row, Table};
use super::{Geometry, Stack};
use crate::ColorError;
use crate::spectrum::Illuminant;

/// A patch of a chart.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Its name on the chart.
    pub id: String,
    /// What it is made of.
    pub stack: Stack,
    /// Whether it checks a fit instead of being fitted.
    pub check: bool,
}

/// A measured patch.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// The patch.
    pub patch: Patch,
    /// Radiance L by channel, at least 0.
    pub radiance: Vec<f64>,
}

/// What measurements are and how they were made.
#[derive(Clone, Debug)]
pub struct ReadOptions {
    /// How patches were lit and seen.
    pub geometry: Geometry,
    /// Refractive index of the resin.
    pub refractive_index: f64,
    /// Whose white L\*a\*b\* and XYZ are relative to.
    pub illuminant: Illuminant,
    /// What patches are made of, for tables that only name them.
    pub chart: Vec<Patch>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            geometry: Geometry::default(),
            refractive_index: 1.5,
            illuminant: Illuminant::D50,
            chart: Vec::new(),
        }
    }
}

/// Measured patches over one set of channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurements {
    channels: Channels,
    list: Vec<Measurement>,
    quantity: Option<Quantity>,
    unmeasured: Vec<String>,
    clipped: Vec<String>,
}

/// No resin sends back more than falls on it; what instruments add by noise and calibration.
const MOST_RADIANCE: f64 = 1.05;

impl Measurements {
    /// Most bytes of a file.
    pub const MAX_FILE_BYTES: u64 = 64 << 20;

    /// Of radiances at hand. Those below 0, as colours beyond Rec.709 have them, are taken as 0: see
    /// [`Measurements::clipped`].
    ///
    /// # Errors
    /// [`ColorError::Invalid`] naming the patch for another number of values than channels, one that is not finite, or
    /// above 1.05: nothing sends back more than falls on it.
    pub fn new(channels: Channels, list: Vec<Measurement>) -> Result<Self, ColorError> {
        let channels = channels.checked()?;
        let mut measurements =
            Self { channels, list, quantity: None, unmeasured: Vec::new(), clipped: Vec::new() };
        let count = measurements.channels.count();
        for Measurement { patch, radiance } in &mut measurements.list {
            let fault = |reason: String| Err(ColorError::invalid(format!("patch {:?}", patch.id), reason));
            if radiance.len() != count {
                return fault(format!("{} values for {count} channels", radiance.len()));
            }
            if let Some(bad) = radiance.iter().find(|v| !v.is_finite() || **v > MOST_RADIANCE) {
                return fault(format!(
                    "a radiance of {bad:.3}, where 1 is all the light; look at scale, geometry and fluorescence"
                ));
            }
            if radiance.iter().any(|v| *v < 0.0) {
                measurements.clipped.push(patch.id.clone());
                radiance.iter_mut().for_each(|v| *v = v.max(0.0));
            }
        }
        Ok(measurements)
    }

    /// From a table in CGATS or separated by commas, semicolons or tabulators.
    ///
    /// | columns | hold |
    /// | --- | --- |
    /// | `patch`, `SAMPLE_ID` or `SAMPLE_NAME` | the patch's name |
    /// | `stack` | what it is made of, as [`Stack`] reads it; may be left out with [`ReadOptions::chart`] |
    /// | `use` | `fit` or `check`; without it pure layers are fitted and mixtures checked |
    /// | `SPECTRAL_NM_400` …, `400 nm` … | a spectrum's reflectance factors, as parts of 1 or per cent |
    /// | `XYZ_X`, `XYZ_Y`, `XYZ_Z` | XYZ, Y = 100 for a perfect diffuser |
    /// | `LAB_L`, `LAB_A`, `LAB_B` | L\*a\*b\* |
    /// | `RGB_R`, `RGB_G`, `RGB_B` | sRGB code values, 0 to 255 |
    ///
    /// The first of these four that has values counts: spectra make a table of bands, the others one of linear RGB.
    /// Patches without values are left out. A patch may stand in it more than once.
    ///
    /// ```
    /// use pellucid_color::calibration::{Measurements, ReadOptions};
    /// let text = "patch,stack,LAB_L,LAB_A,LAB_B\nA1,white 4 / black,92,-1,3\nA2,black,,,\n";
    /// let measurements = Measurements::parse(text, &ReadOptions::default())?;
    /// assert_eq!(measurements.list().len(), 1);
    /// assert_eq!(measurements.unmeasured(), ["A2"]);
    /// # Ok::<(), pellucid_color::ColorError>(())
    /// ```
    ///
    /// # Errors
    /// [`ColorError::Invalid`] naming line and column of what cannot be read, and as [`Measurements::new`];
    /// [`ColorError::Unsupported`] for wavelengths that are not evenly spaced.
    pub fn parse(text: &str, options: &ReadOptions) -> Result<Self, ColorError> {
        let table = Table::parse(text)?;
        let columns = Columns::find(&table)?;
        let rows = PatchColumns::find(&table, !options.chart.is_empty())?;
        let (mut list, mut unmeasured) = (Vec::new(), Vec::new());
        for row in &table.rows {
            let Some(factors) = columns.read(&table, row, options.illuminant)? else {
                unmeasured.push(rows.id(row));
                continue;
            };
            let radiance = factors
                .into_iter()
                .map(|v| options.geometry.radiance(v, options.refractive_index))
                .collect::<Result<_, _>>()?;
            list.push(Measurement { patch: rows.patch(row, &options.chart)?, radiance });
        }
        let mut measurements = Self::new(columns.channels, list)?;
        measurements.quantity = Some(columns.quantity);
        measurements.unmeasured = unmeasured;
        Ok(measurements)
    }

    /// [`Measurements::parse`] of a file of at most [`Measurements::MAX_FILE_BYTES`].
    ///
    /// # Errors
    /// As there, with the file's name before the rest; [`ColorError::Io`] when it cannot be read.
    pub fn load(path: impl AsRef<Path>, options: &ReadOptions) -> Result<Self, ColorError> {
        let path = path.as_ref();
        let text = pellucid_core::files::read_text_bounded(path, Self::MAX_FILE_BYTES)?;
        Self::parse(&text, options).map_err(|error| error.in_file(path))
    }

    /// What the channels are.
    pub fn channels(&self) -> &Channels {
        &self.channels
    }

    /// The measured patches, in the table's order.
    pub fn list(&self) -> &[Measurement] {
        &self.list
    }

    /// What a table held.
    pub fn quantity(&self) -> Option<Quantity> {
        self.quantity
    }

    /// Patches of a table that had no values.
    pub fn unmeasured(&self) -> &[String] {
        &self.unmeasured
    }

    /// Patches with a channel below 0, taken as 0: colours outside Rec.709, which three channels cannot hold.
    pub fn clipped(&self) -> &[String] {
        &self.clipped
    }
}

impl Patch {
    /// The patches of a chart's table: columns `patch`, `stack` and `use` of [`Measurements::parse`].
    ///
    /// # Errors
    /// [`ColorError::Invalid`] naming the line.
    pub fn parse_chart(text: &str) -> Result<Vec<Self>, ColorError> {
        let table = Table::parse(text)?;
        let rows = PatchColumns::find(&table, false)?;
        table.rows.iter().map(|row| rows.patch(row, &[])).collect()
    }
}

/// Where a table says what patches are.
struct PatchColumns {
    id: usize,
    stack: Option<usize>,
    used: Option<usize>,
}

impl PatchColumns {
    fn find(table: &Table, has_chart: bool) -> Result<Self, ColorError> {
        let missing = |column: &str, remedy: &str| {
            ColorError::invalid("measurements", format!("the column {column:?} is missing; {remedy}"))
        };
        let id = table.column(&["patch", "SAMPLE_ID", "SampleID", "SAMPLE_NAME"]);
        let stack = table.column(&["stack"]);
        if stack.is_none() && !has_chart {
            return Err(missing("stack", "give the chart's table too"));
        }
        Ok(Self {
            id: id.ok_or_else(|| missing("patch", "it names the patches"))?,
            stack,
            used: table.column(&["use"]),
        })
    }

    fn id(&self, row: &Row) -> String {
        row.cells[self.id].trim().to_owned()
    }

    fn patch(&self, row: &Row, chart: &[Patch]) -> Result<Patch, ColorError> {
        let id = self.id(row);
        let subject = || format!("measurements, line {}, patch {id:?}", row.line);
        let own = self.stack.map(|column| row.cells[column].trim()).filter(|text| !text.is_empty());
        let known = chart.iter().find(|patch| patch.id == id);
        let stack = match (own, known) {
            (Some(text), _) => text.parse::<Stack>().map_err(|error| within(subject(), error))?,
            (None, Some(patch)) => patch.stack.clone(),
            (None, None) if chart.is_empty() => {
                return Err(ColorError::invalid(subject(), "its stack is missing"));
            }
            (None, None) => return Err(ColorError::invalid(subject(), "the chart has no such patch")),
        };
        let check = match self.used.map(|column| row.cells[column].trim()).unwrap_or("") {
            "fit" => false,
            "check" => true,
            "" => {
                known.map_or_else(|| stack.layers().iter().any(|layer| layer.parts().len() > 1), |p| p.check)
            }
            other => {
                return Err(ColorError::invalid(subject(), format!("use {other:?}; \"fit\" or \"check\"")));
            }
        };
        Ok(Patch { id, stack, check })
    }
}

/// An error with where it is.
fn within(subject: String, error: ColorError) -> ColorError {
    match error {
        ColorError::Invalid(fault) => ColorError::invalid(subject, fault.to_string()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chart_tells_what_a_table_of_names_is_made_of() {
        let chart = "patch,use,x_mm,stack\nA1,fit,3,white 4 / black\nA2,check,9,cyan 0.1 / white 1 / black\n";
        let chart = Patch::parse_chart(chart).unwrap();
        let options = ReadOptions { chart, geometry: Geometry::Radiance, ..ReadOptions::default() };
        let cgats = "CGATS.17\nBEGIN_DATA_FORMAT\nSAMPLE_ID XYZ_X XYZ_Y XYZ_Z\nEND_DATA_FORMAT\nBEGIN_DATA\n\
                     A2 48.2106 50 41.2594\nA1 96.4212 100 82.5188\nEND_DATA\n";
        let measured = Measurements::parse(cgats, &options).unwrap();
        assert_eq!(measured.quantity(), Some(Quantity::Xyz));
        let [a2, a1] = measured.list() else { panic!("{measured:?}") };
        assert!(a2.patch.check && !a1.patch.check);
        assert_eq!(a2.patch.stack.materials(), ["cyan", "white", "black"]);
        assert!(a2.radiance.iter().all(|v| (v - 0.5).abs() < 1e-4));
        let unknown = cgats.replace("A2", "B7");
        let error = Measurements::parse(&unknown, &options).unwrap_err().to_string();
        assert!(error.contains("line 6, patch \"B7\"") && error.contains("no such patch"), "{error}");
    }

    #[test]
    fn colours_that_cannot_be_are_told() {
        let read = |rows: &str| {
            Measurements::parse(&format!("patch,stack,L,a,b\n{rows}\n"), &ReadOptions::default())
        };
        let error = read("A1,white,104,0,0").unwrap_err().to_string();
        assert!(error.contains("patch \"A1\"") && error.contains("all the light"), "{error}");
        assert!(read("A1,,50,0,0").unwrap_err().to_string().contains("its stack is missing"));
        assert!(read("A1,cyan 0 / white,50,0,0").unwrap_err().to_string().contains("line 2"));
        let saturated = read("A1,cyan 0.2 / white,55,-60,-40").unwrap();
        assert_eq!(saturated.clipped(), ["A1"]);
        assert!(saturated.list()[0].radiance.iter().all(|v| *v >= 0.0));
    }

    #[test]
    fn without_a_word_mixtures_check() {
        let text =
            "patch,stack,use,R,G,B\nA,50% a + 50% b 1 / a,,9,9,9\nB,a 1 / b,,9,9,9\nC,a 1 / b,check,9,9,9\n";
        let measured = Measurements::parse(text, &ReadOptions::default()).unwrap();
        assert_eq!(measured.list().iter().map(|m| m.patch.check).collect::<Vec<_>>(), [true, false, true]);
        assert!(
            Measurements::parse(&text.replace(",,9", ",maybe,9"), &ReadOptions::default())
                .unwrap_err()
                .to_string()
                .contains("maybe")
        );
    }
}
