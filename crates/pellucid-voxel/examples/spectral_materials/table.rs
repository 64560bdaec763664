//! A *virtual* spectral table of the default inks: 31 bands whose averages over the red, green and blue thirds of the
//! spectrum are the measured R, G, B coefficients of [`MaterialTable::cmykw`].
//!
//! Nobody has published spectra of these inks; the paper's own were virtual too (Rittig et al. 2021, 5.3). Every
//! spectrum here is positive and smooth: a template that has the shape such pigments are known for, times the exponential
//! of three levels that go over into one another by logistic steps. The levels are what makes the averages right.

use pellucid_voxel::{Channels, Material, MaterialTable, VoxelError};

/// The bands.
pub const BANDS: Channels = Channels::Bands { start_nm: 400.0, step_nm: 10.0, count: 31 };

/// Bands whose mean is R, G, B: 600 to 700, 500 to 590, 400 to 490 nm.
pub const RGB_BANDS: [std::ops::Range<usize>; 3] = [20..31, 10..20, 0..10];

/// A spectrum's shape.
struct Shape {
    /// Where blue goes over into green, and green into red, and how wide, in nm.
    steps: [(f64, f64); 2],
    /// Peaks of the template: centre and width in nm, and how far it stands above 1.
    peaks: &'static [(f64, f64, f64)],
}

/// Without structure of its own, as scattering is: it follows the density and size of grains.
const PLAIN: Shape = Shape { steps: [(495.0, 22.0), (590.0, 22.0)], peaks: &[] };

/// Name, shape of the absorption, of the table's inks in order.
const INKS: [(&str, Shape); 5] = [
    // Copper phthalocyanine: two bands in the red, at 620 and 675 nm.
    (
        "cyan",
        Shape { steps: [(495.0, 16.0), (575.0, 14.0)], peaks: &[(620.0, 22.0, 0.35), (675.0, 20.0, 0.25)] },
    ),
    // Quinacridone: two bands in the green, at 530 and 566 nm, and a steep edge to the red.
    (
        "magenta",
        Shape { steps: [(490.0, 14.0), (588.0, 9.0)], peaks: &[(530.0, 14.0, 0.3), (566.0, 14.0, 0.35)] },
    ),
    // An azo yellow: a plateau and a steep edge, which lies as low as so little absorption of green asks for.
    ("yellow", Shape { steps: [(467.0, 9.0), (590.0, 20.0)], peaks: &[] }),
    // Carbon: nearly flat.
    ("black", PLAIN),
    // Titanium dioxide begins to absorb at the violet end.
    ("white", Shape { steps: [(450.0, 15.0), (590.0, 22.0)], peaks: &[] }),
];

impl Shape {
    /// The template and the weights of the red, green and blue levels at a wavelength.
    fn at(&self, nm: f64) -> (f64, [f64; 3]) {
        let [low, high] = self.steps.map(|(at, width)| 1.0 / (1.0 + ((at - nm) / width).exp()));
        let peaks =
            self.peaks.iter().map(|&(at, width, height)| height * (-((nm - at) / width).powi(2)).exp());
        (1.0 + peaks.sum::<f64>(), [low * high, low * (1.0 - high), 1.0 - low])
    }

    /// The spectrum with given means over [`RGB_BANDS`].
    fn spectrum(&self, rgb: &[f32]) -> Vec<f32> {
        let bands: Vec<(f64, [f64; 3])> = BANDS.wavelengths_nm().map(|nm| self.at(nm)).collect();
        let mut levels = [0.0f64; 3];
        let spectrum = |levels: &[f64; 3]| -> Vec<f64> {
            let each = bands.iter().map(|(template, weights)| {
                template * levels.iter().zip(weights).map(|(l, w)| l * w).sum::<f64>().exp()
            });
            each.collect()
        };
        // Each level acts mostly on its own mean, so that correcting them by turns converges.
        for _ in 0..500 {
            let now = spectrum(&levels);
            for (level, (range, &wanted)) in levels.iter_mut().zip(RGB_BANDS.iter().zip(rgb)) {
                *level += (f64::from(wanted) / mean(&now[range.clone()])).ln();
            }
        }
        spectrum(&levels).into_iter().map(rounded).collect()
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// To six digits.
fn rounded(value: f64) -> f32 {
    let unit = 10f64.powi(5 - value.log10().floor() as i32);
    ((value * unit).round() / unit) as f32
}

/// The table.
pub fn spectral_table() -> Result<MaterialTable, VoxelError> {
    let rgb = MaterialTable::cmykw();
    let materials = INKS.iter().zip(rgb.materials()).map(|((name, absorption), material)| Material {
        name: (*name).to_owned(),
        sigma_s: PLAIN.spectrum(&material.sigma_s),
        sigma_a: absorption.spectrum(&material.sigma_a),
        g: material.g.clone(),
    });
    MaterialTable::over(BANDS, materials.collect())
}
