//! CIEDE2000 colour difference.

use crate::space::Lab;

/// CIEDE2000 between two Lab colours, with unit parametric factors.
///
/// After Sharma, Wu and Dalal (2005), "The CIEDE2000 color-difference formula". Angles enter
/// only as unit vectors but for the rotation term, which is what makes it fast: the mean hue is
/// the bisector of the two hues, and the cosines of its multiples follow from its own.
///
/// ```
/// use pellucid_color::{delta_e::delta_e_2000, space::Lab};
/// let a = Lab { l: 50.0, a: 2.6772, b: -79.7751 };
/// let b = Lab { l: 50.0, a: 0.0, b: -82.7485 };
/// assert!((delta_e_2000(a, b) - 2.0425).abs() < 1e-4);
/// ```
pub fn delta_e_2000(first: Lab, second: Lab) -> f64 {
    let mean_chroma7 = pow7(0.5 * (first.chroma() + second.chroma()));
    let g = 0.5 * (1.0 - (mean_chroma7 / (mean_chroma7 + POW7_25)).sqrt());
    let (a1, b1, a2, b2) = ((1.0 + g) * first.a, first.b, (1.0 + g) * second.a, second.b);
    let c1 = (a1 * a1 + b1 * b1).sqrt();
    let c2 = (a2 * a2 + b2 * b2).sqrt();
    let delta_l = second.l - first.l;
    let delta_c = c2 - c1;

    let dot = a1 * a2 + b1 * b2;
    let cross = a1 * b2 - b1 * a2;
    let product = c1 * c2;
    // ΔH' = 2 √(C1 C2) sin(Δh/2), without cancellation on either side of a right angle.
    let delta_h = if dot > 0.0 {
        cross / (0.5 * (product + dot)).sqrt()
    } else {
        (2.0 * (product - dot).max(0.0)).sqrt().copysign(cross)
    };

    let (cos_h, sin_h) = mean_hue(a1, b1, c1, a2, b2, c2);
    let mean_l = 0.5 * (first.l + second.l);
    let mean_c = 0.5 * (c1 + c2);
    let (cos_2h, sin_2h) = (cos_h * cos_h - sin_h * sin_h, 2.0 * sin_h * cos_h);
    let (cos_3h, sin_3h) = (cos_2h * cos_h - sin_2h * sin_h, sin_2h * cos_h + cos_2h * sin_h);
    let (cos_4h, sin_4h) = (cos_2h * cos_2h - sin_2h * sin_2h, 2.0 * sin_2h * cos_2h);
    let t = 1.0 - 0.17 * (cos_h * COS_30 + sin_h * 0.5)
        + 0.24 * cos_2h
        + 0.32 * (cos_3h * COS_6 - sin_3h * SIN_6)
        - 0.20 * (cos_4h * COS_63 + sin_4h * SIN_63);
    let l50 = (mean_l - 50.0) * (mean_l - 50.0);
    let s_l = 1.0 + 0.015 * l50 / (20.0 + l50).sqrt();
    let s_c = 1.0 + 0.045 * mean_c;
    let s_h = 1.0 + 0.015 * mean_c * t;

    let mean_c7 = pow7(mean_c);
    let r_c = 2.0 * (mean_c7 / (mean_c7 + POW7_25)).sqrt();
    let degrees = sin_h.atan2(cos_h).to_degrees();
    let from_blue = (if degrees < 0.0 { degrees + 360.0 } else { degrees } - 275.0) / 25.0;
    let r_t = -(2.0 * 30_f64.to_radians() * (-from_blue * from_blue).exp()).sin() * r_c;

    let (l, c, h) = (delta_l / s_l, delta_c / s_c, delta_h / s_h);
    (l * l + c * c + h * h + r_t * c * h).max(0.0).sqrt()
}

const POW7_25: f64 = 6_103_515_625.0;
const COS_30: f64 = 0.866_025_403_784_438_6;
const COS_6: f64 = 0.994_521_895_368_273_3;
const SIN_6: f64 = 0.104_528_463_267_653_47;
const COS_63: f64 = 0.453_990_499_739_546_8;
const SIN_63: f64 = 0.891_006_524_188_367_9;

fn pow7(x: f64) -> f64 {
    let cube = x * x * x;
    cube * cube * x
}

