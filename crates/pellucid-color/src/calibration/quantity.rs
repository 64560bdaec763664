//! Which columns of a table hold colour, and what they say as reflectance factors.

use pellucid_voxel::Channels;

use super::table::{Row, Table};
use crate::ColorError;
use crate::space::{Lab, Xyz, srgb_decode};
use crate::spectrum::{Conditions, Illuminant};

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize), serde(rename_all = "snake_case"))]
pub enum Quantity {
    /// Reflectance factors at evenly spaced wavelengths.
    Spectrum,
    /// CIE XYZ, Y = 100 for a perfect diffuser.
    Xyz,
    /// CIE L\*a\*b\*.
    Lab,
    /// sRGB code values, 0 to 255.
    Rgb,
}

/// Largest number that can be a reflectance factor; above it, all of a table are per cent.
const MOST_FACTOR: f64 = 2.0;

/// The columns of a quantity.
pub(super) struct Columns {
    pub quantity: Quantity,
    at: Vec<usize>,
    pub channels: Channels,
    scale: f64,
}

impl Columns {
    /// The most telling quantity of which the table has values: spectra, then XYZ, Lab and RGB.
    pub fn find(table: &Table) -> Result<Self, ColorError> {
        let named = |names: [&[&str]; 3]| names.iter().map(|n| table.column(n)).collect::<Option<Vec<_>>>();
        let xyz = named([&["XYZ_X", "X"], &["XYZ_Y", "Y"], &["XYZ_Z", "Z"]]);
        let lab = named([
            &["LAB_L", "L", "L*", "CIE_L"],
            &["LAB_A", "a", "a*", "CIE_A"],
            &["LAB_B", "b*", "CIE_B"],
        ])
        .or_else(|| named([&["L"], &["a"], &["b"]]));
        let rgb = named([&["RGB_R", "R", "red"], &["RGB_G", "G", "green"], &["RGB_B", "B", "blue"]]);
        let (bands, channels) = spectrum(table)?;
        let known =
            [(Quantity::Spectrum, bands), (Quantity::Xyz, xyz), (Quantity::Lab, lab), (Quantity::Rgb, rgb)];
        for (quantity, at) in known {
            let Some(at) = at else { continue };
            let filled = |row: &Row| at.iter().any(|&c| !row.cells[c].trim().is_empty());
            if !table.rows.iter().any(filled) {
                continue;
            }
            let mut columns = Self { quantity, at, channels: Channels::Rgb, scale: 1.0 };
            if quantity == Quantity::Spectrum {
                columns.channels = channels;
                columns.scale = columns.factor_scale(table)?;
            }
            return Ok(columns);
        }
        Err(ColorError::invalid(
            "measurements",
            "no colours in it; columns LAB_L, LAB_A, LAB_B (or XYZ_X …, RGB_R …, SPECTRAL_NM_400 …) must hold them",
        ))
    }

    fn factor_scale(&self, table: &Table) -> Result<f64, ColorError> {
        let mut most = 0.0f64;
        for row in &table.rows {
            for &column in &self.at {
                most = most.max(table.number(row, column)?.unwrap_or(0.0));
            }
        }
        Ok(if most > MOST_FACTOR { 0.01 } else { 1.0 })
    }

    /// Reflectance factors by channel: bands, or linear Rec.709 under D65. `None` for a row without values.
    pub fn read(
        &self,
        table: &Table,
        row: &Row,
        illuminant: Illuminant,
    ) -> Result<Option<Vec<f64>>, ColorError> {
        let values =
            self.at.iter().map(|&column| table.number(row, column)).collect::<Result<Vec<_>, _>>()?;
        if values.iter().all(Option::is_none) {
            return Ok(None);
        }
        let Some(values) = values.into_iter().collect::<Option<Vec<f64>>>() else {
            let subject = format!("measurements, line {}", row.line);
            return Err(ColorError::invalid(subject, "some values of a colour are missing"));
        };
        let white = match illuminant {
            Illuminant::D50 => Xyz::D50,
            Illuminant::D65 => Xyz::D65,
            Illuminant::E => Xyz::E,
            Illuminant::A | Illuminant::F11 | Illuminant::Led => Conditions::from(illuminant).white(),
        };
        let seen = |xyz: Xyz| xyz.adapt(white, Xyz::D65).to_linear_rgb().to_vec();
        Ok(Some(match (self.quantity, values.as_slice()) {
            (Quantity::Xyz, &[x, y, z]) => seen(Xyz { x: x / 100.0, y: y / 100.0, z: z / 100.0 }),
            (Quantity::Lab, &[l, a, b]) => seen(Lab { l, a, b }.to_xyz(white)),
            (Quantity::Rgb, codes) => {
                if let Some(bad) = codes.iter().find(|v| !(0.0..=255.0).contains(*v)) {
                    let subject = format!("measurements, line {}", row.line);
                    return Err(ColorError::invalid(
                        subject,
                        format!("{bad} is no sRGB code value; they are 0 to 255"),
                    ));
                }
                codes.iter().map(|code| srgb_decode(code / 255.0)).collect()
            }
            (_, factors) => factors.iter().map(|v| v * self.scale).collect(),
        }))
    }
}

