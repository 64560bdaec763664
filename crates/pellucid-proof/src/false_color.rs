//! Quantities as colours.

use pellucid_color::space::srgb_decode;

/// The colour map viridis (Smith and van der Walt, matplotlib, CC0) as polynomials of degree 6 in sRGB, fitted by Matt
/// Zucker (CC0). `[power][channel]`.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.277_727_327_223_417_7, 0.005_407_344_544_966_578, 0.334_099_805_335_306_1],
    [0.105_093_043_108_577_4, 1.404_613_529_898_575, 1.384_590_162_594_685],
    [-0.330_861_828_725_556_3, 0.214_847_559_468_213, 0.095_095_163_028_236_59],
    [-4.634_230_498_983_486, -5.799_100_973_351_585, -19.332_440_956_279_87],
    [6.228_269_936_347_081, 14.179_933_366_805_09, 56.690_552_600_681_05],
    [4.776_384_997_670_288, -13.745_145_377_746_01, -65.353_032_633_372_34],
    [-5.435_455_855_934_631, 4.645_852_612_178_535, 26.312_435_249_583_2],
];

/// Linear RGB of a quantity on a scale of 0 to 1, what lies outside as the nearer end: from dark violet over green to
/// light yellow, in lightness as in quantity, also for those who see few hues. What is not a number counts as 1.
///
/// ```
/// use pellucid_proof::false_color;
/// assert_eq!(false_color(-2.0), false_color(0.0));
/// assert!(false_color(0.9)[1] > 3.0 * false_color(0.3)[1]);
/// ```
pub fn false_color(quantity: f32) -> [f32; 3] {
    let t = if quantity.is_nan() { 1.0 } else { f64::from(quantity.clamp(0.0, 1.0)) };
    let polynomial = |c: usize| VIRIDIS.iter().rev().fold(0.0, |sum, power| sum * t + power[c]);
    std::array::from_fn(|c| srgb_decode(polynomial(c).clamp(0.0, 1.0)) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pellucid_color::Lab;
    use pellucid_color::space::srgb_encode_u8;

    #[test]
    fn agrees_with_the_published_table() {
        let table = [
            (0.0, [68, 1, 84]),
            (0.25, [59, 82, 139]),
            (0.5, [33, 145, 140]),
            (0.75, [94, 201, 98]),
            (1.0, [253, 231, 37]),
        ];
        for (t, wanted) in table {
            let found = false_color(t).map(|v| srgb_encode_u8(f64::from(v)));
            let off = (0..3).map(|c| found[c].abs_diff(wanted[c])).max().unwrap();
            assert!(off <= 4, "{t}: {found:?}, {wanted:?}");
        }
    }

    #[test]
    fn lightness_ascends_evenly() {
        let lightness = |i: u32| Lab::from_linear_rgb(false_color(i as f32 / 20.0).map(f64::from)).l;
        for i in 0..20 {
            let step = lightness(i + 1) - lightness(i);
            assert!((2.5..5.5).contains(&step), "{i}: {step}");
        }
        assert_eq!(false_color(7.0), false_color(1.0));
        assert_eq!(false_color(f32::NAN), false_color(1.0));
    }
}
