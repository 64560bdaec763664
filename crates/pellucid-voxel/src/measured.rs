//! Materials as they were measured, at any wavelengths, and as bands.

use crate::{Anisotropy, Channels, Material, MaterialTable, VoxelError};

/// Coefficients of materials at the wavelengths where they were measured.
///
/// In files it is a table with `wavelengths_nm` in place of channels: a list for all materials, or one in each material.
///
/// ```
/// use pellucid_voxel::{Channels, MeasuredSpectra};
/// let measured = MeasuredSpectra::from_json(
///     r#"{"wavelengths_nm": [390, 430, 470, 520],
///         "materials": [{"name": "ink", "sigma_s": [8, 6, 5, 4], "sigma_a": [1, 3, 1, 0.5], "g": 0.4}]}"#,
/// )?;
/// let table = measured.to_bands(&Channels::Bands { start_nm: 400.0, step_nm: 50.0, count: 3 }, 50.0)?;
/// assert_eq!(table.get(1).unwrap().sigma_s, [7.5, 5.5, 4.4]);
/// # Ok::<(), pellucid_voxel::VoxelError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredSpectra {
    materials: Vec<Measured>,
}

/// One material.
#[derive(Clone, Debug, PartialEq)]
struct Measured {
    wavelengths_nm: Vec<f64>,
    material: Material,
}

/// The widest gap between wavelengths in nm that a spectrum is read over without asking: inks' edges are some 30 nm wide.
pub const WIDEST_GAP_NM: f64 = 25.0;

impl MeasuredSpectra {
    /// The usual bands: 31 from 400 to 700 nm.
    pub const BANDS: Channels = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };

    /// Materials with the ascending wavelengths in nm of each one's values.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] naming the material when wavelengths do not ascend or are not above 0, or values are out
    /// of range or not as many; [`VoxelError::Unsupported`] as [`MaterialTable::new`].
    pub fn new(materials: Vec<(Vec<f64>, Material)>) -> Result<Self, VoxelError> {
        for (nm, material) in &materials {
            check_ascending(nm).map_err(|reason| {
                VoxelError::invalid(format!("material {:?}, wavelengths_nm", material.name), reason)
            })?;
            crate::material::check(nm.len(), std::slice::from_ref(material))?;
        }
        Ok(Self {
            materials: materials
                .into_iter()
                .map(|(wavelengths_nm, material)| Measured { wavelengths_nm, material })
                .collect(),
        })
    }

    /// The same as bands: by straight lines between wavelengths, averaged over the width of a band where they lie less
    /// than half as far apart as bands do. Half a band's width beyond the ends the last value stands.
    ///
    /// # Errors
    /// [`VoxelError::Invalid`] naming the material and where its wavelengths leave a gap of more than `widest_gap_nm`
    /// (such as [`WIDEST_GAP_NM`]) or do not reach, and as [`MaterialTable::over`].
    pub fn to_bands(&self, bands: &Channels, widest_gap_nm: f64) -> Result<MaterialTable, VoxelError> {
        let centres: Vec<f64> = bands.clone().checked()?.wavelengths_nm().collect();
        let Channels::Bands { step_nm, .. } = bands else {
            return Err(VoxelError::invalid("bands", "are needed; R, G, B and names have no wavelengths"));
        };
        let step = step_nm.abs();
        let materials = self.materials.iter().map(|m| m.to_bands(&centres, step, widest_gap_nm));
        MaterialTable::over(bands.clone(), materials.collect::<Result<_, _>>()?)
    }
}

impl Measured {
    fn to_bands(&self, centres: &[f64], step: f64, widest_gap: f64) -> Result<Material, VoxelError> {
        let nm = &self.wavelengths_nm;
        let (low, high) = (nm[0], nm[nm.len() - 1]);
        let fault = |reason: String| {
            VoxelError::invalid(format!("material {:?}, wavelengths_nm", self.material.name), reason)
        };
        if let Some(missed) = centres.iter().find(|&&at| at < low - 0.5 * step || at > high + 0.5 * step) {
            return Err(fault(format!("{low} to {high} do not reach {missed} nm; measure farther")));
        }
        let used = |w: &&[f64]| centres.iter().any(|&at| w[0] < at + 0.5 * step && at - 0.5 * step < w[1]);
        if let Some(gap) = nm.windows(2).filter(used).find(|w| w[1] - w[0] > widest_gap) {
            let (a, b) = (gap[0], gap[1]);
            return Err(fault(format!("a gap from {a} to {b}; at most {widest_gap} nm may lie between")));
        }
        let resampled = |values: &[f32]| -> Vec<f32> {
            centres.iter().map(|&at| band(nm, values, at, step) as f32).collect()
        };
        let m = &self.material;
        let g = match &m.g {
            Anisotropy::Uniform(g) => Anisotropy::Uniform(*g),
            Anisotropy::PerChannel(list) => Anisotropy::PerChannel(resampled(list)),
        };
        let (sigma_s, sigma_a) = (resampled(&m.sigma_s), resampled(&m.sigma_a));
        Ok(Material { name: m.name.clone(), sigma_s, sigma_a, g })
    }
}