/// The columns named after wavelengths, such as `SPECTRAL_NM_400`, `SPEC_400`, `NM_400`, `400 nm`, `400`, and what
/// they are as channels.
fn spectrum(table: &Table) -> Result<(Option<Vec<usize>>, Channels), ColorError> {
    let at: Vec<(usize, f64)> =
        table.columns.iter().enumerate().filter_map(|(i, name)| Some((i, wavelength(name)?))).collect();
    if at.len() < 2 {
        return Ok((None, Channels::Rgb));
    }
    let names: Vec<String> = at.iter().map(|(_, nm)| format!("{nm} nm")).collect();
    let channels = Channels::of_names(&names);
    if !matches!(channels, Channels::Bands { .. }) {
        let reason = format!("wavelengths {} are not evenly spaced; resample them", names.join(", "));
        return Err(ColorError::unsupported("measurements", reason));
    }
    Ok((Some(at.into_iter().map(|(i, _)| i).collect()), channels.checked()?))
}

fn wavelength(column: &str) -> Option<f64> {
    let name = column.trim().to_ascii_lowercase();
    let prefixes = ["spectral_nm_", "spectral_nm", "spectral_", "spec_", "nm_", "nm", "r_", "r"];
    let name = prefixes.iter().find_map(|prefix| name.strip_prefix(prefix)).unwrap_or(&name);
    let name = name.strip_suffix("nm").unwrap_or(name).trim_end();
    name.parse().ok().filter(|nm| (300.0..=900.0).contains(nm))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, illuminant: Illuminant) -> Result<(Quantity, Option<Vec<f64>>), ColorError> {
        let table = Table::parse(text)?;
        let columns = Columns::find(&table)?;
        Ok((columns.quantity, columns.read(&table, &table.rows[0], illuminant)?))
    }

    #[test]
    fn white_is_one_in_every_quantity() {
        for (text, illuminant) in [
            ("LAB_L,LAB_A,LAB_B\n100,0,0\n", Illuminant::D50),
            ("L,a,b\n100,0,0\n", Illuminant::D65),
            ("L*,a*,b*\n100,0,0\n", Illuminant::E),
            ("XYZ_X,XYZ_Y,XYZ_Z\n96.4212,100,82.5188\n", Illuminant::D50),
            ("X,Y,Z\n95.0456,100,108.9058\n", Illuminant::D65),
            ("R,G,B\n255,255,255\n", Illuminant::D50),
            ("RGB_R,RGB_G,RGB_B,LAB_L,LAB_A,LAB_B\n255,255,255,,,\n", Illuminant::D50),
            ("SPECTRAL_NM_400,SPECTRAL_NM_550,SPECTRAL_NM_700\n1,1,1\n", Illuminant::D50),
            ("400 nm,550 nm,700 nm,L,a,b\n100,100,100,0,0,0\n", Illuminant::D50),
        ] {
            let (quantity, values) = read(text, illuminant).unwrap();
            for v in values.unwrap() {
                assert!((v - 1.0).abs() < 1e-4, "{text} {quantity:?}: {v}");
            }
        }
    }

    #[test]
    fn what_is_no_colour_is_told() {
        for (text, part) in [
            ("patch,density\nA,1\n", "no colours"),
            ("L,a,b\n,,\n", "no colours"),
            ("L,a,b\n50,1,\n", "missing"),
            ("R,G,B\n256,0,0\n", "256"),
            ("nm400,nm500,nm700\n1,1,1\n", "evenly"),
        ] {
            let error = read(text, Illuminant::D50).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