/// Cosine and sine of the mean hue: the bisector of the shorter arc; of exactly opposite hues
/// half their sum; an achromatic colour leaves the other's hue.
fn mean_hue(a1: f64, b1: f64, c1: f64, a2: f64, b2: f64, c2: f64) -> (f64, f64) {
    let unit = |a: f64, b: f64, c: f64| if c > 0.0 { (a / c, b / c) } else { (0.0, 0.0) };
    let ((x1, y1), (x2, y2)) = (unit(a1, b1, c1), unit(a2, b2, c2));
    let (x, y) = (x1 + x2, y1 + y2);
    let length = (x * x + y * y).sqrt();
    if length > 1e-7 {
        return (x / length, y / length);
    }
    if c1 == 0.0 || c2 == 0.0 {
        return (1.0, 0.0);
    }
    let angle = |x: f64, y: f64| {
        let h = y.atan2(x);
        if h < 0.0 { h + std::f64::consts::TAU } else { h }
    };
    let (h1, h2) = (angle(x1, y1), angle(x2, y2));
    let mut mean = 0.5 * (h1 + h2);
    if (h1 - h2).abs() > std::f64::consts::PI {
        mean += std::f64::consts::PI;
    }
    (mean.cos(), mean.sin())
}

/// CIEDE2000 of many pairs of Lab colours, `[L*, a*, b*]` each. The shortest length counts.
pub fn delta_e_2000_of(first: &[[f32; 3]], second: &[[f32; 3]], out: &mut [f32]) {
    let lab = |v: &[f32; 3]| Lab { l: v[0].into(), a: v[1].into(), b: v[2].into() };
    for ((first, second), out) in first.iter().zip(second).zip(out) {
        *out = delta_e_2000(lab(first), lab(second)) as f32;
    }
}

