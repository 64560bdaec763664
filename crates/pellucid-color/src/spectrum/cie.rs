//! Tabulated CIE data, 360 to 830 nm in steps of 10 nm (CIE 15, CIE 018), and what lies between the steps.

/// Wavelength of the first entry in nm.
const START_NM: f64 = 360.0;
/// From one entry to the next in nm.
pub(crate) const STEP_NM: f64 = 10.0;
/// Number of entries.
pub(crate) const ENTRIES: usize = 48;

/// Wavelengths in nm over which the observer and the illuminants are tabulated.
pub const VISIBLE_NM: std::ops::RangeInclusive<f64> = START_NM..=START_NM + STEP_NM * (ENTRIES - 1) as f64;

/// CIE 1931 2° colour matching functions: x, y, z at each wavelength (CIE 15).
pub(crate) const MATCHING: [[f64; 3]; ENTRIES] = [
    [0.000_129_9, 0.000_003_917, 0.000_606_1],
    [0.000_414_9, 0.000_012_39, 0.001_946],
    [0.001_368, 0.000_039, 0.006_45],
    [0.004_243, 0.000_12, 0.020_05],
    [0.014_31, 0.000_396, 0.067_85],
    [0.043_51, 0.001_21, 0.207_4],
    [0.134_38, 0.004, 0.645_6],
    [0.283_9, 0.011_6, 1.385_6],
    [0.348_28, 0.023, 1.747_06],
    [0.336_2, 0.038, 1.772_11],
    [0.290_8, 0.06, 1.669_2],
    [0.195_36, 0.090_98, 1.287_64],
    [0.095_64, 0.139_02, 0.812_95],
    [0.032_01, 0.208_02, 0.465_18],
    [0.004_9, 0.323, 0.272],
    [0.009_3, 0.503, 0.158_2],
    [0.063_27, 0.71, 0.078_25],
    [0.165_5, 0.862, 0.042_16],
    [0.290_4, 0.954, 0.020_3],
    [0.433_45, 0.994_95, 0.008_75],
    [0.594_5, 0.995, 0.003_9],
    [0.762_1, 0.952, 0.002_1],
    [0.916_3, 0.87, 0.001_65],
    [1.026_3, 0.757, 0.001_1],
    [1.062_2, 0.631, 0.000_8],
    [1.002_6, 0.503, 0.000_34],
    [0.854_45, 0.381, 0.000_19],
    [0.642_4, 0.265, 0.000_05],
    [0.447_9, 0.175, 0.000_02],
    [0.283_5, 0.107, 0.0],
    [0.164_9, 0.061, 0.0],
    [0.087_4, 0.032, 0.0],
    [0.046_77, 0.017, 0.0],
    [0.022_7, 0.008_21, 0.0],
    [0.011_359, 0.004_102, 0.0],
    [0.005_79, 0.002_091, 0.0],
    [0.002_899, 0.001_047, 0.0],
    [0.001_44, 0.000_52, 0.0],
    [0.000_690_1, 0.000_249_2, 0.0],
    [0.000_332_3, 0.000_12, 0.0],
    [0.000_166_2, 0.000_06, 0.0],
    [0.000_083_08, 0.000_03, 0.0],
    [0.000_041_51, 0.000_014_99, 0.0],
    [0.000_020_67, 0.000_007_466, 0.0],
    [0.000_010_25, 0.000_003_703, 0.0],
    [0.000_005_086, 0.000_001_837, 0.0],
    [0.000_002_523, 0.000_000_910_9, 0.0],
    [0.000_001_251, 0.000_000_451_8, 0.0],
];

/// Relative power of CIE standard illuminant D65.
pub(crate) const D65: [f64; ENTRIES] = [
    46.638_3, 52.089_1, 49.975_5, 54.648_2, 82.754_9, 91.486, 93.431_8, 86.682_3, 104.865, 117.008, 117.812,
    114.861, 115.923, 108.811, 109.354, 107.802, 104.79, 107.689, 104.405, 104.046, 100.0, 96.334_2, 95.788,
    88.685_6, 90.006_2, 89.599_1, 87.698_7, 83.288_6, 83.699_2, 80.026_8, 80.214_6, 82.277_8, 78.284_2,
    69.721_3, 71.609_1, 74.349, 61.604, 69.885_6, 75.087, 63.592_7, 46.418_2, 66.805_4, 63.382_8, 64.304,
    59.451_9, 51.959, 57.440_6, 60.312_5,
];

/// Relative power of CIE standard illuminant D50; past 780 nm, where the observer hardly sees, to a tenth.
pub(crate) const D50: [f64; ENTRIES] = [
    23.942, 26.961, 24.488, 29.871, 49.308, 56.513, 60.034, 57.818, 74.825, 87.247, 90.612, 91.368, 95.109,
    91.963, 95.724, 96.613, 97.129, 102.099, 100.755, 102.317, 100.0, 97.735, 98.918, 93.499, 97.688, 99.269,
    99.042, 95.722, 98.857, 95.667, 98.19, 103.003, 99.133, 87.381, 91.604, 92.889, 76.854, 86.511, 92.58,
    78.23, 57.692, 82.923, 78.274, 79.6, 73.4, 63.9, 70.8, 74.4,
];

/// The entry at or before a wavelength within [`VISIBLE_NM`], and how far on the way to the next it lies.
fn entry(nm: f64) -> (usize, f64) {
    let at = (nm - START_NM) / STEP_NM;
    let i = (at.floor().max(0.0) as usize).min(ENTRIES - 1);
    (i, if i + 1 == ENTRIES { 0.0 } else { at - i as f64 })
}

/// A table's value at a wavelength, linear between entries.
pub(crate) fn linear(table: &[f64; ENTRIES], nm: f64) -> f64 {
    let (i, part) = entry(nm);
    if part == 0.0 { table[i] } else { table[i] + part * (table[i + 1] - table[i]) }
}

/// Colour matching functions at a wavelength, by a cubic through the four nearest entries (CIE 15, 7.2.1).
pub(crate) fn matching(table: &[[f64; 3]; ENTRIES], nm: f64) -> [f64; 3] {
    let (i, part) = entry(nm);
    if part == 0.0 {
        return table[i];
    }
    let first = i.saturating_sub(1).min(ENTRIES - 4);
    let at = (i - first) as f64 + part;
    let mut value = [0.0; 3];
    for k in 0..4 {
        let weight: f64 =
            (0..4).filter(|&j| j != k).map(|j| (at - j as f64) / (k as f64 - j as f64)).product();
        value.iter_mut().zip(table[first + k]).for_each(|(v, m)| *v += weight * m);
    }
    value.map(|v| v.max(0.0))
}