/// What each of the ascending wavelengths `nm` adds to each band, `[band][wavelength]`, by the rule of
/// [`MeasuredSpectra::to_bands`]: for spectra of anything.
///
/// ```
/// use pellucid_voxel::{Channels, band_weights};
/// let bands = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 2 };
/// assert_eq!(band_weights(&[390.0, 410.0], &bands, 25.0)?, [[0.5, 0.5], [0.0, 1.0]]);
/// # Ok::<(), pellucid_voxel::VoxelError>(())
/// ```
///
/// # Errors
/// [`VoxelError::Invalid`] as [`MeasuredSpectra::new`] and [`MeasuredSpectra::to_bands`].
pub fn band_weights(nm: &[f64], bands: &Channels, widest_gap_nm: f64) -> Result<Vec<Vec<f64>>, VoxelError> {
    let Channels::Bands { step_nm, .. } = bands else {
        return Err(VoxelError::invalid("bands", "are needed; R, G, B and names have no wavelengths"));
    };
    let (step, centres) = (step_nm.abs(), bands.clone().checked()?.wavelengths_nm().collect::<Vec<f64>>());
    let checked = check_ascending(nm).and_then(|()| check_reach(nm, &centres, step, widest_gap_nm));
    checked.map_err(|reason| VoxelError::invalid("wavelengths", reason))?;
    let weight = |at: f64, j: usize| {
        let mut unit = vec![0.0; nm.len()];
        unit[j] = 1.0;
        band(nm, &unit, at, step)
    };
    Ok(centres.iter().map(|&at| (0..nm.len()).map(|j| weight(at, j)).collect()).collect())
}

fn check_ascending(nm: &[f64]) -> Result<(), String> {
    if nm.len() < 2 {
        return Err("fewer than 2; a spectrum needs more".into());
    }
    if !nm.iter().all(|v| v.is_finite() && *v > 0.0) || nm.windows(2).any(|w| w[0] >= w[1]) {
        return Err("must ascend and be above 0".into());
    }
    Ok(())
}

/// Whether wavelengths reach all bands, and lie close enough where bands are.
fn check_reach(nm: &[f64], centres: &[f64], step: f64, widest_gap: f64) -> Result<(), String> {
    let (low, high) = (nm[0], nm[nm.len() - 1]);
    if let Some(missed) = centres.iter().find(|&&at| at < low - 0.5 * step || at > high + 0.5 * step) {
        return Err(format!("{low} to {high} do not reach {missed} nm; measure farther"));
    }
    let used = |w: &[f64]| centres.iter().any(|&at| w[0] < at + 0.5 * step && at - 0.5 * step < w[1]);
    match nm.windows(2).filter(|w| used(w)).find(|w| w[1] - w[0] > widest_gap) {
        Some(gap) => {
            Err(format!("a gap from {} to {}; at most {widest_gap} nm may lie between", gap[0], gap[1]))
        }
        None => Ok(()),
    }
}

/// The value of a band.
fn band(nm: &[f64], values: &[f32], at: f64, step: f64) -> f64 {
    let next = nm.partition_point(|&v| v < at).clamp(1, nm.len() - 1);
    if nm[next] - nm[next - 1] >= 0.5 * step {
        return line(nm, values, at);
    }
    // Exact for straight lines: the trapezoids between the band's ends and the wavelengths within.
    let (low, high) = (at - 0.5 * step, at + 0.5 * step);
    let within = nm.iter().copied().filter(|v| (low..high).contains(v) && *v > low);
    let places: Vec<f64> = std::iter::once(low).chain(within).chain([high]).collect();
    let area = |w: &[f64]| 0.5 * (w[1] - w[0]) * (line(nm, values, w[0]) + line(nm, values, w[1]));
    places.windows(2).map(area).sum::<f64>() / step
}