/// CIEDE2000 of many pairs of linear Rec.709 colours under D65. The shortest length counts.
pub fn delta_e_2000_of_linear_rgb(first: &[[f32; 3]], second: &[[f32; 3]], out: &mut [f32]) {
    let lab = |v: &[f32; 3]| Lab::from_linear_rgb(v.map(f64::from));
    for ((first, second), out) in first.iter().zip(second).zip(out) {
        *out = delta_e_2000(lab(first), lab(second)) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Table 1 of Sharma, Wu and Dalal (2005): L, a, b; L, a, b; ΔE00.
    const SHARMA: [[f64; 7]; 34] = [
        [50.0, 2.6772, -79.7751, 50.0, 0.0, -82.7485, 2.0425],
        [50.0, 3.1571, -77.2803, 50.0, 0.0, -82.7485, 2.8615],
        [50.0, 2.8361, -74.0200, 50.0, 0.0, -82.7485, 3.4412],
        [50.0, -1.3802, -84.2814, 50.0, 0.0, -82.7485, 1.0000],
        [50.0, -1.1848, -84.8006, 50.0, 0.0, -82.7485, 1.0000],
        [50.0, -0.9009, -85.5211, 50.0, 0.0, -82.7485, 1.0000],
        [50.0, 0.0, 0.0, 50.0, -1.0, 2.0, 2.3669],
        [50.0, -1.0, 2.0, 50.0, 0.0, 0.0, 2.3669],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0009, 7.1792],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0010, 7.1792],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0011, 7.2195],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0012, 7.2195],
        [50.0, -0.0010, 2.4900, 50.0, 0.0009, -2.4900, 4.8045],
        [50.0, -0.0010, 2.4900, 50.0, 0.0010, -2.4900, 4.8045],
        [50.0, -0.0010, 2.4900, 50.0, 0.0011, -2.4900, 4.7461],
        [50.0, 2.5000, 0.0, 50.0, 0.0, -2.5000, 4.3065],
        [50.0, 2.5000, 0.0, 73.0, 25.0, -18.0, 27.1492],
        [50.0, 2.5000, 0.0, 61.0, -5.0, 29.0, 22.8977],
        [50.0, 2.5000, 0.0, 56.0, -27.0, -3.0, 31.9030],
        [50.0, 2.5000, 0.0, 58.0, 24.0, 15.0, 19.4535],
        [50.0, 2.5000, 0.0, 50.0, 3.1736, 0.5854, 1.0000],
        [50.0, 2.5000, 0.0, 50.0, 3.2972, 0.0, 1.0000],
        [50.0, 2.5000, 0.0, 50.0, 1.8634, 0.5757, 1.0000],
        [50.0, 2.5000, 0.0, 50.0, 3.2592, 0.3350, 1.0000],
        [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
        [63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630],
        [61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731],
        [35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645],
        [22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373],
        [36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146],
        [90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441],
        [90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381],
        [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
        [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
    ];

    #[test]
    fn published_pairs() {
        for (i, row) in SHARMA.iter().enumerate() {
            let a = Lab { l: row[0], a: row[1], b: row[2] };
            let b = Lab { l: row[3], a: row[4], b: row[5] };
            assert!((delta_e_2000(a, b) - row[6]).abs() < 1e-4, "pair {}: {}", i + 1, delta_e_2000(a, b));
            assert!((delta_e_2000(b, a) - row[6]).abs() < 1e-4, "pair {} reversed", i + 1);
        }
    }

    /// The formula as published, in angles.
    fn textbook(first: Lab, second: Lab) -> f64 {
        let mean = 0.5 * (first.chroma() + second.chroma());
        let g = 0.5 * (1.0 - (mean.powi(7) / (mean.powi(7) + 25_f64.powi(7))).sqrt());
        let polar = |v: Lab| {
            let a = (1.0 + g) * v.a;
            let h = v.b.atan2(a).to_degrees();
            (a.hypot(v.b), if h < 0.0 { h + 360.0 } else { h })
        };
        let ((c1, h1), (c2, h2)) = (polar(first), polar(second));
        let mut dh = h2 - h1;
        let mut sum = h1 + h2;
        if c1 * c2 == 0.0 {
            dh = 0.0;
        } else {
            let wide = dh.abs() > 180.0;
            if wide {
                dh -= 360_f64.copysign(dh);
                sum += if sum < 360.0 { 360.0 } else { -360.0 };
            }
            sum *= 0.5;
        }
        let delta_h = 2.0 * (c1 * c2).sqrt() * (0.5 * dh).to_radians().sin();
        let (l, c) = (0.5 * (first.l + second.l), 0.5 * (c1 + c2));
        let cos = |degrees: f64| degrees.to_radians().cos();
        let t = 1.0 - 0.17 * cos(sum - 30.0) + 0.24 * cos(2.0 * sum) + 0.32 * cos(3.0 * sum + 6.0)
            - 0.20 * cos(4.0 * sum - 63.0);
        let theta = 30.0 * (-((sum - 275.0) / 25.0).powi(2)).exp();
        let r_c = 2.0 * (c.powi(7) / (c.powi(7) + 25_f64.powi(7))).sqrt();
        let r_t = -(2.0 * theta).to_radians().sin() * r_c;
        let l50 = (l - 50.0).powi(2);
        let x = (second.l - first.l) / (1.0 + 0.015 * l50 / (20.0 + l50).sqrt());
        let y = (c2 - c1) / (1.0 + 0.045 * c);
        let z = delta_h / (1.0 + 0.015 * c * t);
        (x * x + y * y + z * z + r_t * y * z).sqrt()
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(2000))]

        #[test]
        fn agrees_with_the_textbook_form(
            first in (0.0_f64..100.0, -128.0_f64..128.0, -128.0_f64..128.0),
            second in (0.0_f64..100.0, -128.0_f64..128.0, -128.0_f64..128.0),
            gap in proptest::sample::select(vec![0.0, 1e-6, 1e-3, 1.0]),
            grey in proptest::bool::ANY,
        ) {
            let lab = |(l, a, b): (f64, f64, f64)| Lab { l, a, b };
            let first = lab(first);
            // Far, near and coincident pairs.
            let mut second = lab(second);
            if gap < 1.0 {
                second = Lab { l: first.l + gap, a: first.a - gap * 0.3, b: first.b + gap * 0.2 };
            } else if grey {
                second = Lab { a: 0.0, b: 0.0, ..second };
            }
            let (ours, theirs) = (delta_e_2000(first, second), textbook(first, second));
            proptest::prop_assert!((ours - theirs).abs() < 1e-7 * (1.0 + theirs), "{ours} {theirs}");
        }
    }

    #[test]
    fn batches_equal_single_calls() {
        let colours: Vec<[f32; 3]> = (0..50).map(|i| [0.02 * i as f32, 0.3, 1.0 - 0.02 * i as f32]).collect();
        let shifted: Vec<[f32; 3]> = colours.iter().map(|c| [c[0] * 0.9, c[1] + 0.01, c[2]]).collect();
        let (mut lab_a, mut lab_b) = (vec![[0.0; 3]; 50], vec![[0.0; 3]; 50]);
        crate::space::lab_of_linear_rgb(&colours, &mut lab_a);
        crate::space::lab_of_linear_rgb(&shifted, &mut lab_b);
        let (mut direct, mut by_lab) = (vec![0.0; 50], vec![0.0; 50]);
        delta_e_2000_of_linear_rgb(&colours, &shifted, &mut direct);
        delta_e_2000_of(&lab_a, &lab_b, &mut by_lab);
        for i in 0..50 {
            let lab = |c: [f32; 3]| Lab::from_linear_rgb(c.map(f64::from));
            let exact = delta_e_2000(lab(colours[i]), lab(shifted[i]));
            assert!((f64::from(direct[i]) - exact).abs() < 1e-5);
            assert!((f64::from(by_lab[i]) - exact).abs() < 1e-3);
        }
    }
}