/// Straight between wavelengths, level beyond them.
fn line(nm: &[f64], values: &[f32], at: f64) -> f64 {
    let next = nm.partition_point(|&v| v < at).clamp(1, nm.len() - 1);
    let part = ((at - nm[next - 1]) / (nm[next] - nm[next - 1])).clamp(0.0, 1.0);
    let (a, b) = (f64::from(values[next - 1]), f64::from(values[next]));
    if part == 1.0 { b } else { a + part * (b - a) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ink(values: Vec<f32>) -> Material {
        Material { name: "ink".into(), sigma_s: values.clone(), sigma_a: values, g: 0.4.into() }
    }

    fn bands(nm: Vec<f64>, values: Vec<f32>, bands: &Channels) -> Result<Vec<f32>, VoxelError> {
        let table = MeasuredSpectra::new(vec![(nm, ink(values))])?.to_bands(bands, WIDEST_GAP_NM)?;
        Ok(table.materials()[0].sigma_a.clone())
    }

    #[test]
    fn bands_that_were_measured_stay() {
        let nm: Vec<f64> = MeasuredSpectra::BANDS.wavelengths_nm().collect();
        let values: Vec<f32> = (0..31).map(|k| 0.1 + (k as f32 * 0.7).sin().abs()).collect();
        assert_eq!(bands(nm, values.clone(), &MeasuredSpectra::BANDS).unwrap(), values);
    }

    #[test]
    fn dense_measurements_are_averaged() {
        // A line of 1 nm width: its band has a tenth of it, no other anything.
        let nm: Vec<f64> = (380..=720).map(f64::from).collect();
        let mut values = vec![0.0; nm.len()];
        values[(552 - 380) as usize] = 2.0;
        let found = bands(nm, values, &MeasuredSpectra::BANDS).unwrap();
        for (k, v) in found.iter().enumerate() {
            assert!((v - if k == 15 { 0.2 } else { 0.0 }).abs() < 1e-6, "{k} {v}");
        }
    }

    #[test]
    fn gaps_and_missing_ends_are_refused_by_name() {
        let refused = |nm: Vec<f64>| {
            let values = vec![1.0; nm.len()];
            bands(nm, values, &MeasuredSpectra::BANDS).unwrap_err().to_string()
        };
        let even = |range: std::ops::RangeInclusive<i32>, step: usize| range.step_by(step).map(f64::from);
        let hole = even(400..=500, 10).chain(even(540..=700, 10)).collect();
        let text = refused(hole);
        assert!(text.contains("\"ink\"") && text.contains("500 to 540"), "{text}");
        let text = refused(even(420..=700, 10).collect());
        assert!(text.contains("400 nm"), "{text}");
        assert!(refused(vec![500.0]).contains("fewer than 2"));
        assert!(refused(vec![500.0, 490.0]).contains("ascend"));
        assert!(refused(vec![500.0, f64::NAN]).contains("ascend"));
        // A gap where no band lies does not matter.
        let beyond = even(300..=330, 30).chain(even(395..=705, 5)).collect();
        assert!(bands(beyond, vec![1.0; 65], &MeasuredSpectra::BANDS).is_ok());
    }

    proptest! {
        /// Weights say what values do.
        #[test]
        fn weights_add_up_to_the_bands(gaps in prop::collection::vec(0.5f64..24.0, 60), seed in 0u64..1000) {
            let mut nm = vec![380.0];
            gaps.iter().for_each(|g| nm.push(nm[nm.len() - 1] + g));
            prop_assume!(nm[nm.len() - 1] > 720.0);
            let values: Vec<f32> = (0..nm.len()).map(|i| ((i as u64 * 37 + seed) % 101) as f32).collect();
            let weights = band_weights(&nm, &MeasuredSpectra::BANDS, WIDEST_GAP_NM).unwrap();
            let found = bands(nm, values.clone(), &MeasuredSpectra::BANDS).unwrap();
            for (row, v) in weights.iter().zip(found) {
                let sum: f64 = row.iter().zip(&values).map(|(w, v)| w * f64::from(*v)).sum();
                prop_assert!((sum - f64::from(v)).abs() < 1e-4, "{sum} {v}");
                prop_assert!((row.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            }
        }

        /// Straight spectra are met whatever the wavelengths.
        #[test]
        fn straight_spectra_stay_straight(gaps in prop::collection::vec(0.5f64..24.0, 60), slope in 0.0f64..0.01) {
            let mut nm = vec![380.0];
            gaps.iter().for_each(|g| nm.push(nm[nm.len() - 1] + g));
            prop_assume!(nm[nm.len() - 1] > 720.0);
            let of = |nm: f64| 1.0 + slope * (nm - 380.0);
            let values = nm.iter().map(|&v| of(v) as f32).collect();
            let found = bands(nm, values, &MeasuredSpectra::BANDS).unwrap();
            for (v, at) in found.iter().zip(MeasuredSpectra::BANDS.wavelengths_nm()) {
                prop_assert!((f64::from(*v) - of(at)).abs() < 1e-5, "{} {}", v, at);
            }
        }
    }
}
